/// @file
/// Where an arm cannot follow its line any more, at a joint limit or a singularity: it brakes.
#pragma once

#include "bumpstop/collision/motion/brake_profile.hpp"
#include "bumpstop/collision/motion/line_path.hpp"
#include "bumpstop/collision/motion/reaction_job.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace detail {

/// Ends a path at its last recorded step, where the joints have positions `q` and rates `qd`, both by joint. From there
/// the arm brakes to standstill by its deceleration law, as in a reaction that stops. No tick follows, and no reaction
/// to an earlier tick begins any more: a longer latency must not let an arm stop at once.
/// `met_step`: the step in which the limit or the singularity is met. Where that is after the end of the motion, in the
/// part of the line that only reactions need, it is not what ends the motion.
inline void cut_line(const CollisionSetup& setup, PathEnd why, int met_step, const double* q, const double* qd,
                     LinePath& path) {
    const Chain& chain = setup.chain;
    const MotionSettings& motion = setup.motion;
    path.cut_step = int(path.s.size()) - 1;
    if (path.end == PathEnd::motion_end && met_step <= setup.timing.steps) path.end = why;
    const int n = motion.free_count;
    double rate[max_joints];
    for (int f = 0; f < n; ++f) rate[f] = qd[motion.free_joint[f]];
    const BrakeProfile profile = brake_profile(chain, motion, q, rate, false);
    const int longest = max_reaction_steps(profile.stop_time, path.s.size(), motion.step, motion.substeps);
    const InverseMaxRateChange full(motion);
    static constexpr double standstill[max_joints] = {};
    ArmState<double> state;
    std::copy_n(q, chain.dof, state.q);
    std::copy_n(qd, chain.dof, state.qd);
    double substep = 0;
    bool at_rest = std::all_of(rate, rate + n, [](double r) { return r == 0; });
    while (!at_rest && int(path.braking.size()) < longest) {
        for (int sub = 0; sub < motion.substeps; ++sub, ++substep) {
            double change[max_joints] = {}, saturation[max_joints], tightened[max_joints];
            for (int f = 0; f < n; ++f) tightened[f] = 1 / profile.of(f, substep);
            at_rest = limited_change(motion, full, standstill, state, change, saturation, tightened,
                                     motion.deceleration.independent);
            for (int f = 0; f < n; ++f) {
                const int j = motion.free_joint[f];
                state.qd[j] += change[f];
                state.q[j] += motion.substep() * state.qd[j];
            }
        }
        Posture<double> posture;
        state.refresh_angles(chain);
        forward_kinematics(chain, state.q, state.angle, posture);
        path.braking.push_back(
            dot(posture.position(setup.contact.point) - point3<double>(path.start), point3<double>(path.normal)));
    }
}

}  // namespace detail

}  // namespace bumpstop::inline BUMPSTOP_TARGET
