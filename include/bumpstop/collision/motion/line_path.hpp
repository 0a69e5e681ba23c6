/// @file
/// The undisturbed path of the contact point along the line.
#pragma once

#include <algorithm>
#include <limits>
#include <vector>

#include "bumpstop/collision/motion/line_motion.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Why the arm stops following the line. At a joint limit and at a singularity it brakes.
enum class PathEnd { motion_end, joint_limit, singularity, all_detected };

inline const char* name_of(PathEnd end) {
    switch (end) {
        case PathEnd::joint_limit:
            return "joint_limit";
        case PathEnd::singularity:
            return "singularity";
        case PathEnd::all_detected:
            return "all_detected";
        default:
            return "motion_end";
    }
}

/// The path from one pose: all that the force distribution needs of it.
struct LinePath {
    /// Number of ticks before tick 0, numbered from -1 down, whose reactions would begin after tick 0. The reaction to
    /// the earliest of them begins in step 1.
    static int early_ticks(const Timing& timing) { return (timing.latency + timing.period - 1) / timing.period; }
    /// Step in which the reaction to a tick begins.
    static int reaction_step(int tick, const Timing& timing) {
        return std::max(1, tick * timing.period + 1 + timing.latency);
    }

    int dof = 0, free_count = 0;
    int ticks = 0;
    std::array<double, max_joints> q{};  ///< joint positions at the start [rad or m]; held joints keep theirs
    std::vector<double> s;               ///< distance along the normal after step i; s[0] = 0 [m]
    std::vector<double> torque_per_N;    ///< [tick][dof]: J_v' n at the tick
    std::vector<double> reaction_state;  ///< [tick][free]: q, then qd, where the reaction to the tick would begin
    std::vector<double> early_state;     ///< the same for the ticks before tick 0, the earliest first
    Vector3 start{}, normal{};  ///< of the contact point [m]; unit vector into the body; both in the base frame
    Vector3 velocity{};         ///< wanted velocity of the tip, base frame [m/s]
    double approach_speed = 0;  ///< of the contact point along the normal at the full speed of the motion [m/s]
    PathEnd end = PathEnd::motion_end;
    int end_joint = -1;             ///< the joint that would exceed its position limit, from 0; -1: none
    int cut_step = -1;              ///< the step after which the arm brakes because it cannot follow the line; -1: none
    std::vector<double> braking;    ///< distance after each step since `cut_step`, until the arm stands [m]
    bool velocity_limited = false;  ///< a joint-velocity limit slowed the motion somewhere
    bool met_singularity = false;   ///< a singularity was near somewhere on the path
    bool singular_start = false;    ///< the start is singular: its rates and the path are not valid

    /// The arm is at rest where the path ends, so that the force of an undetected contact does not grow after it.
    bool rests() const { return end == PathEnd::joint_limit || end == PathEnd::singularity; }
    /// Greatest distance of the undisturbed motion up to step `last`, or up to its end with braking [m].
    double max_distance(std::size_t last) const {
        if (ticks == 0) return 0;
        return std::max(*std::max_element(s.begin(), s.begin() + std::ptrdiff_t(std::min(last, s.size() - 1)) + 1),
                        max_braking_distance());
    }
    /// Number of ticks whose reactions begin on the line.
    int known_reactions() const { return std::min(ticks, int(reaction_state.size() / (2 * std::size_t(free_count)))); }
    /// The same of the ticks before tick 0, counted from the earliest.
    int known_early_reactions() const { return int(early_state.size() / (2 * std::size_t(free_count))); }
    /// The last tick not after `tick` whose reaction begins on the line; one before the earliest if there is none.
    int last_with_reaction(int tick, const Timing& timing) const {
        return tick >= 0 && known_reactions() > 0 ? std::min(tick, known_reactions() - 1)
                                                  : std::min(tick, known_early_reactions() - early_ticks(timing) - 1);
    }
    /// Distance at tick k; ticks are `period` steps apart [m].
    double at_tick(int k, int period) const { return s[std::size_t(k) * period + 1]; }
    /// Positions, then rates, of the free joints where the reaction to a tick begins, ticks before tick 0 included.
    const double* state_at(int tick, const Timing& timing) const {
        const std::size_t n = 2 * std::size_t(free_count);
        return tick >= 0 ? &reaction_state[std::size_t(tick) * n]
                         : &early_state[std::size_t(early_ticks(timing) + tick) * n];
    }
    /// Last step of the undetected motion. The line itself continues for a latency beyond it, where reactions begin.
    std::size_t end_step(const Timing& timing) const { return std::min(s.size() - 1, std::size_t(timing.steps)); }
    /// The undetected motion ends with the arm braking.
    bool brakes() const { return !braking.empty() && rests(); }
    /// Greatest distance while the arm brakes; -infinity where it does not [m].
    double max_braking_distance() const {
        return brakes() ? *std::max_element(braking.begin(), braking.end()) : -std::numeric_limits<double>::infinity();
    }
};

