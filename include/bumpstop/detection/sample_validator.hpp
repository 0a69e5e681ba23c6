/// @file
/// Validation of samples: lost, late, repeated, not finite, or impossible for the arm.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "bumpstop/math/functions.hpp"
#include "bumpstop/model/chain.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Why a sample cannot be used.
enum class SampleFault {
    none,
    filling,            ///< the sample is valid, but there are too few yet to differentiate
    not_finite,         ///< time, position or signal is not finite, or a quantity computed from them is not
    repeated,           ///< the time of the last sample, or nearly that
    out_of_order,       ///< earlier than the last sample
    gap,                ///< so long after the last sample that the history is dropped
    outside_limits,     ///< a position beyond the joint's limits
    impossible_jump,    ///< farther from the last sample than the joint can move, or a measured rate beyond its limit
    impossible_signal,  ///< current or torque beyond what the drive can give
    frozen,             ///< time goes on, but positions and signals of all joints do not change
};
inline constexpr int sample_faults = 10;

/// Measurements of one tick. Arrays of max_joints numbers; those beyond the last joint are ignored.
struct DetectorSample {
    double t = 0;                             ///< s
    std::array<double, max_joints> q{};       ///< rad or m
    std::array<double, max_joints> signal{};  ///< motor current in the joint model's unit, or joint torque [Nm or N]
    std::array<double, max_joints>
        qd{};  ///< measured rates [rad/s or m/s]; used only with SampleLimits::measured_rates
};

/// Limits of valid samples. The arrays are required for every joint: with zeros no sample of a moving arm is valid.
struct SampleLimits {
    double period = 0.004;                            ///< sampling period [s]
    double shortest_interval = 0;                     ///< below it a sample is a repetition [s]
    double late_interval = 0;                         ///< above it samples are missing [s]
    double longest_interval = 0;                      ///< above it the history is dropped [s]
    double resolution = 0;                            ///< of positions [rad or m]
    std::array<double, max_joints> lower{}, upper{};  ///< of positions, with a margin [rad or m]
    std::array<double, max_joints> velocity{};        ///< [rad/s or m/s]
    std::array<double, max_joints> signal{};          ///< largest magnitude [unit of the signal]
    bool measured_rates = false;
    /// How long all positions and signals may stay the same while the arm rests [s]; infinite: always, even in motion.
    double frozen_time = 0.1;
    std::uint32_t unmonitored = 0;  ///< joint j as bit j: its signal is not checked
    /// Joint j as bit j: it turns without end. Its position has no limits and may jump by whole turns, as that of an
    /// encoder with the range -pi to pi does.
    std::uint32_t endless = 0;
};

/// Recent rates of the arm, which distinguish frozen positions from an arm at rest.
struct RecentMotion {
    const double* rate = nullptr;  ///< by joint [rad/s or m/s]; null: not known
    double span = 0;               ///< time over which the rate is averaged [s]
};

/// Validates samples one after the other. Nothing is allocated.
class SampleValidator {
  public:
    SampleValidator(const SampleLimits& limits, int joints) noexcept : limits_(limits), joints_(joints) {
        constexpr double inf = std::numeric_limits<double>::infinity();
        for (int j = 0; j < max_joints; ++j) {
            is_joint_[j] = j < joints ? 1 : 0;
            monitored_[j] = j < joints && !(limits.unmonitored >> j & 1) ? 1 : 0;
            endless_[j] = j < joints && limits.endless >> j & 1 ? 1 : 0;
            if (endless_[j] > 0) limits_.upper[j] = max_position, limits_.lower[j] = -max_position;
            if (j < joints) continue;
            limits_.lower[j] = limits_.upper[j] = 0;
            limits_.velocity[j] = limits_.signal[j] = 0;
        }
        encoder_step_.fill(inf);
    }

