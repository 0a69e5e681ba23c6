/// @file
/// The torques of all joints of an arm at once with their standard errors: joint_torque with one joint per lane.
#pragma once

#include <array>
#include <span>

#include "bumpstop/joint/joint_torque.hpp"
#include "bumpstop/model/chain.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Standard errors of JointTorqueParameters, in their units; 0: unknown, or none. T: a joint, or lanes with one each.
template <class T>
struct JointTorqueErrorsOf {
    T A = 0.0, B = 0.0, D = 0.0, F = 0.0, coulomb = 0.0, viscous = 0.0, stribeck = 0.0, stribeck_speed = 0.0;
    T load = 0.0, hysteresis = 0.0, inertia = 0.0;
    T friction = 0.0;  ///< standard deviation of measured friction about the law [current]

    /// All of them, in the order of the detector's file.
    std::array<T*, 12> all() noexcept {
        return {&A,    &B,          &D,       &F,       &coulomb, &viscous, &stribeck, &stribeck_speed,
                &load, &hysteresis, &inertia, &friction};
    }
};
using JointTorqueErrors = JointTorqueErrorsOf<double>;

/// Dead zone at standstill [Nm or N]: external torque of either sign that static friction holds, so that the current
/// does not show it. It is the friction at rest_speed under `current`, times the slope of the map, plus hysteresis.
inline double dead_zone(const JointTorqueParameters& p, double current) noexcept {
    const double friction = abs(friction_current(p, current, p.rest_speed));
    const double inside = max(p.current_low, min(p.current_high, current));
    const double slope = p.map == CurrentMap::odd ? p.B + 2 * p.A * abs(inside) : p.B;
    return slope * friction + abs(p.hysteresis);
}

/// Joint models of an arm, with their hysteresis states. Nothing is allocated.
class JointTorqueBank {
  public:
    JointTorqueBank() = default;
    JointTorqueBank(std::span<const JointTorqueParameters> joints, std::span<const JointTorqueErrors> errors) noexcept
        : joints_(int(joints.size())) {
        for (int j = 0; j < joints_; ++j) {
            const JointTorqueParameters& p = joints[j];
            Group& g = group_[j / native_lanes];
            const int lane = j % native_lanes;
            const bool power = p.friction == FrictionLaw::power;
            any_power_ = any_power_ || power;
            any_stribeck_ = any_stribeck_ || !power;
            set_lane(g.odd, lane, p.map == CurrentMap::odd ? 1 : 0);
            set_lane(g.power, lane, power ? 1 : 0);
            set_lane(g.A, lane, p.A);
            set_lane(g.B, lane, p.B);
            set_lane(g.scale, lane, power ? p.D * std::pow(top, p.F) : 0);
            set_lane(g.unit_scale, lane, power ? std::pow(top, p.F) : 0);
            set_lane(g.F, lane, power ? p.F : 0);
            set_lane(g.coulomb, lane, p.coulomb);
            set_lane(g.viscous, lane, p.viscous);
            set_lane(g.stribeck, lane, p.stribeck);
            set_lane(g.inverse_stribeck_speed, lane, 1 / p.stribeck_speed);
            set_lane(g.load, lane, p.load);
            set_lane(g.hysteresis, lane, p.hysteresis);
            set_lane(g.inertia, lane, p.inertia);
            set_lane(g.rest, lane, p.rest_speed);
            set_lane(g.inverse_rest, lane, 1 / p.rest_speed);
            set_lane(g.low, lane, p.current_low);
            set_lane(g.high, lane, p.current_high);
            if (errors.empty()) continue;
            JointTorqueErrors own = errors[j];
            for (std::size_t k = 0; k < own.all().size(); ++k) set_lane(*g.errors.all()[k], lane, *own.all()[k]);
        }
    }

    /// Torques [Nm or N] as joint_torque gives them and, unless `sd` is null, their standard errors, propagated from
    /// those of the parameters as independent: sd^2 = sum over parameters of (dtau/dp se_p)^2. Arrays of max_joints
    /// numbers; those beyond the last joint are ignored.
    [[gnu::flatten]] void torque(const double* current, const double* qd, const double* qdd, double* tau,
                                 double* sd) noexcept {
        for (int first = 0; first < joints_; first += native_lanes) {
            Group& group = group_[first / native_lanes];
            Motion motion{load<L>(current + first), load<L>(qd + first), load<L>(qdd + first)};
            if (any_power_) {
                motion.log_speed = log(min(L(1.0), max(abs(motion.qd), group.rest) * (1 / top)));
                motion.power = exp_minus(-(motion.log_speed * group.F), L(0.0));
            }
            if (any_stribeck_) {
                const L u = reduced_speed(group, motion.qd);
                motion.bell = exp_minus(u * u, L(0.0));
            }
            if (sd != nullptr) {
                torque_of_group<true>(group, motion, tau + first, sd + first);
            } else {
                torque_of_group<false>(group, motion, tau + first, nullptr);
            }
        }
    }

