/// @file
/// Invalid samples: lost, late, repeated, not finite, or impossible for the arm.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "bumpstop/math/functions.hpp"
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
    frozen,             ///< time goes on, but positions and signals of all joints are those of the sample before
};
inline constexpr int sample_faults = 10;

/// What the arm tells in one tick. Arrays of max_joints numbers; those beyond the last joint mean nothing.
struct DetectorSample {
    double t = 0;                             ///< s
    std::array<double, max_joints> q{};       ///< rad or m
    std::array<double, max_joints> signal{};  ///< motor current in the joint model's unit, or joint torque [Nm or N]
    std::array<double, max_joints> qd{};      ///< measured rates [rad/s or m/s]; read only where the settings say so
};

/// What a sample may be. Arrays are to be given for every joint: with zeros no sample of a moving arm is valid.
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
    /// All positions and signals may repeat for so long while the arm rests [s]; infinite: for ever, even in motion.
    double frozen_time = 0.1;
    std::uint32_t unmonitored = 0;  ///< joint j as bit j: its signal may be anything
    /// Joint j as bit j: it turns without end. Its position may leave the limits, and jump by whole turns, as that of an
    /// encoder that tells -pi to pi does.
    std::uint32_t endless = 0;
};

/// How fast the arm moved lately: this tells a sample that repeats the one before from an arm at rest.
struct RecentMotion {
    const double* rate = nullptr;  ///< by joint [rad/s or m/s]; none: not known
    double span = 0;               ///< time that the rate is an average of [s]
};

/// Checks samples one after the other. Nothing is allocated.
class SampleValidator {
  public:
    SampleValidator(const SampleLimits& limits, int joints) noexcept : limits_(limits), joints_(joints) {
        constexpr double inf = std::numeric_limits<double>::infinity();
        for (int j = 0; j < max_joints; ++j) {
            ours_[j] = j < joints ? 1 : 0;
            needed_[j] = j < joints && !(limits.unmonitored >> j & 1) ? 1 : 0;
            endless_[j] = j < joints && limits.endless >> j & 1 ? 1 : 0;
            if (endless_[j] > 0) limits_.upper[j] = max_position, limits_.lower[j] = -max_position;
            if (j < joints) continue;
            limits_.lower[j] = limits_.upper[j] = 0;
            limits_.velocity[j] = limits_.signal[j] = 0;
        }
        step_.fill(inf);
    }

