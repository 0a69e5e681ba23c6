/// @file
/// What most programs need: robots from files, and the distribution of a collision.
#pragma once

#include "bumpstop/collision/batch.hpp"
#include "bumpstop/collision/collision.hpp"
#include "bumpstop/model/robot_description.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The robot's tip moves along a line, with its orientation held by all joints, and hits; the arm reverses.
/// `acceleration_limit`: of every joint while it reacts [rad/s2 or m/s2].
inline CollisionSetup line_setup(const RobotDescription& robot, double acceleration_limit) {
    CollisionSetup setup;
    setup.chain = robot.chain();
    setup.motion.tip = setup.contact.point = robot.tip(setup.chain);
    setup.motion.free_count = setup.chain.dof;
    for (std::size_t j = 0; j < robot.joints.size(); ++j) {
        const RobotDescription::Joint& joint = robot.joints[j];
        setup.motion.free_joint[j] = int(j);
        setup.motion.acceleration_limit[j] = acceleration_limit;
        setup.motion.velocity_limit[j] = joint.velocity;
        setup.motion.lower[j] = joint.lower;
        setup.motion.upper[j] = joint.upper;
    }
    return setup;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
