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

/// The model in the form that samples go through. T: a joint; or lanes, of a joint each, or of samples of one joint.
template <class T>
struct JointTorqueLaw {
    static constexpr double top = 1e4;  ///< no joint is as fast [rad/s]

    T odd = 1.0, power = 0.0;  ///< 1: that map, that friction law; 0: the other
    T A = 0.0, B = 0.0, F = 0.0, coulomb = 0.0, viscous = 0.0, stribeck = 0.0, load = 0.0, hysteresis = 0.0;
    T inertia = 0.0, rest_speed = 1.0, inverse_rest_speed = 1.0, inverse_stribeck_speed = 1.0;
    T scale = 0.0, unit_scale = 0.0;  ///< D top^F and top^F
    T low = -std::numeric_limits<double>::infinity(), high = std::numeric_limits<double>::infinity();
    T speed_high = std::numeric_limits<double>::infinity();
    bool any_power = false, any_stribeck = false;  ///< some joint has that friction law

    JointTorqueLaw() = default;
    explicit JointTorqueLaw(const JointTorqueParameters& p) noexcept {
        for (int lane = 0; lane < Scalar<T>::lanes; ++lane) set(lane, p);
    }
    void set(int lane, const JointTorqueParameters& p) noexcept {
        const bool by_power = p.friction == FrictionLaw::power;
        const double to_top = by_power ? std::pow(top, p.F) : 0;
        any_power = any_power || by_power;
        any_stribeck = any_stribeck || !by_power;
        set_lane(odd, lane, p.map == CurrentMap::odd ? 1 : 0);
        set_lane(power, lane, by_power ? 1 : 0);
        set_lane(A, lane, p.A);
        set_lane(B, lane, p.B);
        set_lane(F, lane, by_power ? p.F : 0);
        set_lane(coulomb, lane, p.coulomb);
        set_lane(viscous, lane, p.viscous);
        set_lane(stribeck, lane, p.stribeck);
        set_lane(load, lane, p.load);
        set_lane(hysteresis, lane, p.hysteresis);
        set_lane(inertia, lane, p.inertia);
        set_lane(rest_speed, lane, p.rest_speed);
        set_lane(inverse_rest_speed, lane, 1 / p.rest_speed);
        set_lane(inverse_stribeck_speed, lane, 1 / p.stribeck_speed);
        set_lane(scale, lane, by_power ? p.D * to_top : 0);
        set_lane(unit_scale, lane, to_top);
        set_lane(low, lane, p.current_low);
        set_lane(high, lane, p.current_high);
        set_lane(speed_high, lane, p.speed_high);
    }

    /// A sample on its way from the current to the torque.
    struct Sample {
        T current, qd;
        T sign;       ///< of qd, from -1 to 1
        T at_rest;    ///< share of the hysteresis that shows, from 0 to 1
        T log_speed;  ///< ln(|qd| / top), zero without a power law
        T power;      ///< (|qd| / top)^F, zero without a power law
        T width;      ///< |qd| / stribeck_speed
        T bell;       ///< exp(-width^2), zero without a Stribeck law
        T magnitude;  ///< of friction but for load and viscous friction [current]
        T friction;   ///< positive for motion along +q [current]
        T joint_current;
        T inside;  ///< joint_current, or where the fitted range ends that it is beyond
        T bend;    ///< of the map: torque is inside (bend + B), with the slope 2 bend + B
    };
    Sample sample(T current, T qd) const noexcept {
        Sample s{};
        s.current = current;
        s.qd = qd;
        const T speed = abs(qd);
        s.sign = max(T(-1.0), min(T(1.0), qd * inverse_rest_speed));
        s.at_rest = max(T(0.0), min(T(1.0), 2.0 - speed * inverse_rest_speed));
        s.width = min(T(26.0), speed * inverse_stribeck_speed);
        if (any_power) {
            // D |qd|^F as D top^F exp(-F ln(top / |qd|)), with an exponent <= 0.
            s.log_speed = log(min(T(1.0), max(speed, rest_speed) * (1 / top)));
            s.power = exp_minus(-(s.log_speed * F), T(0.0));
        }
        if (any_stribeck) s.bell = exp_minus(s.width * s.width, T(0.0));
        s.magnitude = select(power > T(0.0), s.power * scale, s.bell * stribeck + coulomb);
        s.friction = s.sign * (s.magnitude + abs(current) * load) + qd * viscous;
        s.joint_current = current - s.friction;
        s.inside = max(low, min(high, s.joint_current));
        s.bend = select(odd > T(0.0), abs(s.inside) * A, -(s.sign * s.inside * A));
        return s;
    }
    /// Torque of the joint [Nm]; brings the direction of the last motion forward.
    ///
    /// In eq 2.23 the hysteresis jumps at rest_speed. Here it fades linearly from there to twice that speed, and the
    /// direction is stored only above, where it has no effect: so the torque is continuous in time for any motion.
    T torque(const Sample& s, T qdd, T& direction) const noexcept {
        direction = select(s.at_rest > T(0.0), direction, select(s.qd > T(0.0), T(1.0), T(-1.0)));
        return s.inside * (s.bend + B) + (s.joint_current - s.inside) * (2.0 * s.bend + B) - qdd * inertia -
               direction * s.at_rest * hysteresis;
    }
};

/// Torque of the joint [Nm]; updates the state by this sample.
template <class T>
T joint_torque(const JointTorqueLaw<T>& law, T current, T qd, T qdd, JointTorqueState<T>& state) noexcept {
    const auto s = law.sample(current, qd);
    state.outside_current += select((s.joint_current < law.low) | (s.joint_current > law.high), T(1.0), T(0.0));
    state.outside_speed += select(abs(qd) > law.speed_high, T(1.0), T(0.0));
    return law.torque(s, qdd, state.direction);
}
template <class T>
T joint_torque(const JointTorqueParameters& p, T current, T qd, T qdd, JointTorqueState<T>& state) noexcept {
    return joint_torque(JointTorqueLaw<T>(p), current, qd, qdd, state);
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
