/// @file
/// The path the contact point still travels once the arm reacts.
#pragma once

#include "bumpstop/collision/motion/reaction_batch.hpp"
#include "bumpstop/model/point_motion.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace detail {

/// What the slowest joint needs to stop [s]. The source counts from the detection on, with the rates the joints had
/// then.
inline double longest_stop_time(const MotionSettings& motion, const Timing& timing, const LinePath& path, int tick) {
    const int n = motion.free_count;
    double longest = 0;
    const int before = (timing.latency + timing.period - 1) / timing.period;
    for (int k = std::max(std::min(tick, 0), tick - before); k <= tick; ++k) {
        const double* rates = path.state_at(k, timing) + n;
        for (int f = 0; f < n; ++f)
            longest = std::max(longest, std::fabs(rates[f]) / motion.acceleration_limit[motion.free_joint[f]]);
    }
    return longest;
}

/// Rates of the free joints where a job begins [rad/s or m/s]; its positions of all joints go into a lane of `q`.
template <class T>
const double* load_start(const Chain& chain, const MotionSettings& motion, const Timing& timing, const ReactionJob& job,
                         int lane, T* q) {
    const int n = motion.free_count;
    const double* positions = job.path->state_at(job.tick, timing);
    for (int j = 0; j < chain.dof; ++j) set_lane(q[j], lane, job.q[j]);
    for (int f = 0; f < n; ++f) set_lane(q[motion.free_joint[f]], lane, positions[f]);
    return positions + n;
}

template <class T>
void set_lane_of_point(Point3<T>& point, int lane, const Vector3& value, double scale = 1) {
    set_lane(point.x, lane, scale * value[0]);
    set_lane(point.y, lane, scale * value[1]);
    set_lane(point.z, lane, scale * value[2]);
}

/// As of simulate_reactions, by leaps that go by so many values.
template <int order, class T>
void follow_reactions(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact,
                      const Timing& timing, ReactionKind kind, ReactionJob* jobs, int count, ReactionDetail detail) {
    constexpr int lanes = Scalar<T>::lanes;
    const bool stopping = kind == ReactionKind::stop;
    const ReactionRules rules{detail == ReactionDetail::only_peak, stopping, motion.substeps, motion.substep()};
    using Arm = ArmIntegrator<T, order>;
    Arm arm(chain, motion, stopping ? Arm::Kind::brake : Arm::Kind::track);
    Point3<T> normal, start;
    ReactionBatch<T> running(rules);
    auto load = [&](int lane, ReactionJob& job) {
        const LinePath& path = *job.path;
        const double* rates = load_start(chain, motion, timing, job, lane, arm.state.q);
        for (int j = 0; j < chain.dof; ++j) set_lane(arm.state.qd[j], lane, 0.0);
        for (int f = 0; f < motion.free_count; ++f) set_lane(arm.state.qd[motion.free_joint[f]], lane, rates[f]);
        set_lane_of_point(arm.target, lane, path.velocity, stopping ? 0 : -1);
        set_lane_of_point(normal, lane, path.normal);
        set_lane_of_point(start, lane, path.start);
        arm.begin(lane, job.tolerance);
        running.begin(lane, job, path.s[std::size_t(LinePath::reaction_step(job.tick, timing))],
                      longest_stop_time(motion, timing, path, job.tick));
    };
    int next = std::min(count, lanes);
    for (int lane = 0; lane < lanes; ++lane) {
        // Lanes without a job of their own stand where the first one began.
        load(lane, jobs[lane < count ? lane : 0]);
        if (lane >= count) running.stop(lane);
    }
    T speed, distance;
    auto look = [&] {
        const PointMotion<T> point = point_motion(chain, arm.state.q, arm.state.qd, arm.state.angle, contact.point);
        speed = dot(point.velocity, normal);
        distance = dot(point.position - start, normal);
    };
    // As they were where lanes turned home.
    Arm arm_at_retreat = arm;
    ReactionBatch<T> running_at_retreat = running;
    auto rejected = [&](const MaskOf<T>& leaps, const T& over) { return running.rejected(leaps, over, speed); };
    while (!running.all_done()) {
        allow_interruption();
        const T gone = arm.step(running.max_steps(), look, rejected);
        const ReactionEvents<T> events = running.update({gone, distance, speed, arm.near_singular(), arm.reached()});
        if (any(events.retreating)) {
            arm_at_retreat.copy_lanes(events.retreating, arm);
            running_at_retreat.copy_lanes(events.retreating, running);
            arm.relax(events.retreating, ReactionBatch<T>::retreat_tolerance_scale);
        }
        if (any(events.restart)) {
            arm.copy_lanes(events.restart, arm_at_retreat);
            running.copy_lanes(events.restart, running_at_retreat);
            running.restart_accurately(events.restart);
        }
        if (!any(events.finished)) continue;
        for (int lane = 0; lane < lanes; ++lane) {
            if (!lane_of(events.finished, lane)) continue;
            if (next < count) {
                load(lane, jobs[next++]);
            } else {
                running.stop(lane);
            }
        }
    }
}

}  // namespace detail

/// Lets every lane take the next of the jobs as soon as it is done with one. What becomes of a job does not depend on
/// the others; all of them are exact, or none is.
template <class T>
void simulate_reactions(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact,
                        const Timing& timing, ReactionKind kind, ReactionJob* jobs, int count, ReactionDetail detail) {
    if (count == 0) return;
    if (jobs->exact()) {
        detail::follow_reactions<exact_order, T>(chain, motion, contact, timing, kind, jobs, count, detail);
    } else {
        // Near singularities their long leaps enlarge roundings, which must be the same on every instruction set.
        using U = Unfused<T>;
        detail::follow_reactions<batch_order, U>(chain, motion, contact, timing, kind, jobs, count, detail);
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

/// Follows once more, closely, those of the loose jobs that met a singularity and are `wanted(job)`.
template <class T, class Wanted>
void refine_near_singularities(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact,
                               const Timing& timing, ReactionKind kind, std::vector<ReactionJob>& jobs,
                               ReactionDetail what, Wanted wanted) {
    std::vector<ReactionJob> again;
    std::vector<std::size_t> of;
    for (std::size_t i = 0; i < jobs.size(); ++i) {
        if (jobs[i].tolerance <= near_singular_tolerance || !jobs[i].met_singularity || !wanted(jobs[i])) continue;
        of.push_back(i);
        again.push_back(jobs[i]);
        again.back().tolerance = near_singular_tolerance;
    }
    if (again.empty()) return;
    // Singularities enlarge roundings, which must be the same on every instruction set.
    detail::follow_reactions<batch_order, Unfused<T>>(chain, motion, contact, timing, kind, again.data(),
                                                      int(again.size()), what);
    for (std::size_t i = 0; i < of.size(); ++i) jobs[of[i]] = std::move(again[i]);
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
