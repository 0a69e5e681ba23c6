/// @file
/// Per-joint thresholds on a residual with white Gaussian noise.
#pragma once

#include "bumpstop/math/functions.hpp"
#include "bumpstop/model/chain.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The noiseless residual of a joint from tick to tick [Nm or N]; a contact begins with zeros.
template <class T>
struct NoiselessResidual {
    T value = 0.0;
    T torque = 0.0;  ///< of the contact at the same tick
};

/// A tick raises an alarm where any joint has |residual| > threshold. The residual is estimated minus predicted motor
/// torque, so a force -n F on the arm raises it by (J_v' n) F.
struct GaussianThresholds {
    int joints = 0;     ///< number of joints added
    int monitored = 0;  ///< number of those with a finite threshold
    std::array<int, max_joints> joint{};
    std::array<double, max_joints> threshold{};               ///< Nm or N, by monitored joint
    std::array<double, max_joints> sd{}, mean{};              ///< of the noise, by monitored joint [Nm or N]
    std::array<double, max_joints> scale{};                   ///< 1 / (sqrt 2 sd) [1/Nm or 1/N], large for no noise
    std::array<double, max_joints> noise_sd{}, noise_mean{};  ///< by joint, monitored or not [Nm or N]
    double arming_delay = 0;                                  ///< ticks earlier than this never alarm [s]
    double correlation = 0;  ///< of the noise from tick to tick; sd is the stationary standard deviation
    /// Coefficient of the observer's first-order filter: share of the last residual that a tick keeps; 0: none.
    double filter = 0;

    /// Whether the detector is armed at a time since the beginning of the motion [s].
    bool armed(double time) const { return time >= arming_delay - 1e-12; }
    /// Residuals of different ticks are correlated.
    bool correlated_noise() const { return correlation != 0 || filter != 0; }

    /// Advances a residual to the next tick, at which the contact torque is `torque`. An observer sees the mean torque
    /// between two ticks, as the trapezoidal rule of MomentumObserver has it.
    template <class T>
    T advance(NoiselessResidual<T>& own, T torque) const {
        if (filter == 0) return own.value = torque;
        const T mean = 0.5 * (own.torque + torque);
        own.torque = torque;
        return own.value = mean + filter * (own.value - mean);
    }

    /// Adds the next joint, counted from the base: its threshold, infinite where it is not monitored, and the standard
    /// deviation and mean of its noise [Nm or N].
    void add_joint(double limit, double joint_sd, double joint_mean) {
        const int j = joints++;
        noise_sd[j] = joint_sd;
        noise_mean[j] = joint_mean;
        if (!std::isfinite(limit)) return;
        joint[monitored] = j;
        threshold[monitored] = limit;
        sd[monitored] = joint_sd;
        mean[monitored] = joint_mean;
        // Without noise erfc must be a step. 1e150 makes it one; its square cannot overflow, as erfc clamps x.
        scale[monitored] = joint_sd > 0 ? 0.70710678118654752440 / joint_sd : 1e150;
        ++monitored;
    }
};

/// Probability of an alarm in one tick, and its complement; where one is small it is not computed by subtraction.
template <class T>
struct AlarmProbability {
    T alarm, no_alarm;
};

/// P(|r| > threshold) of one monitored joint for the noiseless residual `r` (without the noise mean).
template <class T>
AlarmProbability<T> joint_alarm(const GaussianThresholds& detector, int w, T r) {
    const double threshold = detector.threshold[w], scale = detector.scale[w];
    const T centre = abs(r + detector.mean[w]);
    const T distance = threshold - centre;
    const T near = 0.5 * erfc(abs(distance) * scale);
    // The far tail is at most exp(-4 threshold centre scale^2) of the near one: e^-40 is below rounding.
    T far = 0.0;
    if (any(centre * (threshold * scale * scale) < T(10.0))) far = 0.5 * erfc((centre + threshold) * scale);
    const auto inside = distance > T(0.0);
    const T tails = near + far, body = near - far;
    return {select(inside, tails, 1.0 - body), select(inside, 1.0 - tails, body)};
}

/// P(any monitored joint alarms): q <- q + (1 - q) q_j has no cancellation, and the complements multiply.
/// `torque(w)` gives the noiseless residual of monitored joint w.
template <class T, class Torque>
AlarmProbability<T> any_alarm(const GaussianThresholds& detector, Torque torque) {
    AlarmProbability<T> total{T(0.0), T(1.0)};
    for (int w = 0; w < detector.monitored; ++w) {
        const AlarmProbability<T> one = joint_alarm(detector, w, T(torque(w)));
        total.alarm = total.alarm + total.no_alarm * one.alarm;
        total.no_alarm = total.no_alarm * one.no_alarm;
    }
    return total;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
