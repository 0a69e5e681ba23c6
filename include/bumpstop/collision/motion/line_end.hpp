/// @file
/// Where an arm cannot follow its line any more, at a joint limit or a singularity: it brakes.
#pragma once

#include "bumpstop/collision/motion/brake_profile.hpp"
#include "bumpstop/collision/motion/line_path.hpp"
#include "bumpstop/collision/motion/reaction_job.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace detail {

/// The joints at `there`, at rates `qd(joint)`, slow down by their law sub-step by sub-step; `write()` after every step
/// until they stand.
template <class Rate, class Write>
void brake_by_law(const Chain& chain, const MotionSettings& motion, Rate qd, double* there, std::size_t path_steps,
                  Write write) {
    const int n = motion.free_count;
    double rate[max_joints] = {};
    for (int f = 0; f < n; ++f) rate[f] = qd(motion.free_joint[f]);
    const BrakeProfile profile = brake_profile(chain, motion, there, rate, false);
    const int longest = max_reaction_steps(profile.stop_time, path_steps, motion.step, motion.substeps);
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
        write();
    }
}

/// The line ends with the last step written, where the joints are at `q(joint)` and move at `qd(joint)`: from there the arm
/// brakes by its law of deceleration, as in a reaction that stops, until it stands. No tick follows, and no reaction begins
/// that has not begun: more latency cannot let an arm stop at once.
/// `met_step`: in which the limit or the singularity is met. One met after the end of the motion, while the line goes on for reactions
/// alone, is not what ends the motion.
template <class Q, class Rate>
void cut_line(const CollisionSetup& setup, PathEnd why, int met_step, Q q, Rate qd, LinePath& path) {
    const Chain& chain = setup.chain;
    const MotionSettings& motion = setup.motion;
    path.cut_step = int(path.s.size()) - 1;
    if (path.end == PathEnd::motion_end && met_step <= setup.timing.steps) path.end = why;
    const Point3<double> start = point3<double>(path.start), normal = point3<double>(path.normal);
    double there[max_joints];
    JointAngles<double> angle;
    Posture<double> posture;
    for (int j = 0; j < chain.dof; ++j) there[j] = q(j);
    const auto write = [&] {
        angle.set(chain, there);
        forward_kinematics(chain, there, angle, posture);
        path.braking.push_back(dot(posture.position(setup.contact.point) - start, normal));
    };
    if (!motion.deceleration.constant()) {
        brake_by_law(chain, motion, qd, there, path.s.size(), write);
        return;
    }
    double stop_time = 0;  // of the slowest joint [s]
    for (int f = 0; f < motion.free_count; ++f) {
        const int j = motion.free_joint[f];
        stop_time = std::max(stop_time, std::fabs(qd(j)) / motion.acceleration_limit[j]);
    }
    const double load = stop_time / motion.substep();  // sub-steps
    const double braking = std::floor(load);           // in the sub-step after these the rates are zero
    const double steps = std::min(std::ceil(braking / motion.substeps),
                                  double(max_reaction_steps(stop_time, path.s.size(), motion.step, motion.substeps)));
    for (int i = 1; i <= int(steps); ++i) {
        const double n = std::min(double(i) * motion.substeps, braking);
        const double travel = motion.substep() * (n - n * (n + 1) / (2 * load));  // per rate
        for (int f = 0; f < motion.free_count; ++f) {
            const int j = motion.free_joint[f];
            there[j] = q(j) + qd(j) * travel;
        }
        write();
    }
}

}  // namespace detail

}  // namespace bumpstop::inline BUMPSTOP_TARGET
