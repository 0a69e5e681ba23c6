/// @file
/// Joint torque from motor current: friction, map, reflected inertia and hysteresis of one joint, sample by sample.
///
///   tau = f(i_j) - I qdd - T_H sgn(qd_H),   i_j = i - i_friction(qd)
///
/// after Schroeder 2013, eqs 2.18 to 2.30. Current, rates and torques are positive along the joint; tau acts from the
/// joint on the arm. Units: current in the model's own, rad/s, rad/s2, Nm. Nothing is allocated.
#pragma once

#include <limits>

#include "bumpstop/math/functions.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

enum class CurrentMap {
    odd,             // tau = B i_j + A i_j |i_j|
    load_dependent,  // tau = B i_j - sgn(qd) A i_j^2 (eq 2.29)
};

enum class FrictionLaw {
    power,     // sgn(qd) D |qd|^F (eq 2.27)
    stribeck,  // sgn(qd) (C + S exp(-(qd / w)^2)) + V qd
};

/// Model of one joint. sgn(qd) stands for a value that is linear from -1 to 1 between -rest_speed and rest_speed. The
/// power law is linear there, too, so the torque is continuous through zero rate.
struct JointTorqueParameters {
    CurrentMap map = CurrentMap::odd;
    FrictionLaw friction = FrictionLaw::power;
    double A = 0;               ///< Nm per unit of current squared
    double B = 0;               ///< Nm per unit of current
    double D = 0;               ///< friction at 1 rad/s [current]
    double F = 0;               ///< exponent of the speed, 0 to 3
    double coulomb = 0;         ///< C [current]
    double viscous = 0;         ///< V [current s/rad]
    double stribeck = 0;        ///< S [current]: friction at rest minus C
    double stribeck_speed = 1;  ///< w [rad/s], above 0
    double load = 0;            ///< friction per current, sgn(qd) load |i|; 0 to below 1
    double hysteresis = 0;      ///< T_H [Nm]
    double inertia = 0;         ///< I, all inertia reflected to the joint [kg m2], not negative
    double rest_speed = 0.01;   ///< qd_thresh of eq 2.23 [rad/s], above 0
    /// Range of i_j that the map was fitted on; outside it is extrapolated by its tangent.
    double current_low = -std::numeric_limits<double>::infinity();
    double current_high = std::numeric_limits<double>::infinity();
    double speed_high = std::numeric_limits<double>::infinity();  ///< fastest |qd| of the fit [rad/s]
};

/// State of the hysteresis of a joint, and counts of samples outside the fitted ranges.
template <class T>
struct JointTorqueState {
    T direction = 0.0;        ///< sgn(qd_H), direction of the last motion; 0: none yet, so no hysteresis
    T outside_current = 0.0;  ///< samples
    T outside_speed = 0.0;    ///< samples
};

/// Friction current at the rate qd under the measured current; positive for motion along +q.
template <class T>
T friction_current(const JointTorqueParameters& p, T current, T qd) noexcept {
    const T speed = abs(qd);
    const T sign = max(T(-1.0), min(T(1.0), qd * (1.0 / p.rest_speed)));
    T magnitude;
    if (p.friction == FrictionLaw::power) {
        // D |qd|^F as D top^F exp(-F ln(top / |qd|)) with an exponent <= 0, as no joint is as fast as `top`.
        constexpr double top = 1e4;
        const T ratio = min(T(1.0), max(speed, T(p.rest_speed)) * (1 / top));
        magnitude = exp_minus(-(log(ratio) * p.F), T(0.0)) * (p.D * std::pow(top, p.F));
    } else {
        const T u = min(T(26.0), speed * (1.0 / p.stribeck_speed));
        magnitude = exp_minus(u * u, T(0.0)) * p.stribeck + p.coulomb;
    }
    return sign * (magnitude + abs(current) * p.load) + qd * p.viscous;
}

/// Torque of the current map for the current i_j, measured minus friction.
template <class T>
T mapped_torque(const JointTorqueParameters& p, T joint_current, T qd) noexcept {
    const T inside = max(T(p.current_low), min(T(p.current_high), joint_current));
    const T bend = p.map == CurrentMap::odd ? abs(inside) * p.A
                                            : -(max(T(-1.0), min(T(1.0), qd * (1.0 / p.rest_speed))) * inside * p.A);
    return inside * (bend + p.B) + (joint_current - inside) * (2.0 * bend + p.B);
}

/// Torque of the joint [Nm]; updates the state by this sample.
///
/// In eq 2.23 the hysteresis jumps at rest_speed. Here it fades linearly from there to twice that speed, and the
/// direction is stored only above, where it has no effect: so the torque is continuous in time for any motion.
template <class T>
T joint_torque(const JointTorqueParameters& p, T current, T qd, T qdd, JointTorqueState<T>& state) noexcept {
    const T speed = abs(qd);
    const T joint_current = current - friction_current(p, current, qd);
    const T torque = mapped_torque(p, joint_current, qd);
    const T rest = max(T(0.0), min(T(1.0), 2.0 - speed * (1.0 / p.rest_speed)));
    state.direction = select(rest > T(0.0), state.direction, select(qd > T(0.0), T(1.0), T(-1.0)));
    state.outside_current +=
        select((joint_current < T(p.current_low)) | (joint_current > T(p.current_high)), T(1.0), T(0.0));
    state.outside_speed += select(speed > T(p.speed_high), T(1.0), T(0.0));
    return torque - qdd * p.inertia - state.direction * rest * p.hysteresis;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
