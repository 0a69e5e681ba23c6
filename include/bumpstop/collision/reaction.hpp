/// @file
/// The path the contact point still travels once the arm reacts.
#pragma once

#include "bumpstop/collision/braking_arm.hpp"
#include "bumpstop/collision/line_path.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

enum class ReactionKind { stop, reverse };

/// One reaction to simulate: that of `tick` on `path`. distance[i] is the distance along the normal step[i] simulation
/// steps into the reaction; step[0] is 0, where it begins.
struct ReactionJob {
    const LinePath* path;
    int curve;  ///< whose number the path is
    int tick;
    std::vector<double> distance;
    std::vector<int> step;
    double leap_tolerance = braking_leap_tolerance;
    double enough = std::numeric_limits<double>::infinity();  ///< nothing is asked beyond this distance [m]
    const double* q = nullptr;  ///< joint positions the path started in: held joints keep theirs
    double return_to = 0;       ///< distance [m] behind which a point that reverses is back
    bool comes_back = true;     ///< else the first retreat is believed, whatever is near
    bool came_back = false;     ///< result: on its way home the point came near its farthest again
};

/// What of a reaction is wanted. `only_peak`: steps far from a farthest point may be missing, and a reaction that reverses
/// ends once the point retreats for good: on the way back nothing brings it forward again unless a singularity was near, or
/// the arm did not follow its line and swings on. Such an arm is followed until half again the time has passed that the
/// slowest joint needs to stop, and 50 ms more: the source's own length of a run after detection; and to its first retreat,
/// if that is later. `every_step`: all steps; one that reverses is followed for as long, and until the point is back behind
/// `return_to`. If after that time it gets farther than ever before instead, it ends before that: no force counts that
/// `only_peak` does not know. A reaction that stops is followed until it has.
enum class ReactionDetail { every_step, only_peak };

/// No arm needs this many steps; one that cannot reverse near a singularity must not run for ever.
inline constexpr int longest_reaction_steps = 20000;
/// The steps about the farthest point tell where between two steps it lies.
inline constexpr int steps_past_peak = 3;

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

}  // namespace detail

/// One reaction on its way in a lane.
struct RunningReaction {
    ReactionJob* job = nullptr;  ///< null: the lane is idle
    double turning_point = 0;
    int patience = 0;              ///< controller sub-steps after which the retreat of an arm astray is believed
    int gone = 0, retreating = 0;  ///< controller sub-steps since the beginning, and since the point began to retreat
    double here = 0;               ///< distance along the normal [m]
    double speed = 0;              ///< along the normal [m/s]
    double top = 0;                ///< sub-steps until the point will be farthest, as far as one can tell
    bool started = false;          ///< the first look has been taken
    bool astray = false;           ///< a singularity was near, or the arm did not follow its line when it began
    bool turned = false;           ///< it has retreated
    bool over = false;             ///< it ends with this step
    double peak = 0, lowest = 0;   ///< the farthest so far, and the nearest since [m]
    bool homing = false;   ///< well behind its peak: followed loosely, only to see that it does not come back to it
    bool careful = false;  ///< it may, and is followed well all the way
};

/// An arm follows its line where the point's speed is off by no more than this share of it.
inline constexpr double following_share = 0.1;
/// An arm on its way home is followed so many times less exactly, until it is this share of its retreat, or this distance,
/// from its peak again.
inline constexpr double homing_slack = 1e3, homing_share = 0.1, homing_distance = 1e-5;
/// How far the next leap of a reaction may go, in sub-steps. The steps about the farthest point are gone one by one.
inline int longest_leap(const RunningReaction& at, int substeps, bool only_peak) {
    const int to_step = substeps - at.gone % substeps;
    if (!only_peak || at.speed == 0 || at.over) return to_step;
    if (at.homing || (at.speed < 0 && at.retreating >= steps_past_peak * substeps)) return longest_braking_leap;
    if (at.speed < 0) return to_step;
    if (!(at.top < 2 * longest_braking_leap)) return longest_braking_leap;
    // The last step that ends a whole step before the top.
    const int landing = (int(at.gone + at.top) / substeps - 1) * substeps - at.gone;
    return std::max(landing, to_step);
}