    /// Resets the hysteresis of every joint.
    void reset() noexcept {
        for (Group& g : group_) g.direction = 0.0;
    }
    /// sgn(qd_H) of joint j; 0: no motion yet.
    double direction(int j) const noexcept { return lane_of(group_[j / native_lanes].direction, j % native_lanes); }

  private:
    using L = Lanes<native_lanes>;
    static constexpr int max_groups = max_joints / native_lanes;
    static constexpr double top = 1e4;  // as in friction_current

    using Errors = JointTorqueErrorsOf<L>;
    struct Group {
        L odd = 1.0, power = 0.0, A = 0.0, B = 0.0, scale = 0.0, unit_scale = 0.0, F = 0.0;
        L coulomb = 0.0, viscous = 0.0, stribeck = 0.0, inverse_stribeck_speed = 1.0, load = 0.0;
        L hysteresis = 0.0, inertia = 0.0, rest = 1.0, inverse_rest = 1.0;
        L low = -std::numeric_limits<double>::infinity(), high = std::numeric_limits<double>::infinity();
        L direction = 0.0;
        Errors errors;
    };

    /// A sample of a group, with functions of its speed: ln(|qd| / top), (|qd| / top)^F and exp(-(qd / w)^2); zero where
    /// no joint has that friction law.
    struct Motion {
        L current, qd, qdd, log_speed = 0.0, power = 0.0, bell = 0.0;
    };

    static L reduced_speed(const Group& g, L qd) noexcept { return min(L(26.0), abs(qd) * g.inverse_stribeck_speed); }

    template <bool WithErrors>
    void torque_of_group(Group& g, const Motion& motion, double* tau, double* sd) const noexcept {
        const L zero = 0.0, unit = 1.0, current = motion.current, qd = motion.qd, qdd = motion.qdd;
        const L speed = abs(qd), amount = abs(current);
        const L sign = max(-unit, min(unit, qd * g.inverse_rest));
        const L power = motion.power * g.scale, stribeck = motion.bell * g.stribeck + g.coulomb;
        const L magnitude = select(g.power > zero, power, stribeck);
        const L friction = sign * (magnitude + amount * g.load) + qd * g.viscous;
        const L joint_current = current - friction;
        const L inside = max(g.low, min(g.high, joint_current));
        const L bend = select(g.odd > zero, abs(inside) * g.A, -(sign * inside * g.A));
        const L torque = inside * (bend + g.B) + (joint_current - inside) * (2.0 * bend + g.B);
        const L rest = max(zero, min(unit, 2.0 - speed * g.inverse_rest));
        g.direction = select(rest > zero, g.direction, select(qd > zero, unit, -unit));
        store(torque - qdd * g.inertia - g.direction * rest * g.hysteresis, tau);
        if constexpr (WithErrors) {
            const Errors& e = g.errors;
            const L slope = 2.0 * bend + g.B, through = slope * sign;
            // In the load-dependent map A has the factor -sgn(qd).
            const L by_A = select(g.odd > zero, abs(inside), -(sign * inside)) * (2.0 * joint_current - inside);
            const L unit_power = motion.power * g.unit_scale;
            const L log_speed = motion.log_speed + 9.210340371976183;  // ln |qd|
            L variance = square(by_A * e.A) + square(joint_current * e.B) + square(slope * e.friction) +
                         square(slope * qd * e.viscous) + square(through * amount * e.load) +
                         square(rest * g.direction * e.hysteresis) + square(qdd * e.inertia);
            if (any_power_)
                variance +=
                    select(g.power > zero,
                           square(through * unit_power * e.D) + square(through * magnitude * log_speed * e.F), zero);
            if (any_stribeck_) {
                const L bell = motion.bell, u = reduced_speed(g, qd);
                const L by_width = through * g.stribeck * bell * (2.0 * u * u) * g.inverse_stribeck_speed;
                variance += square(through * e.coulomb) + square(through * bell * e.stribeck) +
                            square(by_width * e.stribeck_speed);
            }
            store(sqrt(variance), sd);
        }
    }
    static L square(L x) { return x * x; }

    int joints_ = 0;
    bool any_power_ = false, any_stribeck_ = false;
    std::array<Group, max_groups> group_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
