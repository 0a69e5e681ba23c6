/// @file
/// Samples that cannot be believed: lost, late, repeated, not finite, or impossible for the arm.
#pragma once

#include <array>
#include <cmath>
#include <limits>

#include "bumpstop/model/chain.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Why a tick cannot be judged.
enum class SampleFault {
    none,
    filling,            ///< samples are good, but there are too few yet to differentiate
    not_finite,         ///< time, position or signal is NaN or infinite, or what follows from them is
    repeated,           ///< the time of the sample before, or next to it
    out_of_order,       ///< earlier than a sample before
    gap,                ///< so long after the sample before that what was known is forgotten
    outside_limits,     ///< a position no joint can have
    impossible_jump,    ///< farther from the sample before than the joint can go
    impossible_signal,  ///< current or torque beyond what the drive can give
};
inline constexpr int sample_faults = 9;

/// What the arm tells in one tick. Arrays of max_joints numbers; those beyond the last joint are not read.
struct DetectorSample {
    double t = 0;                             ///< s
    std::array<double, max_joints> q{};       ///< rad or m
    std::array<double, max_joints> signal{};  ///< motor current in the joint model's unit, or joint torque [Nm or N]
    std::array<double, max_joints> qd{};      ///< measured rates [rad/s or m/s]; read only where the settings say so
};

/// What a sample may be.
struct SampleLimits {
    double period = 0.004;                            ///< of the samples [s]
    double shortest_interval = 0;                     ///< below it a sample repeats the one before [s]
    double late_interval = 0;                         ///< above it samples are missing, and the next one says so [s]
    double longest_interval = 0;                      ///< above it the past is forgotten [s]
    double resolution = 0;                            ///< of positions [rad or m]
    std::array<double, max_joints> lower{}, upper{};  ///< of positions, with their margin [rad or m]
    std::array<double, max_joints> velocity{};        ///< [rad/s or m/s]
    std::array<double, max_joints> signal{};          ///< largest magnitude [unit of the signal]
    bool measured_rates = false;
};

/// Checks samples one after the other. Nothing is allocated.
class SampleGuard {
  public:
    SampleGuard(const SampleLimits& limits, int joints) noexcept : limits_(limits), joints_(joints) {}

    /// `none`: the sample is believed, and so is the past. `gap`: the sample is believed, the past forgotten. Any other:
    /// the sample is not believed.
    SampleFault check(const DetectorSample& sample) noexcept {
        constexpr double largest = std::numeric_limits<double>::max();
        interval_ = 0;
        late_ = false;
        // Comparisons with NaN are false: each is written so that false refuses.
        if (!(std::fabs(sample.t) <= largest)) return SampleFault::not_finite;
        bool finite = true, inside = true, possible = true;
        for (int j = 0; j < joints_; ++j) {
            const double q = sample.q[j], signal = sample.signal[j];
            finite = finite && std::fabs(q) <= largest && std::fabs(signal) <= largest &&
                     (!limits_.measured_rates || std::fabs(sample.qd[j]) <= largest);
            inside = inside && q >= limits_.lower[j] && q <= limits_.upper[j];
            possible = possible && std::fabs(signal) <= limits_.signal[j];
        }
        if (known_) {
            interval_ = sample.t - before_;
            if (!(interval_ >= 0)) return SampleFault::out_of_order;
            if (!(interval_ >= limits_.shortest_interval)) return SampleFault::repeated;
        }
        if (!finite) return SampleFault::not_finite;
        if (!inside) return SampleFault::outside_limits;
        if (!possible) return SampleFault::impossible_signal;
        const bool fresh = !known_ || !(interval_ <= limits_.longest_interval);
        if (!fresh) {
            bool reachable = true;
            for (int j = 0; j < joints_; ++j) {
                // A sample may have been taken up to a period before its time says.
                const double farthest = limits_.velocity[j] * (interval_ + limits_.period) + limits_.resolution;
                reachable = reachable && std::fabs(sample.q[j] - position_[j]) <= farthest;
                if (limits_.measured_rates) reachable = reachable && std::fabs(sample.qd[j]) <= limits_.velocity[j];
            }
            if (!reachable) return SampleFault::impossible_jump;
        }
        late_ = known_ && interval_ > limits_.late_interval;
        known_ = true;
        before_ = sample.t;
        for (int j = 0; j < joints_; ++j) position_[j] = sample.q[j];
        return fresh ? SampleFault::gap : SampleFault::none;
    }
    /// Of the last sample that was believed [s]; -infinity: none yet.
    double last_time() const noexcept { return known_ ? before_ : -std::numeric_limits<double>::infinity(); }
    /// From the last sample believed to the one checked [s]; 0 without one.
    double interval() const noexcept { return interval_; }
    /// The sample came so late that others are missing before it.
    bool late() const noexcept { return late_; }
    void reset() noexcept { known_ = false; }

  private:
    SampleLimits limits_;
    int joints_;
    bool known_ = false, late_ = false;
    double before_ = 0, interval_ = 0;
    std::array<double, max_joints> position_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
