/// @file
/// The acceleration limits over the course of one reaction.
#pragma once

#include "bumpstop/collision/motion/line_motion.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Acceleration limits while an arm slows down, by sub-step from the beginning of its reaction.
struct BrakeProfile {
    std::array<double, max_joints> scale{};  ///< factor of the limits while the arm slows down, by free joint
    double slowing = std::numeric_limits<double>::infinity();  ///< sub-steps after which the full limits hold
    double ramp = 0;                                           ///< sub-steps in which the limits grow from zero
    double stop_time = 0;                                      ///< until the arm stands [s]

    /// Limit of a free joint in a sub-step, counted from 0, in units of its acceleration limit.
    double of(int f, double substep) const {
        return substep < slowing ? scale[f] * std::min(1.0, ramp > 0 ? (substep + 0.5) / ramp : 1.0) : 1.0;
    }
};

/// Share of the longest stopping time below which a joint is at rest, because its rate is rounding.
inline constexpr double standing = 1e-9;

/// Distance of the tip from the axis of joint 1, or from its origin if it slides, as a share of `reach` [m].
inline double extension_at(const Chain& chain, const LinkPoint& tip, const double* q, double reach) {
    JointAngles<double> angle;
    Posture<double> posture;
    angle.set(chain, q);
    forward_kinematics(chain, q, angle, posture);
    Point3<double> away = posture.position(tip) - posture.origin[0];
    if (!chain.joint[0].prismatic) {
        const Point3<double>& axis = posture.axis[0];
        away = away - dot(away, axis) * axis;
    }
    return std::sqrt(dot(away, away)) / reach;
}

/// Profile of a reaction that begins at positions `q` (by joint) with rates `rate` (by free joint). Where the rates
/// keep their ratios, the joint with the longest stopping time decides for all. An arm that `reverses` after a stop in
/// a given time goes back at its full limits; a ramp continues.
inline BrakeProfile brake_profile(const Chain& chain, const MotionSettings& motion, const double* q, const double* rate,
                                  bool reverses) {
    const Deceleration& deceleration = motion.deceleration;
    const int n = motion.free_count;
    const bool from_table = deceleration.law == DecelerationLaw::table;
    const double extended = from_table && deceleration.times.extension.size() > 1
                                ? extension_at(chain, motion.tip, q, deceleration.times.reach)
                                : 0.0;
    // Stopping times of the joints at their acceleration limits, and by the law.
    std::array<double, max_joints> at_limit{}, own{};
    double limit_time = 0, longest = 0;
    for (int f = 0; f < n; ++f) {
        at_limit[f] = std::fabs(rate[f]) / motion.acceleration_limit[motion.free_joint[f]];
        limit_time = std::max(limit_time, at_limit[f]);
    }
    for (int f = 0; f < n; ++f) {
        if (at_limit[f] <= standing * limit_time) continue;
        own[f] = from_table ? deceleration.times.at(motion.free_joint[f], extended, std::fabs(rate[f]))
                            : deceleration.stopping_time;
        longest = std::max(longest, own[f]);
    }
    BrakeProfile profile;
    profile.scale.fill(1);
    profile.stop_time = from_table ? longest : deceleration.time_to_stop(limit_time);
    if (deceleration.law == DecelerationLaw::ramp) profile.ramp = deceleration.ramp_time / motion.substep();
    if ((from_table || deceleration.law == DecelerationLaw::constant_time) && limit_time > 0) {
        for (int f = 0; f < n; ++f) {
            profile.scale[f] = !deceleration.independent ? limit_time / longest
                               : own[f] > 0              ? at_limit[f] / own[f]
                                                         : 1.0;
        }
        if (reverses) profile.slowing = profile.stop_time / motion.substep();
    }
    return profile;
}

/// Steps after which a reaction is ended in any case, because an arm near a singularity may never reverse. All others
/// end long before: the slowest joint stands after `stop_time` [s], has reversed after twice that, and goes back no
/// farther than it came in `path_steps`. The limit by `substeps` keeps the count of sub-steps within an int.
inline int max_reaction_steps(double stop_time, std::size_t path_steps, double step, int substeps) {
    const double needed = std::min(4 * stop_time / step, 2e6) + 2 * double(path_steps);
    return int(std::min(std::max(needed, 20000.0), 2e9 / substeps));
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
