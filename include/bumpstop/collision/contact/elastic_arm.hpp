/// @file
/// An arm with elastic gears in a pose.
#pragma once

#include <algorithm>

#include "bumpstop/collision/contact/arm_compliance.hpp"
#include "bumpstop/collision/contact/contact.hpp"
#include "bumpstop/collision/motion/line_path.hpp"
#include "bumpstop/model/dynamics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Joint rates per unit of the speed that they give to a point along a normal; zero where they give none.
inline std::array<double, max_joints> rate_per_speed(const Chain& chain, const Posture<double>& posture,
                                                     const LinkPoint& point, const Point3<double>& normal,
                                                     const double* qd) {
    std::array<double, max_joints> found{};
    const double speed = dot(point_velocity(chain, posture, point.link, posture.position(point), qd), normal);
    for (int j = 0; speed > 0 && j < chain.dof; ++j) found[std::size_t(j)] = qd[j] / speed;
    return found;
}

/// The arm at joint positions q, with J' n and the joint rates per unit of speed along the normal.
inline ElasticArm elastic_arm(const Chain& chain, const ArmCompliance& given, const double* q,
                              const double* torque_per_N, const double* rate_per_speed) {
    ElasticArm arm;
    arm.dof = chain.dof;
    JointAngles<double> angle{};
    for (int j = 0; j < chain.dof; ++j) angle.set(chain, j, q[j]);
    double mass[max_joints][max_joints];
    mass_matrix(chain, given.inertias, q, angle, mass);
    for (std::size_t j = 0; j < std::size_t(chain.dof); ++j) {
        mass[j][j] -= given.inertias.rotor[j];
        for (std::size_t i = 0; i < std::size_t(chain.dof); ++i) arm.mass[j * std::size_t(chain.dof) + i] = mass[j][i];
        const double rotor = given.rotor_inertia[j], stiffness = given.gear_stiffness[j];
        arm.rotor_inertia[j] = rotor;
        arm.gear_stiffness[j] = stiffness;
        arm.gear_damping[j] = 2 * given.gear_damping[j] * std::sqrt(stiffness / (1 / rotor + 1 / mass[j][j]));
        arm.velocity_gain[j] = given.servo_bandwidth[j] * (rotor + mass[j][j]);
        arm.position_gain[j] = given.servo_position_gain[j] * arm.velocity_gain[j];
        arm.feedforward[j] = given.acceleration_feedforward[j];
        arm.torque_per_N[j] = torque_per_N[j];
        arm.rate_per_speed[j] = rate_per_speed[j];
    }
    return arm;
}

/// The arm on a line, in the pose of the first tick at which it has come as far as `distance`, or of the last tick.
inline ElasticArm elastic_arm_on_line(const CollisionSetup& setup, const LinePath& path, double distance) {
    const MotionSettings& motion = setup.motion;
    const Timing& timing = setup.timing;
    int tick = 0;
    while (tick + 1 < path.ticks && path.at_tick(tick, timing.period) < distance) ++tick;
    double position[max_joints], qd[max_joints] = {}, torque_per_N[max_joints] = {};
    std::copy_n(path.q.begin(), setup.chain.dof, position);
    std::array<double, max_joints> rate{};
    // States are known where reactions to earlier ticks begin, between which the tick lies. After a start from rest the
    // pose is the first that moves.
    const int earliest = -LinePath::early_ticks(timing), last = path.last_with_reaction(path.ticks, timing);
    int early = path.last_with_reaction(std::max(earliest, tick - timing.latency / timing.period), timing);
    for (; early >= earliest && early <= last && std::all_of(rate.begin(), rate.end(), [](double r) { return r == 0; });
         ++early) {
        const int before = std::max(earliest, early - 1), from = LinePath::reaction_step(before, timing),
                  to = LinePath::reaction_step(early, timing), at = std::max(from, tick * timing.period + 1);
        const double part = at < to ? double(at - from) / (to - from) : 1.0;
        const double *state = path.state_at(before, timing), *next = path.state_at(early, timing);
        const auto between = [&](int i) { return state[i] + part * (next[i] - state[i]); };
        for (int f = 0; f < motion.free_count; ++f) {
            const int j = motion.free_joint[std::size_t(f)];
            position[j] = between(f);
            qd[j] = between(motion.free_count + f);
        }
        JointAngles<double> angle;
        Posture<double> posture;
        angle.set(setup.chain, position);
        forward_kinematics(setup.chain, position, angle, posture);
        rate = rate_per_speed(setup.chain, posture, setup.contact.point, point3<double>(path.normal), qd);
    }
    if (tick < path.ticks) std::copy_n(&path.torque_per_N[std::size_t(tick * path.dof)], path.dof, torque_per_N);
    return elastic_arm(setup.chain, *setup.arm, position, torque_per_N, rate.data());
}

/// Arm and body, linear about the pose at the median offset; none for a rigid arm and a clamped spring.
inline std::optional<ContactSystem> contact_system(const CollisionSetup& setup, const LinePath& path,
                                                   const Contact& contact) {
    if (!setup.arm) return contact.system();
    return ContactSystem(elastic_arm_on_line(setup, path, contact.offset.median()), contact.body);
}
/// Their propagator over a simulation step.
inline std::optional<ContactPropagator> contact_propagator(const CollisionSetup& setup, const LinePath& path,
                                                           const Contact& contact) {
    return propagator_of(contact_system(setup, path, contact), setup.motion.step);
}

/// How long the arm lags behind its reference, and oscillations in contact last [s].
inline double settling_time(const CollisionSetup& setup, const ContactSystem& system) {
    double slowest = 0;
    for (int j = 0; setup.arm && j < setup.chain.dof; ++j)
        slowest = std::max(slowest, 1 / std::max(setup.arm->servo_position_gain[std::size_t(j)], 1.0));
    return 2 * slowest + 4 * system.half_oscillation();
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