/// The starts of lines, one in each lane.
template <class T>
struct LineStart {
    ArmState<T> state;
    Posture<T> posture;
    Rates<T> rates;
    Point3<T> point, normal;
    Point3<T> point_velocity;  ///< of the contact point at full speed [m/s]
};

/// Computes the starts of lines and resets paths[0..count) to them.
template <class T>
LineStart<T> begin_line(const CollisionSetup& setup, const T* q, const Point3<T>& velocity, LinePath* paths,
                        int count) {
    const Chain& chain = setup.chain;
    const MotionSettings& motion = setup.motion;
    const ContactGeometry& contact = setup.contact;
    LineStart<T> line;
    for (int j = 0; j < chain.dof; ++j) {
        line.state.q[j] = q[j];
        line.state.qd[j] = 0.0;
    }
    line.state.refresh_angles(chain);
    forward_kinematics(chain, line.state.q, line.state.angle, line.posture);
    line.rates = resolved_rates(chain, motion, line.posture, velocity);
    line.point = line.posture.position(contact.point);
    T rate[max_joints];
    for (int j = 0; j < chain.dof; ++j) rate[j] = 0.0;
    for (int f = 0; f < motion.free_count; ++f) rate[motion.free_joint[f]] = line.rates.free[f];
    line.point_velocity = point_velocity(chain, line.posture, contact.point.link, line.point, rate);
    line.normal = point3<T>(contact.normal);
    if (contact.along_motion) {
        const T speed = sqrt(dot(line.point_velocity, line.point_velocity));
        line.normal = (1.0 / max(speed, T(1e-200))) * line.point_velocity;
    }
    if (!setup.timing.from_rest) std::copy_n(rate, chain.dof, line.state.qd);
    const T approach = dot(line.point_velocity, line.normal);
    for (int lane = 0; lane < count; ++lane) {
        LinePath& path = paths[lane];
        path.dof = chain.dof;
        path.free_count = motion.free_count;
        path.ticks = 0;
        for (int j = 0; j < chain.dof; ++j) path.q[std::size_t(j)] = lane_of(q[j], lane);
        path.s.clear();
        path.torque_per_N.clear();
        path.reaction_state.clear();
        path.early_state.clear();
        path.start = lane_of(line.point, lane);
        path.normal = lane_of(line.normal, lane);
        path.velocity = lane_of(velocity, lane);
        path.approach_speed = lane_of(approach, lane);
        path.end = PathEnd::motion_end;
        path.end_joint = -1;
        path.cut_step = -1;
        path.braking.clear();
        path.met_singularity = false;
        path.velocity_limited = lane_of(line.rates.velocity_limited, lane);
        path.singular_start = lane_of(line.rates.conditioning.singular, lane);
    }
    return line;
}

namespace detail {

/// A joint that comes no farther beyond its limit than this has not left its range: one that stands on the limit while
/// the others move is carried across it by rounding [rad or m].
inline constexpr double limit_rounding = 1e-9;

/// How far a joint at `q` may still go to its nearer position limit, negative where it has left its range [rad or m].
template <class T>
T limit_margin(const MotionSettings& motion, int joint, const T& q) {
    return min(q - (motion.lower[joint] - limit_rounding), (motion.upper[joint] + limit_rounding) - q);
}

/// The least of the free joints, or 1; `q` by joint [rad or m].
template <class T>
T min_limit_margin(const MotionSettings& motion, const T* q) {
    T margin = 1.0;
    for (int f = 0; f < motion.free_count; ++f)
        margin = min(margin, limit_margin(motion, motion.free_joint[f], q[motion.free_joint[f]]));
    return margin;
}

/// Appends the distances between the last one and `next`, which comes a stride after it, from the cubic through `next`
/// and the ends of the three strides before.
inline void fill_stride(std::vector<double>& path, int stride, double next) {
    const std::size_t end = path.size() - 1;
    const double y[4] = {path[end - 2 * stride], path[end - stride], path[end], next};
    const double third = y[3] - 3 * y[2] + 3 * y[1] - y[0], second = y[3] - 2 * y[2] + y[1];
    path.resize(path.size() + std::size_t(stride) - 1);
    const double per_stride = 1.0 / stride;
    for (int step = 1; step < stride; ++step) {
        const double x = step * per_stride - 1;  // 0 at the new stride, -1 at the one before
        path[end + std::size_t(step)] =
            y[3] + x * ((y[3] - y[2]) + (x + 1) * (0.5 * second + (x + 2) * (1.0 / 6) * third));
    }
}

}  // namespace detail

}  // namespace bumpstop::inline BUMPSTOP_TARGET
