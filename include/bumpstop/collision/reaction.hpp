/// @file
/// The path the contact point still travels once the arm reacts.
#pragma once

#include "bumpstop/collision/running_reaction.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace detail {

/// Velocity of a point of the arm along `normal` [m/s].
template <class T>
T speed_along(const Chain& chain, const MotionSettings& motion, const ArmState<T>& state, const Posture<T>& posture,
              const LinkPoint& point, const Point3<T>& normal) {
    const Point3<T> p = posture.position(point);
    T speed = 0.0;
    for (int f = 0; f < motion.free_count; ++f) {
        const int j = motion.free_joint[f];
        if (j <= point.link) speed += state.qd[j] * dot(linear_column(chain, posture, p, j), normal);
    }
    return speed;
}

/// What the slowest joint needs to stop [s]. The source counts from the detection on, with the rates the joints had then.
inline double longest_stop_time(const MotionSettings& motion, const Timing& timing, const LinePath& path, int tick) {
    const int n = motion.free_count;
    double longest = 0;
    const int before = (timing.latency + timing.period - 1) / timing.period;
    for (int k = std::max(0, tick - before); k <= tick; ++k) {
        const double* rates = &path.reaction_state[(std::size_t(k) * 2 + 1) * n];
        for (int f = 0; f < n; ++f)
            longest = std::max(longest, std::fabs(rates[f]) / motion.acceleration_limit[motion.free_joint[f]]);
    }
    return longest;
}

}  // namespace detail

/// Lets every lane take the next of the jobs as soon as it is done with one. What becomes of a job does not depend on
/// the others.
template <class T>
void simulate_reactions(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact,
                        const Timing& timing, ReactionKind kind, ReactionJob* jobs, int count, ReactionDetail detail) {
    constexpr int lanes = Scalar<T>::lanes;
    const int n = motion.free_count;
    const bool stopping = kind == ReactionKind::stop;
    const ReactionRules rules{detail == ReactionDetail::only_peak, stopping, motion.substeps, motion.substep()};
    using Arm = BrakingArm<T>;
    Arm arm(chain, motion, stopping ? Arm::Kind::stops : Arm::Kind::follows);
    Point3<T> normal, start;
    RunningReaction running[lanes];
    if (count == 0) return;
    auto load = [&](int lane, ReactionJob& job) {
        const LinePath& path = *job.path;
        const double* rs = &path.reaction_state[std::size_t(job.tick) * 2 * n];
        for (int j = 0; j < chain.dof; ++j) {
            set_lane(arm.state.q[j], lane, job.q[j]);
            set_lane(arm.state.qd[j], lane, 0.0);
        }
        for (int f = 0; f < n; ++f) {
            const int j = motion.free_joint[f];
            set_lane(arm.state.q[j], lane, rs[f]);
            set_lane(arm.state.qd[j], lane, rs[n + f]);
        }
        auto set = [&](Point3<T>& point, const Vector3& value, double scale) {
            set_lane(point.x, lane, scale * value[0]);
            set_lane(point.y, lane, scale * value[1]);
            set_lane(point.z, lane, scale * value[2]);
        };
        set(arm.target, path.velocity, stopping ? 0 : -1);
        set(normal, path.normal, 1);
        set(start, path.start, 1);
        arm.begin(lane, job.leap_tolerance);
        running[lane] = RunningReaction(rules, job, path.s[std::size_t(job.tick) * timing.period + 1 + timing.latency],
                                        detail::longest_stop_time(motion, timing, path, job.tick));
    };
    int busy = std::min(count, lanes), next = busy;
    for (int lane = 0; lane < lanes; ++lane) {
        // Lanes without a job of their own stand where the first one began.
        load(lane, jobs[lane < count ? lane : 0]);
        if (lane >= count) running[lane] = {};
    }
    T speed, distance;
    int most[lanes], gone[lanes];
    while (busy > 0) {
        for (int lane = 0; lane < lanes; ++lane)
            most[lane] = running[lane].idle() ? 0 : running[lane].longest_leap(rules);
        auto look = [&] {
            speed = detail::speed_along(chain, motion, arm.state, arm.posture, contact.point, normal);
            distance = dot(arm.posture.position(contact.point) - start, normal);
        };
        arm.advance(most, gone, look,
                    [&](int lane, int over) { return running[lane].accepts(rules, over, lane_of(speed, lane)); });
        for (int lane = 0; lane < lanes; ++lane) {
            RunningReaction& at = running[lane];
            if (at.idle()) continue;
            switch (at.take(rules, {gone[lane], lane_of(distance, lane), lane_of(speed, lane), arm.poor(lane),
                                    arm.reached(lane)})) {
                case ReactionFate::goes_on:
                    break;
                case ReactionFate::homes:
                    arm.loosen(lane, RunningReaction::homing_slack);
                    break;
                case ReactionFate::anew:
                    load(lane, at.job());
                    at.take_care();
                    break;
                case ReactionFate::done:
                    if (next < count) {
                        load(lane, jobs[next++]);
                    } else {
                        at = {};
                        --busy;
                    }
            }
        }
    }
}

/// As above, of jobs that are still to be told where they begin and return to: `pose_of(job)` and `return_to(job)`.
template <class T, class PoseOf, class ReturnTo>
void simulate_reactions(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact,
                        const Timing& timing, ReactionKind kind, ReactionJob* jobs, int count, ReactionDetail detail,
                        PoseOf pose_of, ReturnTo return_to) {
    for (ReactionJob* job = jobs; job < jobs + count; ++job) {
        job->q = pose_of(*job);
        job->return_to = return_to(*job);
    }
    simulate_reactions<T>(chain, motion, contact, timing, kind, jobs, count, detail);
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
