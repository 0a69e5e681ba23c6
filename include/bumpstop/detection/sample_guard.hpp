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
    impossible_jump,    ///< farther from the sample before than the joint can go, or a measured rate beyond its limit
    impossible_signal,  ///< current or torque beyond what the drive can give
};
inline constexpr int sample_faults = 9;

/// What the arm tells in one tick. Arrays of max_joints numbers; those beyond the last joint mean nothing.
struct DetectorSample {
    double t = 0;                             ///< s
    std::array<double, max_joints> q{};       ///< rad or m
    std::array<double, max_joints> signal{};  ///< motor current in the joint model's unit, or joint torque [Nm or N]
    std::array<double, max_joints> qd{};      ///< measured rates [rad/s or m/s]; read only where the settings say so
};

/// What a sample may be. Arrays are to be given for every joint: with zeros no sample of a moving arm is believed.
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
    SampleGuard(const SampleLimits& limits, int joints) noexcept : limits_(limits), joints_(joints) {
        for (int j = 0; j < max_joints; ++j) {
            ours_[j] = j < joints ? 1 : 0;
            if (j < joints) continue;
            limits_.lower[j] = limits_.upper[j] = 0;
            limits_.velocity[j] = limits_.signal[j] = 0;
        }
    }

    /// `none`: the sample is believed, and so is the past. `gap`: the sample is believed, the past forgotten. Any other:
    /// the sample is not believed.
    SampleFault check(const DetectorSample& sample) noexcept {
        constexpr double largest = std::numeric_limits<double>::max();
        interval_ = 0;
        late_ = false;
        // Comparisons with NaN are false: each is written so that false refuses.
        if (!(std::fabs(sample.t) <= largest)) return SampleFault::not_finite;
        if (known_) {
            interval_ = sample.t - before_;
            if (!(interval_ >= 0)) return SampleFault::out_of_order;
            if (!(interval_ >= limits_.shortest_interval)) return SampleFault::repeated;
        }
        const double reach = interval_ + limits_.period;
        MaskOf<L> finite = L(0.0) <= L(0.0), inside = finite, possible = finite, reachable = finite, slow = finite;
        for (int first = 0; first < joints_; first += native_lanes) {
            // What lies beyond the last joint counts as the zeros it is replaced by.
            const MaskOf<L> ours = load<L>(&ours_[first]) > L(0.5);
            const L q = select(ours, load<L>(&sample.q[first]), L(0.0));
            const L signal = select(ours, load<L>(&sample.signal[first]), L(0.0));
            const L size = absolute(signal), speed = load<L>(&limits_.velocity[first]);
            finite = finite & (absolute(q) <= L(largest)) & (size <= L(largest));
            inside = inside & (q >= load<L>(&limits_.lower[first])) & (q <= load<L>(&limits_.upper[first]));
            possible = possible & (size <= load<L>(&limits_.signal[first]));
            // A sample may have been taken up to a period before its time says.
            const L moved = absolute(q - load<L>(&position_[first]));
            reachable = reachable & (moved <= speed * reach + limits_.resolution);
            if (limits_.measured_rates) {
                const L rate = absolute(select(ours, load<L>(&sample.qd[first]), L(0.0)));
                finite = finite & (rate <= L(largest));
                slow = slow & (rate <= speed);
            }
        }
        const bool fresh = !known_ || !(interval_ <= limits_.longest_interval);
        if (!all(finite & inside & possible & reachable & slow)) {
            if (!all(finite)) return SampleFault::not_finite;
            if (!all(inside)) return SampleFault::outside_limits;
            if (!all(possible)) return SampleFault::impossible_signal;
            if (!fresh || !all(slow)) return SampleFault::impossible_jump;
        }
        late_ = known_ && interval_ > limits_.late_interval;
        known_ = true;
        before_ = sample.t;
        for (int first = 0; first < joints_; first += native_lanes) {
            const MaskOf<L> ours = load<L>(&ours_[first]) > L(0.5);
            store(select(ours, load<L>(&sample.q[first]), L(0.0)), &position_[first]);
        }
        return fresh ? SampleFault::gap : SampleFault::none;
    }
    /// Positions of the last sample that was believed, max_joints numbers; zero beyond the last joint.
    const double* position() const noexcept { return position_.data(); }
    /// Of the last sample that was believed [s]; -infinity: none yet.
    double last_time() const noexcept { return known_ ? before_ : -std::numeric_limits<double>::infinity(); }
    /// From the last sample believed to the one checked [s]; 0 without one.
    double interval() const noexcept { return interval_; }
    /// The sample came so late that others are missing before it.
    bool late() const noexcept { return late_; }
    void reset() noexcept { known_ = false; }

  private:
    using L = Lanes<native_lanes>;

    SampleLimits limits_;
    int joints_;
    bool known_ = false, late_ = false;
    double before_ = 0, interval_ = 0;
    std::array<double, max_joints> position_{}, ours_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
