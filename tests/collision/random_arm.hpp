// General arms whose joints may not accelerate at will.
#pragma once

#include <limits>

#include "bumpstop/collision/motion/line_motion.hpp"
#include "model/random_chain.hpp"

namespace random_arm {

using namespace bumpstop;

using Arm = CollisionSetup;

inline Arm make(int dof, const std::vector<int>& sliding, int held) {
    std::vector<JointSpec> joints(static_cast<std::size_t>(dof));
    for (JointSpec& joint : joints) {
        for (double& d : joint.origin) d = checks::uniform(-0.5, 0.5);
        joint.axis = random_chain::random_unit();
    }
    for (int j : sliding) joints[std::size_t(j)].prismatic = true;
    Arm arm;
    arm.chain = Chain(joints);
    arm.motion.tip = link_point(arm.chain, dof - 1, {0.05, -0.02, 0.1});
    for (int j = 0; j < dof; ++j) {
        if (j != held) arm.motion.free_joint[std::size_t(arm.motion.free_count++)] = j;
        arm.motion.acceleration_limit[std::size_t(j)] = checks::uniform(2, 8);
        arm.motion.velocity_limit[std::size_t(j)] = j % 3 == 0 ? 1.0 : std::numeric_limits<double>::infinity();
        arm.motion.lower[std::size_t(j)] = -4;
        arm.motion.upper[std::size_t(j)] = 4;
    }
    return arm;
}

}  // namespace random_arm