    /// `none`: the sample is valid. `gap`: the sample is valid, but the history before it is dropped. Otherwise the
    /// sample is not valid.
    SampleFault check(const DetectorSample& sample, const RecentMotion& motion = {}) noexcept {
        constexpr double largest = std::numeric_limits<double>::max();
        interval_ = 0;
        late_ = false;
        // Comparisons with NaN are false, so each is written to reject the sample where it is false.
        if (!(std::fabs(sample.t) <= largest)) return SampleFault::not_finite;
        if (has_last_) {
            interval_ = sample.t - last_time_;
            if (!(interval_ >= 0)) return SampleFault::out_of_order;
            if (!(interval_ >= limits_.shortest_interval)) return SampleFault::repeated;
        }
        const bool restarts = !has_last_ || !(interval_ <= limits_.longest_interval);
        const double reach = interval_ + limits_.period;
        MaskOf<L> finite = mask_of<L>(true), inside = finite, possible = finite, reachable = finite, slow = finite;
        MaskOf<L> same = finite;
        alignas(64) double position[max_joints], signals[max_joints];
        for (int first = 0; first < joints_; first += native_lanes) {
            // Values beyond the last joint are replaced by zeros.
            const MaskOf<L> joint = load<L>(&is_joint_[first]) > L(0.5),
                            monitored = load<L>(&monitored_[first]) > L(0.5);
            const L q = select(joint, load<L>(&sample.q[first]), L(0.0));
            const L given = select(joint, load<L>(&sample.signal[first]), L(0.0));
            const MaskOf<L> number = abs(given) <= L(largest);
            const L signal = select(monitored | number, given, L(0.0));
            const L speed = load<L>(&limits_.velocity[first]);
            finite = finite & (abs(q) <= L(largest)) & (abs(signal) <= L(largest));
            inside = inside & (q >= load<L>(&limits_.lower[first])) & (q <= load<L>(&limits_.upper[first]));
            possible = possible & ((abs(signal) <= load<L>(&limits_.signal[first])) | !monitored);
            // The sample may have been taken up to a period before its time stamp.
            const L last = load<L>(&position_[first]);
            L now = q;
            if (limits_.endless != 0 && !restarts)
                now = select(load<L>(&endless_[first]) > L(0.5), q - whole_turns(q - last), q);
            reachable = reachable & (abs(now - last) <= speed * reach + limits_.resolution);
            same = same & (q == load<L>(&reported_[first])) & (signal == load<L>(&signal_[first]));
            if (limits_.measured_rates) {
                const L qd = select(joint, load<L>(&sample.qd[first]), L(0.0)), rate = abs(qd);
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
            if (!restarts || !all(slow)) return SampleFault::impossible_jump;
        }
        if (!(has_last_ && all(same))) {
            unrepeated_ = has_last_ && repeats_ == 0 ? unrepeated_ + 1 : 0;
            repeats_ = 0;
            frozen_ = false;
            changed_ = sample.t;
        } else if (!frozen_ && restarts) {
            // What happened in the gap is not known.
            changed_ = sample.t;
            repeats_ = 1;
        } else {
            ++repeats_;
            frozen_ = frozen_ || stands_still(sample.t - changed_, motion);
            if (frozen_) return SampleFault::frozen;
        }
        late_ = has_last_ && interval_ > limits_.late_interval;
        has_last_ = true;
        last_time_ = sample.t;
        for (int first = 0; first < joints_; first += native_lanes) {
            const MaskOf<L> joint = load<L>(&is_joint_[first]) > L(0.5);
            const L now = load<L>(position + first), change = abs(now - load<L>(&position_[first]));
            const L step = load<L>(&encoder_step_[first]);
            if (!restarts) store(select((change > L(0.0)) & (change < step), change, step), &encoder_step_[first]);
            store(now, &position_[first]);
            store(load<L>(signals + first), &signal_[first]);
            store(select(joint, load<L>(&sample.q[first]), L(0.0)), &reported_[first]);
            if (limits_.measured_rates) store(select(joint, load<L>(&sample.qd[first]), L(0.0)), &rate_[first]);
        }
        return restarts ? SampleFault::gap : SampleFault::none;
    }
    /// Positions of the last valid sample, max_joints numbers; zero beyond the last joint. Those of endless joints are
    /// continuous over whole turns.
    const double* position() const noexcept { return position_.data(); }
    /// Signals of the last valid sample, likewise; zero where that of an unmonitored joint was not finite.
    const double* signal() const noexcept { return signal_.data(); }
    /// Time of the last valid sample [s]; -infinity: none yet.
    double last_time() const noexcept { return has_last_ ? last_time_ : -std::numeric_limits<double>::infinity(); }
    /// From the last valid sample to the one checked [s]; 0 for the first.
    double interval() const noexcept { return interval_; }
    /// Samples are missing before the one checked.
    bool late() const noexcept { return late_; }
    void reset() noexcept {
        has_last_ = frozen_ = false;
        repeats_ = unrepeated_ = 0;
        encoder_step_.fill(std::numeric_limits<double>::infinity());
    }

  private:
    using L = Lanes<native_lanes>;

    static constexpr double max_position = 1e6;  // position of an endless joint [rad]
    // Least number of repetitions that count as frozen after frozen_time: a coarse encoder repeats a few at low rates.
    static constexpr long min_repeats = 4;
    // Encoder steps that the arm must have moved during a repetition: more where repetitions are common.
    static constexpr double missed_steps = 0.75, missed_steps_if_usual = 1.5;
    static constexpr long unusual = 20;  // samples without a repetition after which one is unusual
    // Encoder steps that the arm must have moved in the span of its rate, so that a flickering encoder is not a motion.
    static constexpr double moving_steps = 5;

    static L whole_turns(L angle) noexcept {
        constexpr double turn = 6.283185307179586;
        return turn * floor(angle * (1 / turn) + 0.5);
    }
    /// Positions and signals that have not changed for `held` seconds are frozen: for longer than an arm at rest may
    /// show, or while the arm moved by more than the resolution of its encoders.
    [[gnu::noinline, gnu::cold]] bool stands_still(double held, const RecentMotion& motion) const noexcept {
        if (!(limits_.frozen_time < std::numeric_limits<double>::infinity())) return false;
        if (held > limits_.frozen_time && repeats_ >= min_repeats) return true;
        if (motion.rate == nullptr) return false;
        const double missed = unrepeated_ >= unusual ? missed_steps : missed_steps_if_usual;
        for (int j = 0; j < joints_; ++j) {
            const double rate = std::fabs(motion.rate[j]);
            if (rate * held >= missed * encoder_step_[j] && rate * motion.span >= moving_steps * encoder_step_[j])
                return true;
        }
        return false;
    }

    SampleLimits limits_;
    int joints_;
    bool has_last_ = false, late_ = false, frozen_ = false;
    double last_time_ = 0, interval_ = 0;
    double changed_ = 0;                 // time of the last sample that was not a repetition
    long repeats_ = 0, unrepeated_ = 0;  // repetitions since then; samples before it without one
    std::array<double, max_joints> position_{}, signal_{};
    std::array<double, max_joints> reported_{}, rate_{};  // positions and rates as reported
    std::array<double, max_joints> encoder_step_{};       // smallest change of a position so far
    std::array<double, max_joints> is_joint_{}, monitored_{}, endless_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
