/// @file
/// From residuals to alarms: thresholds, arming, two channels, events, and an alarm that stands until it is acknowledged.
#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include "bumpstop/detection/observer.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

enum class DetectorState {
    no_data,     ///< no valid samples
    arming,      ///< a motion has just begun; residuals raise no alarm
    monitoring,  ///< residuals are compared with their thresholds
    alarm,       ///< an alarm was raised and has not been acknowledged
};
inline constexpr int detector_states = 4;

/// Thresholds that grow with the uncertainty of the model:
///
///   theta_j = constant_j + speed_j |qd_j| + acceleration_j |qdd_j| + rest_j f(qd_j) + model_errors sd_j
///
/// f is 1 up to rest_speed_j and falls to 0 at twice that; sd_j is the standard error of the estimated torque.
struct ThresholdModel {
    static constexpr double unmonitored = std::numeric_limits<double>::infinity();

    std::array<double, max_joints> constant{};      ///< Nm or N; infinite: the joint is not monitored
    std::array<double, max_joints> speed{};         ///< Nm s/rad or N s/m
    std::array<double, max_joints> acceleration{};  ///< Nm s2/rad or N s2/m
    std::array<double, max_joints> rest{};          ///< Nm or N, at standstill
    std::array<double, max_joints> rest_speed{};    ///< rad/s or m/s, above 0
    std::array<double, max_joints> fast{};          ///< of the band-pass channel [Nm or N]; infinite: not monitored
    double model_errors = 0;                        ///< number of standard errors of the torque to add
};

struct AlarmSettings {
    ThresholdModel thresholds;
    double arming_delay = 0;            ///< after a motion begins [s]
    double rest_time = 0.1;             ///< the arm rests once all joints were below rest_speed for this long [s]
    double low_hz = 0.5, high_hz = 30;  ///< cut-off frequencies of the band-pass channel
    /// While an alarm stands, a residual over its threshold begins another event if all were below for this long
    /// [s]; infinite: never.
    double event_pause = 0.1;
};

/// From the first to the last tick of an event in which some residual is over its threshold. Times in s.
struct EventSpan {
    double begin = 0, end = 0;
    std::array<double, max_joints> largest{};  ///< residual of the largest magnitude, with its sign, by joint [Nm or N]
    double largest_share = 0;                  ///< largest ratio of a residual to its threshold
    double largest_time = 0;                   ///< time of that residual
    int largest_joint = -1;                    ///< its joint, from 0; -1: no joint is monitored

    /// Begins the event at time t with residuals and thresholds of `joints` joints.
    void start(double t, const double* residual, const double* threshold, int joints) noexcept {
        *this = {};
        begin = t;
        extend(t, residual, threshold, joints);
    }
    /// Extends the event to time t, where some residual is over its threshold again.
    void extend(double t, const double* residual, const double* threshold, int joints) noexcept {
        end = t;
        for (int j = 0; j < joints; ++j) {
            const double size = std::fabs(residual[j]);
            if (size > std::fabs(largest[j])) largest[j] = residual[j];
            if (!(size > largest_share * threshold[j])) continue;
            largest_share = size / threshold[j];
            largest_time = t;
            largest_joint = j;
        }
    }
};

/// Compares residuals with their thresholds, tick by tick. Nothing is allocated.
class AlarmLogic {
  public:
    AlarmLogic(const AlarmSettings& settings, int joints) noexcept
        : settings_(settings), joints_(joints), band_(settings.low_hz, settings.high_hz) {
        ThresholdModel& model = settings_.thresholds;
        for (int j = 0; j < max_joints; ++j) {
            if (j >= joints) {
                model.constant[j] = model.fast[j] = model.rest_speed[j] = ThresholdModel::unmonitored;
                model.speed[j] = model.acceleration[j] = model.rest[j] = 0;
            }
            any_fast_ = any_fast_ || model.fast[j] < ThresholdModel::unmonitored;
            inverse_rest_speed_[j] = 1 / model.rest_speed[j];
        }
    }

