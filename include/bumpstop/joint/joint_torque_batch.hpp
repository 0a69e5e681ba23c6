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
    const double friction = abs(JointTorqueLaw<double>(p).sample(current, p.rest_speed).friction);
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
            Group& g = group_[j / native_lanes];
            const int lane = j % native_lanes;
            g.law.set(lane, joints[j]);
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
            const auto sample = group.law.sample(load<L>(current + first), load<L>(qd + first));
            const L qdd_of_group = load<L>(qdd + first);
            store(group.law.torque(sample, qdd_of_group, group.direction), tau + first);
            if (sd != nullptr) store(standard_error(group, sample, qdd_of_group), sd + first);
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

    struct Group {
        JointTorqueLaw<L> law;
        L direction = 0.0;
        JointTorqueErrorsOf<L> errors;
    };

    static L standard_error(const Group& g, const JointTorqueLaw<L>::Sample& s, L qdd) noexcept {
        const JointTorqueLaw<L>& law = g.law;
        const JointTorqueErrorsOf<L>& e = g.errors;
        const L slope = 2.0 * s.bend + law.B, through = slope * s.sign;
        // In the load-dependent map A has the factor -sgn(qd).
        const L by_A =
            select(law.odd > L(0.0), abs(s.inside), -(s.sign * s.inside)) * (2.0 * s.joint_current - s.inside);
        L variance = square(by_A * e.A) + square(s.joint_current * e.B) + square(slope * e.friction) +
                     square(slope * s.qd * e.viscous) + square(through * abs(s.current) * e.load) +
                     square(s.at_rest * g.direction * e.hysteresis) + square(qdd * e.inertia);
        if (law.any_power) {
            const L log_speed = s.log_speed + 9.210340371976183;  // ln |qd|
            variance += select(
                law.power > L(0.0),
                square(through * s.power * law.unit_scale * e.D) + square(through * s.magnitude * log_speed * e.F),
                L(0.0));
        }
        if (law.any_stribeck) {
            const L by_width = through * law.stribeck * s.bell * (2.0 * s.width * s.width) * law.inverse_stribeck_speed;
            variance += square(through * e.coulomb) + square(through * s.bell * e.stribeck) +
                        square(by_width * e.stribeck_speed);
        }
        return sqrt(variance);
    }
    static L square(L x) { return x * x; }

    int joints_ = 0;
    std::array<Group, max_groups> group_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
