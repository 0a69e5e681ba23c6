/// @file
/// Simulates the reactions to ticks of a path.
#pragma once

#include "bumpstop/collision/motion/reaction_batch.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace detail {

/// Stopping time of the slowest joint [s], with the greatest rates between the detection and the beginning of the
/// reaction: Schroeder (2013) counts from the detection on.
inline double max_stop_time(const CollisionSetup& setup, const LinePath& path, int tick) {
    const MotionSettings& motion = setup.motion;
    const Timing& timing = setup.timing;
    const int n = motion.free_count;
    double longest = 0;
    for (int k = std::max(std::min(tick, 0), tick - LinePath::early_ticks(timing)); k <= tick; ++k) {
        const double* rates = path.state_at(k, timing) + n;
        for (int f = 0; f < n; ++f)
            longest = std::max(longest, std::fabs(rates[f]) / motion.acceleration_limit[motion.free_joint[f]]);
    }
    return longest;
}

/// Writes the start positions of a job, by joint, into a lane of `q`. Returns the rates of its free joints.
template <class T>
const double* load_start(const CollisionSetup& setup, const ReactionJob& job, int lane, T* q) {
    const int n = setup.motion.free_count;
    const double* positions = job.path->state_at(job.tick, setup.timing);
    for (int j = 0; j < setup.chain.dof; ++j) set_lane(q[j], lane, job.path->q[std::size_t(j)]);
    for (int f = 0; f < n; ++f) set_lane(q[setup.motion.free_joint[f]], lane, positions[f]);
    return positions + n;
}

}  // namespace detail

/// Simulates jobs, one in each lane; a lane takes the next job as soon as its own is finished. The result of a job does
/// not depend on the others.
template <class T>
void simulate_reactions(const CollisionSetup& setup, ReactionJob* jobs, int count, ReactionDetail detail) {
    if (count == 0) return;
    constexpr int lanes = Scalar<T>::lanes;
    const Chain& chain = setup.chain;
    const MotionSettings& motion = setup.motion;
    const bool stopping = setup.reaction == ReactionKind::stop;
    const ReactionRules rules{detail == ReactionDetail::only_peak, stopping, motion.substeps, motion.substep()};
    using Arm = ArmIntegrator<T>;
    Arm arm(chain, motion, stopping ? Arm::Kind::brake : Arm::Kind::track);
    Point3<T> normal, start;
    ReactionBatch<T> running(rules);
    auto load = [&](int lane, ReactionJob& job) {
        const LinePath& path = *job.path;
        const double* rates = detail::load_start(setup, job, lane, arm.state.q);
        for (int j = 0; j < chain.dof; ++j) set_lane(arm.state.qd[j], lane, 0.0);
        for (int f = 0; f < motion.free_count; ++f) set_lane(arm.state.qd[motion.free_joint[f]], lane, rates[f]);
        set_lane(arm.target, lane, lane_of((stopping ? 0.0 : -1.0) * point3<double>(path.velocity), 0));
        set_lane(normal, lane, path.normal);
        set_lane(start, lane, path.start);
        arm.begin(lane, job.tolerance);
        double stop_time = detail::max_stop_time(setup, path, job.tick);
        if (!motion.deceleration.constant()) {
            double there[max_joints] = {};
            for (int j = 0; j < chain.dof; ++j) there[j] = lane_of(arm.state.q[j], lane);
            const BrakeProfile profile = brake_profile(chain, motion, there, rates, !stopping);
            arm.brake(lane, profile, motion.deceleration.independent);
            stop_time = std::max(stop_time, profile.stop_time);
        }
        running.begin(lane, job, path.s[std::size_t(LinePath::reaction_step(job.tick, setup.timing))], stop_time);
    };
    int next = std::min(count, lanes);
    for (int lane = 0; lane < lanes; ++lane) {
        // Lanes without a job of their own hold the start of the first one.
        load(lane, jobs[lane < count ? lane : 0]);
        if (lane >= count) running.stop(lane);
    }
    T speed, distance;
    auto observe = [&] {
        const LinkPoint& point = setup.contact.point;
        const Point3<T> p = arm.posture.position(point);
        speed = dot(point_velocity(chain, arm.posture, point.link, p, arm.state.qd), normal);
        distance = dot(p - start, normal);
    };
    auto rejected = [&](const MaskOf<T>& long_steps, const T& count) {
        return running.rejected(long_steps, count, speed);
    };
    while (!running.all_done()) {
        allow_interruption();
        const T taken = arm.step(running.max_steps(), observe, rejected);
        const MaskOf<T> finished = running.update({taken, distance, speed, arm.near_singular(), arm.reached()});
        arm.relax(running.relaxed(), ReactionBatch<T>::retreat_tolerance_scale);
        if (!any(finished)) continue;
        for (int lane = 0; lane < lanes; ++lane) {
            if (!lane_of(finished, lane)) continue;
            if (ReactionJob* again = running.rebounded(lane)) {
                load(lane, *again);
            } else if (next < count) {
                load(lane, jobs[next++]);
            } else {
                running.stop(lane);
            }
        }
    }
}

/// Simulates the `wanted(job)` that met a singularity again, with near_singular_tolerance if theirs was wider.
template <class T, class Wanted>
void refine_near_singularities(const CollisionSetup& setup, std::vector<ReactionJob>& jobs, ReactionDetail what,
                               Wanted wanted) {
    std::vector<ReactionJob> again;
    std::vector<std::size_t> of;
    for (std::size_t i = 0; i < jobs.size(); ++i) {
        if (jobs[i].tolerance <= near_singular_tolerance || !jobs[i].met_singularity || !wanted(jobs[i])) continue;
        of.push_back(i);
        again.push_back(jobs[i]);
        again.back().tolerance = near_singular_tolerance;
        again.back().rebounded = false;
    }
    if (again.empty()) return;
    simulate_reactions<T>(setup, again.data(), int(again.size()), what);
    for (std::size_t i = 0; i < of.size(); ++i) jobs[of[i]] = std::move(again[i]);
}

/// Distances along the normal after every simulation step of reactions to ticks of a path [m], until the point is
/// behind the `return_to` of the tick [m]. Where a reaction does not begin before the line ends, those of braking
/// there.
template <class T>
std::vector<std::vector<double>> reaction_distances(const CollisionSetup& setup, const LinePath& path,
                                                    const std::vector<int>& ticks,
                                                    const std::vector<double>& return_to) {
    const int known = path.known_reactions();
    std::vector<ReactionJob> jobs;
    for (std::size_t i = 0; i < ticks.size(); ++i) {
        if (ticks[i] >= known) continue;
        jobs.push_back({&path, 0, ticks[i], {}, {}});
        jobs.back().return_to = return_to[i];
    }
    simulate_reactions<T>(setup, jobs.data(), int(jobs.size()), ReactionDetail::every_step);
    std::vector<std::vector<double>> out(ticks.size());
    std::size_t next = 0;
    for (std::size_t i = 0; i < ticks.size(); ++i) {
        if (ticks[i] < known) {
            out[i] = std::move(jobs[next++].distance);
        } else {
            out[i].assign(1, path.s.back());
            out[i].insert(out[i].end(), path.braking.begin(), path.braking.end());
        }
    }
    return out;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
