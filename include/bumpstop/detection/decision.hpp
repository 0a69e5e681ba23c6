/// @file
/// From residuals to alarms: arming, thresholds, two channels, and an alarm that stays.
#pragma once

#include <cstdint>

#include "bumpstop/detection/observer.hpp"
#include "bumpstop/detection/threshold_law.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// What the detector is doing.
enum class DetectorState {
    blind,     ///< it cannot tell: no believable samples
    arming,    ///< a motion has just begun; residuals are not judged
    watching,  ///< it judges every tick
    alarm,     ///< it has judged, and waits to be told to go on
};
inline constexpr int detector_states = 4;

struct DecisionSettings {
    ThresholdLaw thresholds;
    double arming_delay = 0;            ///< after a motion begins [s]
    double rest_time = 0.1;             ///< all joints slower than their rest_speed for this long: the arm rests [s]
    double low_hz = 0.5, high_hz = 30;  ///< of the fast channel
};

/// Judges residuals tick by tick. Nothing is allocated.
class Decision {
  public:
    Decision(const DecisionSettings& settings, int joints) noexcept
        : settings_(settings), joints_(joints), band_(settings.low_hz, settings.high_hz, joints) {
        for (int j = 0; j < joints; ++j) any_fast_ = any_fast_ || settings.thresholds.fast[j] < ThresholdLaw::unwatched;
    }

    /// A tick at time t [s], `dt` after the last: residuals, rates, accelerations and the standard errors of the torque
    /// (or none), by joint and finite. True: the alarm begins with this tick.
    bool judge(double t, double dt, const double* residual, const double* qd, const double* qdd,
               const double* sd) noexcept {
        const ThresholdLaw& law = settings_.thresholds;
        bool moving = false;
        over_ = over_fast_ = 0;
        if (any_fast_) band_.update(dt, residual, fast_.data());
        for (int j = 0; j < joints_; ++j) {
            moving = moving || absolute(qd[j]) > law.rest_speed[j];
            // Whatever makes the model less sure widens both channels as much.
            const double extra = law.extra(j, qd[j], qdd[j], sd != nullptr ? sd[j] : 0.0);
            threshold_[j] = law.constant[j] + extra;
            over_ |= std::uint32_t(absolute(residual[j]) > threshold_[j]) << j;
            over_fast_ |= std::uint32_t(any_fast_ && absolute(fast_[j]) > law.fast[j] + extra) << j;
        }
        if (moving) {
            if (resting_) begun_ = t;
            resting_ = false;
            moved_ = t;
        } else if (t - moved_ >= settings_.rest_time) {
            resting_ = true;
        }
        const bool armed = resting_ || t - begun_ >= settings_.arming_delay;
        const bool over = (over_ | over_fast_) != 0;
        unseen_ = !armed && over;
        if (state_ == DetectorState::alarm) return false;
        state_ = armed ? DetectorState::watching : DetectorState::arming;
        if (!armed || !over) return false;
        state_ = DetectorState::alarm;
        return true;
    }

    /// The alarm is over.
    void acknowledge() noexcept {
        if (state_ == DetectorState::alarm) state_ = DetectorState::watching;
    }
    /// After a time without residuals the filter begins anew.
    void interrupt() noexcept { band_.reset(); }
    void reset() noexcept {
        interrupt();
        resting_ = true;
        moved_ = -std::numeric_limits<double>::infinity();
        state_ = DetectorState::watching;
        over_ = over_fast_ = 0;
    }

    DetectorState state() const noexcept { return state_; }
    /// Joints over their thresholds in the last tick, joint j as bit j: of the residual, and of the fast channel.
    std::uint32_t over() const noexcept { return over_; }
    std::uint32_t over_fast() const noexcept { return over_fast_; }
    /// The last tick would have been an alarm, had the detector been armed.
    bool unseen() const noexcept { return unseen_; }
    const double* threshold() const noexcept { return threshold_.data(); }
    const double* fast() const noexcept { return fast_.data(); }

  private:
    DecisionSettings settings_;
    int joints_;
    BandPass band_;
    DetectorState state_ = DetectorState::watching;
    bool any_fast_ = false, resting_ = true, unseen_ = false;
    double begun_ = 0, moved_ = -std::numeric_limits<double>::infinity();
    std::uint32_t over_ = 0, over_fast_ = 0;
    std::array<double, max_joints> threshold_{}, fast_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
