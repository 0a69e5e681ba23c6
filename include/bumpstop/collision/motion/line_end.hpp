/// @file
/// Where an arm cannot follow its line any more, at a joint limit or a singularity: it brakes.
#pragma once

#include "bumpstop/collision/motion/brake_profile.hpp"
#include "bumpstop/collision/motion/line_path.hpp"
#include "bumpstop/collision/motion/reaction_job.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace detail {

/// The line ends with the last step written, where the joints are at `q` and move at `qd`, both by joint: from there the arm
/// brakes by its law of deceleration, as in a reaction that stops, until it stands. No tick follows, and no reaction begins
/// that has not begun: more latency cannot let an arm stop at once.
/// `met_step`: in which the limit or the singularity is met. One met after the end of the motion, while the line goes on for reactions
/// alone, is not what ends the motion.
inline void cut_line(const CollisionSetup& setup, PathEnd why, int met_step, const double* q, const double* qd,
                     LinePath& path) {
    const Chain& chain = setup.chain;
    const MotionSettings& motion = setup.motion;
    path.cut_step = int(path.s.size()) - 1;
    if (path.end == PathEnd::motion_end && met_step <= setup.timing.steps) path.end = why;
    const int n = motion.free_count;
    double there[max_joints], rate[max_joints] = {};  // by joint, and by free joint
    std::copy_n(q, chain.dof, there);
    for (int f = 0; f < n; ++f) rate[f] = qd[motion.free_joint[f]];
    const BrakeProfile profile = brake_profile(chain, motion, there, rate, false);
    const int longest = max_reaction_steps(profile.stop_time, path.s.size(), motion.step, motion.substeps);
    JointAngles<double> angle;
    Posture<double> posture;
    double substep = 0;
    for (int i = 0; i < longest && std::any_of(rate, rate + n, [](double r) { return r != 0; }); ++i) {
        for (int sub = 0; sub < motion.substeps; ++sub, ++substep) {
            double load[max_joints], most = 0;  // sub-steps to standstill
            for (int f = 0; f < n; ++f) {
                const int j = motion.free_joint[f];
                load[f] =
                    std::fabs(rate[f]) / (motion.acceleration_limit[j] * motion.substep() * profile.of(f, substep));
                most = std::max(most, load[f]);
            }
            for (int f = 0; f < n; ++f) {
                const double left = motion.deceleration.independent ? load[f] : most;
                rate[f] = left <= 1 ? 0 : rate[f] * (1 - 1 / left);
                there[motion.free_joint[f]] += motion.substep() * rate[f];
            }
        }
        angle.set(chain, there);
        forward_kinematics(chain, there, angle, posture);
        path.braking.push_back(
            dot(posture.position(setup.contact.point) - point3<double>(path.start), point3<double>(path.normal)));
    }
}

}  // namespace detail

}  // namespace bumpstop::inline BUMPSTOP_TARGET