    /// `none`: the sample is valid, and so is the past. `gap`: the sample is valid, the past forgotten. Any other:
    /// the sample is not valid.
    SampleFault check(const DetectorSample& sample, const RecentMotion& motion = {}) noexcept {
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
        const bool fresh = !known_ || !(interval_ <= limits_.longest_interval);
        const double reach = interval_ + limits_.period;
        MaskOf<L> finite = L(0.0) <= L(0.0), inside = finite, possible = finite, reachable = finite, slow = finite;
        MaskOf<L> same = finite;
        alignas(64) double position[max_joints], signals[max_joints];
        for (int first = 0; first < joints_; first += native_lanes) {
            // What lies beyond the last joint counts as the zeros it is replaced by.
            const MaskOf<L> ours = load<L>(&ours_[first]) > L(0.5), needed = load<L>(&needed_[first]) > L(0.5);
            const L q = select(ours, load<L>(&sample.q[first]), L(0.0));
            const L given = select(ours, load<L>(&sample.signal[first]), L(0.0));
            const MaskOf<L> number = abs(given) <= L(largest);
            const L signal = select(needed | number, given, L(0.0));
            const L speed = load<L>(&limits_.velocity[first]);
            finite = finite & (abs(q) <= L(largest)) & (abs(signal) <= L(largest));
            inside = inside & (q >= load<L>(&limits_.lower[first])) & (q <= load<L>(&limits_.upper[first]));
            possible = possible & ((abs(signal) <= load<L>(&limits_.signal[first])) | !needed);
            // A sample may have been taken up to a period before its time says.
            const L valid = load<L>(&position_[first]);
            L now = q;
            if (limits_.endless != 0 && !fresh)
                now = select(load<L>(&endless_[first]) > L(0.5), q - whole_turns(q - valid), q);
            reachable = reachable & (abs(now - valid) <= speed * reach + limits_.resolution);
            same = same & (q == load<L>(&told_[first])) & (signal == load<L>(&signal_[first]));
            if (limits_.measured_rates) {
                const L qd = select(ours, load<L>(&sample.qd[first]), L(0.0)), rate = abs(qd);
                finite = finite & (rate <= L(largest));
                slow = slow & (rate <= speed);
                same = same & (qd == load<L>(&rate_[first]));
            }
            store(now, position + first);
            store(signal, signals + first);
        }
        if (!all(finite & inside & possible & reachable & slow)) {
            if (!all(finite)) return SampleFault::not_finite;
            if (!all(inside)) return SampleFault::outside_limits;
            if (!all(possible)) return SampleFault::impossible_signal;
            if (!fresh || !all(slow)) return SampleFault::impossible_jump;
        }
        if (!(known_ && all(same))) {
            fresh_rows_ = known_ && repeats_ == 0 ? fresh_rows_ + 1 : 0;
            repeats_ = 0;
            frozen_ = false;
            changed_ = sample.t;
        } else if (!frozen_ && fresh) {
            // Nobody knows what happened in the gap.
            changed_ = sample.t;
            repeats_ = 1;
        } else {
            ++repeats_;
            frozen_ = frozen_ || stands_still(sample.t - changed_, motion);
            if (frozen_) return SampleFault::frozen;
        }
        late_ = known_ && interval_ > limits_.late_interval;
        known_ = true;
        before_ = sample.t;
        for (int first = 0; first < joints_; first += native_lanes) {
            const MaskOf<L> ours = load<L>(&ours_[first]) > L(0.5);
            const L now = load<L>(position + first), change = abs(now - load<L>(&position_[first]));
            const L step = load<L>(&step_[first]);
            if (!fresh) store(select((change > L(0.0)) & (change < step), change, step), &step_[first]);
            store(now, &position_[first]);
            store(load<L>(signals + first), &signal_[first]);
            store(select(ours, load<L>(&sample.q[first]), L(0.0)), &told_[first]);
            if (limits_.measured_rates) store(select(ours, load<L>(&sample.qd[first]), L(0.0)), &rate_[first]);
        }
        return fresh ? SampleFault::gap : SampleFault::none;
    }
    /// Positions of the last valid sample, max_joints numbers; zero beyond the last joint. Those of endless
    /// joints go on over whole turns.
    const double* position() const noexcept { return position_.data(); }
    /// Signals of the last valid sample, likewise; zero where that of an unmonitored joint was no number.
    const double* signal() const noexcept { return signal_.data(); }
    /// Of the last valid sample [s]; -infinity: none yet.
    double last_time() const noexcept { return known_ ? before_ : -std::numeric_limits<double>::infinity(); }
    /// From the last valid sample to the one checked [s]; 0 without one.
    double interval() const noexcept { return interval_; }
    /// The sample came so late that others are missing before it.
    bool late() const noexcept { return late_; }
    void reset() noexcept {
        known_ = frozen_ = false;
        repeats_ = fresh_rows_ = 0;
        step_.fill(std::numeric_limits<double>::infinity());
    }

  private:
    using L = Lanes<native_lanes>;

    static constexpr double max_position = 1e6;  // position of an endless joint [rad]
    // Repeats that count as frozen where the time is up: at low rates a coarse sensor repeats a few by itself.
    static constexpr long min_repeats = 4;
    // Steps of an encoder that the arm must have missed in a repeat: more where repeats are nothing new.
    static constexpr double missed_steps = 0.75, missed_steps_if_usual = 1.5;
    static constexpr long unusual = 20;  // rows without a repeat
    // Steps by which it must have moved while its rate was taken, so that an encoder that flickers is no motion.
    static constexpr double moving_steps = 5;

    static L whole_turns(L angle) noexcept {
        constexpr double turn = 6.283185307179586;
        return turn * floor(angle * (1 / turn) + 0.5);
    }
    /// Positions and signals have not changed for `held` seconds, but they should have: for too long while the arm may
    /// rest, or while it moved by more than its encoders' smallest step.
    [[gnu::noinline, gnu::cold]] bool stands_still(double held, const RecentMotion& motion) const noexcept {
        if (!(limits_.frozen_time < std::numeric_limits<double>::infinity())) return false;
        if (held > limits_.frozen_time && repeats_ >= min_repeats) return true;
        if (motion.rate == nullptr) return false;
        const double missed = fresh_rows_ >= unusual ? missed_steps : missed_steps_if_usual;
        for (int j = 0; j < joints_; ++j) {
            const double rate = std::fabs(motion.rate[j]);
            if (rate * held >= missed * step_[j] && rate * motion.span >= moving_steps * step_[j]) return true;
        }
        return false;
    }

    SampleLimits limits_;
    int joints_;
    bool known_ = false, late_ = false, frozen_ = false;
    double before_ = 0, interval_ = 0;
    double changed_ = 0;                 // time of the last sample that was not the one before over again
    long repeats_ = 0, fresh_rows_ = 0;  // samples since then; samples before it without a repeat
    std::array<double, max_joints> position_{}, signal_{};
    std::array<double, max_joints> told_{}, rate_{};  // positions as they were told, and measured rates
    std::array<double, max_joints> step_{};           // smallest change of a position so far
    std::array<double, max_joints> ours_{}, needed_{}, endless_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