/// Lets every lane take the next of the jobs as soon as it is done with one. What becomes of a job does not depend on
/// the others.
template <class T>
void simulate_reactions(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact,
                        const Timing& timing, ReactionKind kind, ReactionJob* jobs, int count, ReactionDetail detail) {
    constexpr int lanes = Scalar<T>::lanes;
    const int n = motion.free_count, substeps = motion.substeps;
    const bool only_peak = detail == ReactionDetail::only_peak;
    const bool stopping = kind == ReactionKind::stop;
    using Arm = BrakingArm<T>;
    Arm arm(chain, motion, stopping ? Arm::Kind::stops : Arm::Kind::follows);
    const double sign = stopping ? 0 : -1;
    Point3<T> normal, start;
    RunningReaction running[lanes];
    int next = 0, busy = 0;
    if (count == 0) return;
    auto load = [&](int lane, ReactionJob& job) {
        const LinePath& path = *job.path;
        const double* q = job.q;
        const double* rs = &path.reaction_state[std::size_t(job.tick) * 2 * n];
        for (int j = 0; j < chain.dof; ++j) {
            set_lane(arm.state.q[j], lane, q[j]);
            set_lane(arm.state.qd[j], lane, 0.0);
        }
        // The source counts from the detection on, with the rates the joints had then.
        double stop_time = 0;
        const int before = (timing.latency + timing.period - 1) / timing.period;
        for (int k = std::max(0, job.tick - before); k <= job.tick; ++k) {
            const double* rates = &path.reaction_state[(std::size_t(k) * 2 + 1) * n];
            for (int f = 0; f < n; ++f)
                stop_time = std::max(stop_time, std::fabs(rates[f]) / motion.acceleration_limit[motion.free_joint[f]]);
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
        set(arm.target, path.velocity, sign);
        set(normal, path.normal, 1);
        set(start, path.start, 1);
        arm.begin(lane, job.leap_tolerance);
        RunningReaction& at = running[lane];
        at = RunningReaction{};
        at.job = &job;
        at.turning_point = job.return_to;
        at.patience = (int((0.05 + 1.5 * stop_time) / motion.step + 1e-9) + 1) * substeps;
        at.here = path.s[std::size_t(job.tick) * timing.period + 1 + timing.latency];
        at.peak = at.here;
        job.distance.assign(1, at.here);
        job.step.assign(1, 0);
    };
    for (int lane = 0; lane < lanes; ++lane) {
        // Lanes without a job of their own stand where the first one began.
        load(lane, jobs[lane < count ? lane : 0]);
        if (lane < count) {
            ++busy;
        } else {
            running[lane].job = nullptr;
        }
    }
    next = busy;
    T speed, distance;
    int most[lanes], gone[lanes];
    while (busy > 0) {
        for (int lane = 0; lane < lanes; ++lane) {
            const RunningReaction& at = running[lane];
            most[lane] = at.job == nullptr ? 0 : longest_leap(at, substeps, only_peak);
            // The time of an arm that has turned ends with a look.
            if (at.turned && at.gone < at.patience) most[lane] = std::min(most[lane], at.patience - at.gone);
        }
        auto look = [&] {
            speed = detail::speed_along(chain, motion, arm.state, arm.posture, contact.point, normal);
            distance = dot(arm.posture.position(contact.point) - start, normal);
        };
        arm.advance(most, gone, look, [&](int lane, int over) {
            // Where a leap went over the top, the speeds at its ends say where that was.
            RunningReaction& at = running[lane];
            const double after = lane_of(speed, lane);
            const int to_step = substeps - at.gone % substeps;
            if (!only_peak || at.homing || over <= to_step || !(at.speed > 0 && after <= 0)) return true;
            at.top = over * at.speed / (at.speed - after);
            return false;
        });
        for (int lane = 0; lane < lanes; ++lane) {
            RunningReaction& at = running[lane];
            if (at.job == nullptr) continue;
            if (!at.started) {
                at.started = true;
                at.speed = lane_of(speed, lane);
                at.top = std::numeric_limits<double>::infinity();
                const double wanted = at.job->path->approach_speed;
                at.astray = arm.poor(lane) || std::fabs(at.speed - wanted) > following_share * wanted;
                continue;
            }
            if (gone[lane] == 0) continue;
            at.gone += gone[lane];
            const double before = at.speed, here = lane_of(distance, lane);
            at.speed = lane_of(speed, lane);
            at.top = at.speed < before ? gone[lane] * at.speed / (before - at.speed)
                                       : std::numeric_limits<double>::infinity();
            at.retreating = here < at.here ? at.retreating + gone[lane] : 0;
            at.here = here;
            if (at.homing) {
                at.lowest = std::min(at.lowest, here);
                // Between two looks it may have been farther than at either.
                const double farthest = here + std::max(0.0, before) * gone[lane] * motion.substep();
                if (farthest > at.peak - std::max(homing_share * (at.peak - at.lowest), homing_distance)) {
                    load(lane, *at.job);
                    at.careful = at.job->came_back = true;
                    continue;
                }
            }
            const bool whole = at.gone % substeps == 0;
            const bool leaves = whole && !only_peak && !stopping && at.turned && here > at.peak &&
                                (!at.astray || at.gone > at.patience);
            at.peak = std::max(at.peak, here);
            if (whole && !at.homing && !leaves) {
                at.job->distance.push_back(here);
                at.job->step.push_back(at.gone / substeps);
            }
            at.astray = at.job->comes_back && (at.astray || arm.poor(lane));
            const bool in_time = at.astray && at.gone < at.patience;
            const bool back = !in_time && (only_peak || here <= at.turning_point);
            const bool retreats = at.retreating >= steps_past_peak * substeps;
            at.turned = at.turned || retreats;
            at.over = at.over || (stopping ? arm.reached(lane) : (only_peak ? at.turned : retreats) && back);
            if (only_peak && !stopping && retreats && !at.over && !at.careful && !at.homing &&
                at.peak - here > homing_distance) {
                at.homing = true;
                at.lowest = here;
                arm.loosen(lane, homing_slack);
            }
            const bool done = whole && (at.over || here > at.job->enough);
            if (!done && !leaves && at.gone < longest_reaction_steps * substeps) continue;
            if (next < count) {
                load(lane, jobs[next++]);
            } else {
                at.job = nullptr;
                --busy;
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
