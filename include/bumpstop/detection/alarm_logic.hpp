/// @file
/// From residuals to alarms: arming, thresholds, two channels, and an alarm that stays.
#pragma once

#include <cstdint>

#include "bumpstop/detection/observer.hpp"
#include "bumpstop/detection/threshold_model.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// What the detector is doing.
enum class DetectorState {
    no_data,     ///< it cannot tell: no valid samples
    arming,      ///< a motion has just begun; residuals are not judged
    monitoring,  ///< it judges every tick
    alarm,       ///< it has judged, and waits to be told to go on
};
inline constexpr int detector_states = 4;

struct AlarmSettings {
    ThresholdModel thresholds;
    double arming_delay = 0;            ///< after a motion begins [s]
    double rest_time = 0.1;             ///< all joints slower than their rest_speed for this long: the arm rests [s]
    double low_hz = 0.5, high_hz = 30;  ///< of the band-pass channel
    /// While an alarm stands, a residual that passes its threshold after so long below is another event [s]; infinite:
    /// it never is.
    double event_pause = 0.1;
};

/// Judges residuals tick by tick. Nothing is allocated.
class AlarmLogic {
  public:
    AlarmLogic(const AlarmSettings& settings, int joints) noexcept
        : settings_(settings), joints_(joints), band_(settings.low_hz, settings.high_hz) {
        ThresholdModel& law = settings_.thresholds;
        for (int j = 0; j < max_joints; ++j) {
            if (j >= joints) {
                law.constant[j] = law.fast[j] = law.rest_speed[j] = ThresholdModel::unmonitored;
                law.speed[j] = law.acceleration[j] = law.rest[j] = 0;
            }
            any_fast_ = any_fast_ || law.fast[j] < ThresholdModel::unmonitored;
            inverse_rest_speed_[j] = 1 / law.rest_speed[j];
        }
    }

    /// A tick at time t [s], `dt` after the last: residuals, rates, accelerations and the standard errors of the torque
    /// (or none), by joint and finite, in arrays of max_joints numbers. True: an event begins with this tick, which raises
    /// the alarm, or comes while it stands.
    bool update(double t, double dt, const double* residual, const double* qd, const double* qdd,
                const double* sd) noexcept {
        const ThresholdModel& law = settings_.thresholds;
        const BandPass::Shares kept = any_fast_ ? band_.step(dt) : BandPass::Shares{0, 0};
        std::uint32_t above = 0, above_fast = 0;
        MaskOf<L> fast_motion = L(1.0) < L(0.0);
        for (int first = 0; first < joints_; first += native_lanes) {
            const L speed = abs(load<L>(qd + first)), rest_speed = load<L>(&law.rest_speed[first]);
            fast_motion = fast_motion | (speed > rest_speed);
            const L resting = max(L(0.0), min(L(1.0), 2.0 - speed * load<L>(&inverse_rest_speed_[first])));
            L extra = load<L>(&law.speed[first]) * speed + load<L>(&law.rest[first]) * resting +
                      load<L>(&law.acceleration[first]) * abs(load<L>(qdd + first));
            if (sd != nullptr) extra += law.model_errors * load<L>(sd + first);
            const L threshold = load<L>(&law.constant[first]) + extra;
            store(threshold, &threshold_[first]);
            const L now = load<L>(residual + first);
            above |= set_bits(abs(now) > threshold) << first;
            // Whatever makes the model less sure widens both channels as much.
            if (any_fast_) {
                const L fast = band_.pass(kept, first, now);
                store(fast, &fast_[first]);
                above_fast |= set_bits(abs(fast) > load<L>(&law.fast[first]) + extra) << first;
            }
        }
        over_ = above;
        over_fast_ = above_fast;
        const bool moving = any(fast_motion);
        if (moving) {
            if (resting_) begun_ = t;
            resting_ = false;
            moved_ = t;
        } else if (t - moved_ >= settings_.rest_time) {
            resting_ = true;
        }
        const bool armed = resting_ || t - begun_ >= settings_.arming_delay;
        const bool over = (over_ | over_fast_) != 0;
        masked_ = !armed && over;
        const bool stands = state_ == DetectorState::alarm;
        over_armed_ = armed && over;
        if (!stands) state_ = armed ? DetectorState::monitoring : DetectorState::arming;
        // After ticks without a residual the time below the thresholds counts anew.
        if (!known_) below_since_ = t;
        known_ = true;
        if (!over_armed_) {
            event_over_ = event_over_ || t - below_since_ >= settings_.event_pause;
            return false;
        }
        const bool begins = !stands || event_over_;
        state_ = DetectorState::alarm;
        below_since_ = t;
        event_over_ = false;
        return begins;
    }

    /// The alarm is over.
    void acknowledge() noexcept {
        if (state_ == DetectorState::alarm) state_ = DetectorState::monitoring;
    }
    /// After a time without residuals the filter begins anew.
    void interrupt() noexcept {
        band_.reset();
        skip();
    }
    /// A tick without a residual: it does not count as below the thresholds.
    void skip() noexcept { known_ = false; }
    void reset() noexcept {
        interrupt();
        resting_ = true;
        moved_ = -std::numeric_limits<double>::infinity();
        state_ = DetectorState::monitoring;
        over_ = over_fast_ = 0;
    }

    DetectorState state() const noexcept { return state_; }
    /// Joints over their thresholds in the last tick, joint j as bit j: of the residual, and of the band-pass channel.
    std::uint32_t over() const noexcept { return over_; }
    std::uint32_t over_fast() const noexcept { return over_fast_; }
    /// Over some threshold in the last tick, and armed: what an event goes on with.
    bool over_armed() const noexcept { return over_armed_; }
    /// The last tick would have been an alarm, had the detector been armed.
    bool masked_while_arming() const noexcept { return masked_; }
    const double* threshold() const noexcept { return threshold_.data(); }
    const double* fast() const noexcept { return fast_.data(); }

  private:
    using L = Lanes<native_lanes>;

    static std::uint32_t set_bits(MaskOf<L> mask) noexcept {
        std::uint32_t bits = 0;
        if (!any(mask)) return bits;
        for (int lane = 0; lane < native_lanes; ++lane) bits |= std::uint32_t(lane_of(mask, lane)) << lane;
        return bits;
    }

    AlarmSettings settings_;
    int joints_;
    BandPass band_;
    DetectorState state_ = DetectorState::monitoring;
    bool any_fast_ = false, resting_ = true, masked_ = false, known_ = false, over_armed_ = false;
    bool event_over_ = false;  // no residual was over a threshold for the pause
    double below_since_ = 0;   // since when nothing was over a threshold [s]
    double begun_ = 0, moved_ = -std::numeric_limits<double>::infinity();
    std::uint32_t over_ = 0, over_fast_ = 0;
    std::array<double, max_joints> threshold_{}, fast_{}, inverse_rest_speed_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
