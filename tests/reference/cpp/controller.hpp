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

// A stop, told from its beginning: which sub-step is next, and how fast the joints were.
struct Stop {
    bool begun = false;
    std::int64_t substep = 0;
    PerJoint velocity{};
};

// The time after which an arm stands whose stop goes by the clock or by a brake that bites late.
inline double time_of_stop(const Problem& problem, const PerJoint& velocity) {
    if (problem.deceleration == kFixedTime) return problem.stopping_time;
    double slowest = 0;
    for (int j = 0; j < problem.joint_count; ++j) {
        slowest = std::max(slowest, std::fabs(velocity[j]) / problem.max_acceleration[j]);
    }
    // The brake's area under a ramp, a triangle, and a rectangle after it make up the speed.
    const double triangle = problem.brake_time / 2;
    return slowest > triangle ? slowest + triangle : std::sqrt(2 * slowest * problem.brake_time);
}

// As controller_substep while an arm slows down by a law of its own; `goes_back` once it stands.
inline void braking_substep(const Problem& problem, const Vec3& tip_velocity, double h, bool goes_back, Stop& stop,
                            State& state) {
    if (!stop.begun) {
        stop.begun = true;
        stop.substep = 0;
        stop.velocity = state.velocity;
    }
    const std::int64_t n = stop.substep++;
    const double over = time_of_stop(problem, stop.velocity) / h;
    // A brake that bites late is released as late; a stop by the clock ends, and the limits hold again.
    if (goes_back && problem.deceleration == kFixedTime && !(static_cast<double>(n) < over)) {
        controller_substep(problem, tip_velocity, h, state);
        return;
    }
    if (problem.deceleration == kFixedTime && !goes_back) {
        // The rates are known beforehand.
        const double left = std::max(0.0, 1 - static_cast<double>(n + 1) / over);
        for (int j = 0; j < problem.joint_count; ++j) {
            state.velocity[j] = left * stop.velocity[j];
            state.position[j] += state.velocity[j] * h;
        }
        return;
    }
    Problem slowed = problem;
    if (problem.deceleration == kFixedTime) {
        // All limits in one proportion, such that the joint that is worst off stands in that time.
        double worst = 0;
        for (int j = 0; j < problem.joint_count; ++j) {
            worst = std::max(worst, std::fabs(stop.velocity[j]) / problem.max_acceleration[j]);
        }
        if (worst > 0) {
            for (int j = 0; j < problem.joint_count; ++j) slowed.max_acceleration[j] *= worst / problem.stopping_time;
        }
    } else if (problem.deceleration == kLateBrake) {
        const double middle = (static_cast<double>(n) + 0.5) * h;
        if (middle < problem.brake_time) {
            for (int j = 0; j < problem.joint_count; ++j) slowed.max_acceleration[j] *= middle / problem.brake_time;
        }
    }
    if (!problem.uncoordinated) {
        controller_substep(slowed, tip_velocity, h, state);
        return;
    }
    for (int j = 0; j < problem.joint_count; ++j) {
        const double less = std::max(0.0, std::fabs(state.velocity[j]) - slowed.max_acceleration[j] * h);
        state.velocity[j] = std::copysign(less, state.velocity[j]);
        state.position[j] += state.velocity[j] * h;
    }
}

}  // namespace reference
