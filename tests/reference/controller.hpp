// The position controller.
#pragma once

#include <algorithm>

#include "kinematics.hpp"
#include "pseudo_inverse.hpp"

namespace reference {

struct State {
    PerJoint position{};
    PerJoint velocity{};
};

// The joint velocities that give the tip the velocity `tip_velocity`: of all that do, the smallest ones. The
// tip's angular velocity is zero (pose) or free (position). Held joints get zero.
PerJoint desired_joint_velocity(const Problem& problem, const PerJoint& position, const Vec3& tip_velocity) {
    Frames frames;
    forward_kinematics(problem, position, frames);
    const int last = problem.joint_count - 1;
    const Vec3 tip = point_on_link(frames, last, problem.tip);

    Matrix jacobian;
    jacobian.rows = problem.task == kPose ? 6 : 3;
    int joint_of_column[kMaxJoints];
    for (int j = 0; j < problem.joint_count; ++j) {
        if (problem.held[j]) continue;
        const JacobianColumn column = jacobian_column(problem, frames, j, last, tip);
        for (int r = 0; r < 3; ++r) jacobian.at[r][jacobian.columns] = column.linear[r];
        if (problem.task == kPose) {
            for (int r = 0; r < 3; ++r) jacobian.at[3 + r][jacobian.columns] = column.angular[r];
        }
        joint_of_column[jacobian.columns++] = j;
    }

    Matrix inverse;
    pseudo_inverse(jacobian, problem.singular_tolerance, problem.damping, inverse);
    PerJoint desired{};
    for (int c = 0; c < jacobian.columns; ++c) {
        double sum = 0;
        for (int r = 0; r < 3; ++r) sum += inverse.at[c][r] * tip_velocity[r];
        desired[joint_of_column[c]] = sum;
    }

    // A joint too fast slows all of them by the same ratio, so the tip keeps its direction.
    double ratio = 1;
    for (int j = 0; j < problem.joint_count; ++j) {
        const double speed = std::fabs(desired[j]);
        if (speed > problem.max_speed[j]) ratio = std::min(ratio, problem.max_speed[j] / speed);
    }
    if (ratio < 1) {
        for (int j = 0; j < problem.joint_count; ++j) desired[j] *= ratio;
    }
    return desired;
}

// One controller sub-step of length h. The joint that would have to accelerate hardest gets its limit, the
// others are scaled with it.
inline void controller_substep(const Problem& problem, const Vec3& tip_velocity, double h, State& state) {
    const PerJoint desired = desired_joint_velocity(problem, state.position, tip_velocity);
    PerJoint acceleration{};
    double ratio = 1;
    for (int j = 0; j < problem.joint_count; ++j) {
        acceleration[j] = (desired[j] - state.velocity[j]) / h;
        if (acceleration[j] != 0) {
            ratio = std::min(ratio, problem.max_acceleration[j] / std::fabs(acceleration[j]));
        }
    }
    for (int j = 0; j < problem.joint_count; ++j) {
        // With nothing to scale the desired velocity is taken as it is, free of rounding.
        state.velocity[j] = ratio < 1 ? state.velocity[j] + ratio * acceleration[j] * h : desired[j];
        state.position[j] += state.velocity[j] * h;
    }
}

}  // namespace reference