    /// Takes a tick at time t [s], `dt` after the last one: residuals, rates, accelerations and the standard errors of
    /// the torque (or null), by joint and finite, in arrays of max_joints numbers. True: an event begins with this
    /// tick. It raises the alarm, or comes while one stands.
    bool update(double t, double dt, const double* residual, const double* qd, const double* qdd,
                const double* sd) noexcept {
        const ThresholdModel& model = settings_.thresholds;
        const BandPass::Shares kept = any_fast_ ? band_.step(dt) : BandPass::Shares{0, 0};
        std::uint32_t above = 0, above_fast = 0;
        MaskOf<L> fast_motion = mask_of<L>(false);
        for (int first = 0; first < joints_; first += native_lanes) {
            const L speed = abs(load<L>(qd + first)), rest_speed = load<L>(&model.rest_speed[first]);
            fast_motion = fast_motion | (speed > rest_speed);
            const L resting = max(L(0.0), min(L(1.0), 2.0 - speed * load<L>(&inverse_rest_speed_[first])));
            L extra = load<L>(&model.speed[first]) * speed + load<L>(&model.rest[first]) * resting +
                      load<L>(&model.acceleration[first]) * abs(load<L>(qdd + first));
            if (sd != nullptr) extra += model.model_errors * load<L>(sd + first);
            const L threshold = load<L>(&model.constant[first]) + extra;
            store(threshold, &threshold_[first]);
            const L now = load<L>(residual + first);
            above |= set_bits(abs(now) > threshold) << first;
            // The uncertainty of the model is added to the thresholds of both channels.
            if (any_fast_) {
                const L fast = band_.pass(kept, first, now);
                store(fast, &fast_[first]);
                above_fast |= set_bits(abs(fast) > load<L>(&model.fast[first]) + extra) << first;
            }
        }
        over_ = above;
        over_fast_ = above_fast;
        const bool moving = any(fast_motion);
        if (moving) {
            if (resting_) motion_begin_ = t;
            resting_ = false;
            last_motion_ = t;
        } else if (t - last_motion_ >= settings_.rest_time) {
            resting_ = true;
        }
        const bool armed = resting_ || t - motion_begin_ >= settings_.arming_delay;
        const bool over = (over_ | over_fast_) != 0;
        masked_ = !armed && over;
        const bool stood = state_ == DetectorState::alarm;
        over_armed_ = armed && over;
        if (!stood) state_ = armed ? DetectorState::monitoring : DetectorState::arming;
        // After ticks without a residual the time below the thresholds starts again.
        if (!has_residual_) below_since_ = t;
        has_residual_ = true;
        if (!over_armed_) {
            event_over_ = event_over_ || t - below_since_ >= settings_.event_pause;
            return false;
        }
        const bool begins = !stood || event_over_;
        state_ = DetectorState::alarm;
        below_since_ = t;
        event_over_ = false;
        return begins;
    }

    /// Ends the alarm.
    void acknowledge() noexcept {
        if (state_ == DetectorState::alarm) state_ = DetectorState::monitoring;
    }
    /// Restarts the filter after a time without residuals.
    void interrupt() noexcept {
        band_.reset();
        skip();
    }
    /// A tick without a residual: it does not count as below the thresholds.
    void skip() noexcept { has_residual_ = false; }
    void reset() noexcept {
        interrupt();
        resting_ = true;
        last_motion_ = -std::numeric_limits<double>::infinity();
        state_ = DetectorState::monitoring;
        over_ = over_fast_ = 0;
    }

    DetectorState state() const noexcept { return state_; }
    /// Joints over their thresholds in the last tick, joint j as bit j: of the residual, and of the band-pass channel.
    std::uint32_t over() const noexcept { return over_; }
    std::uint32_t over_fast() const noexcept { return over_fast_; }
    /// Over some threshold in the last tick, and armed: the event continues.
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
    bool any_fast_ = false, resting_ = true, masked_ = false, has_residual_ = false, over_armed_ = false;
    bool event_over_ = false;  // no residual was over a threshold for event_pause
    double below_since_ = 0;   // all residuals are below their thresholds since then [s]
    double motion_begin_ = 0, last_motion_ = -std::numeric_limits<double>::infinity();
    std::uint32_t over_ = 0, over_fast_ = 0;
    std::array<double, max_joints> threshold_{}, fast_{}, inverse_rest_speed_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
