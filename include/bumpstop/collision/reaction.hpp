// The path the contact point still travels once the arm reacts.
#pragma once

#include "bumpstop/collision/line_path.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

enum class ReactionKind { stop, reverse };

// One reaction to simulate: that of `tick` on `path`. `distance` receives the distance along the normal after
// each simulation step of the reaction, the first entry being the step in which it begins.
struct ReactionJob {
    const LinePath* path;
    int curve;  // whose number the path is
    int tick;
    std::vector<double> distance;
};

// A reaction that stops is followed until it has. One that reverses is followed until the point is back
// behind `return_to(job)`. On the way back nothing brings the point forward again unless a singularity is
// near: where `only_peak` is set and none is, it is enough that the point has begun to retreat. No arm needs
// this many steps; one that cannot reverse near a singularity must not run for ever.
inline constexpr int longest_reaction_steps = 20000;
// Neighbouring ticks reach their farthest point a step or two apart and are compared at equal steps.
inline constexpr int steps_past_peak = 3;

// Packs the jobs into lanes. `pose_of(job)` gives the joint positions its path started in: held joints keep
// theirs.
template <class T, class PoseOf, class ReturnTo>
void simulate_reactions(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact,
                        const Timing& timing, ReactionKind kind, ReactionJob* jobs, int count, bool only_peak,
                        PoseOf pose_of, ReturnTo return_to) {
    constexpr int lanes = Scalar<T>::lanes;
    const int n = motion.free_count;
    for (int first = 0; first < count; first += lanes) {
        const int used = count - first < lanes ? count - first : lanes;
        ArmState<T> state;
        Point3<T> velocity, normal, start;
        double turning_point[lanes], last[lanes];
        int retreating[lanes] = {};  // steps since the farthest point
        bool alive[lanes];
        for (int lane = 0; lane < lanes; ++lane) {
            // Surplus lanes repeat the last job.
            ReactionJob& job = jobs[first + (lane < used ? lane : used - 1)];
            const LinePath& path = *job.path;
            const double* q = pose_of(job);
            const double* rs = &path.reaction_state[std::size_t(job.tick) * 2 * n];
            for (int j = 0; j < chain.dof; ++j) {
                set_lane(state.q[j], lane, q[j]);
                set_lane(state.qd[j], lane, 0.0);
            }
            for (int f = 0; f < n; ++f) {
                set_lane(state.q[motion.free_joint[f]], lane, rs[f]);
                set_lane(state.qd[motion.free_joint[f]], lane, rs[n + f]);
            }
            const double sign = kind == ReactionKind::reverse ? -1 : 0;
            set_lane(velocity.x, lane, sign * path.velocity[0]);
            set_lane(velocity.y, lane, sign * path.velocity[1]);
            set_lane(velocity.z, lane, sign * path.velocity[2]);
            set_lane(normal.x, lane, path.normal[0]);
            set_lane(normal.y, lane, path.normal[1]);
            set_lane(normal.z, lane, path.normal[2]);
            set_lane(start.x, lane, path.start[0]);
            set_lane(start.y, lane, path.start[1]);
            set_lane(start.z, lane, path.start[2]);
            alive[lane] = lane < used;
            if (!alive[lane]) continue;
            turning_point[lane] = return_to(job);
            last[lane] = path.s[std::size_t(job.tick) * timing.period + 1 + timing.latency];
            job.distance.assign(1, last[lane]);
        }
        state.refresh_angles(chain);
        Posture<T> posture;
        forward_kinematics(chain, state.q, state.angle, posture);
        bool running = true;
        for (int i = 0; running && i < longest_reaction_steps; ++i) {
            auto reached = T(0.0) < T(1.0);
            auto poor = T(0.0) > T(1.0);
            for (int sub = 0; sub < motion.substeps; ++sub) {
                if (kind == ReactionKind::stop) {
                    const T zero[max_joints] = {};
                    reached = advance(chain, motion, zero, state);
                } else {
                    if (sub > 0) forward_kinematics(chain, state.q, state.angle, posture);
                    const Rates<T> rates = resolved_rates(chain, motion, posture, velocity);
                    reached = advance(chain, motion, rates.free, state);
                    poor = poor | rates.conditioning.poor;
                }
            }
            forward_kinematics(chain, state.q, state.angle, posture);
            const T s = dot(posture.position(contact.point) - start, normal);
            running = false;
            for (int lane = 0; lane < used; ++lane) {
                if (!alive[lane]) continue;
                const double here = lane_of(s, lane);
                jobs[first + lane].distance.push_back(here);
                retreating[lane] = here < last[lane] ? retreating[lane] + 1 : 0;
                const bool back = here <= turning_point[lane] || (only_peak && !lane_of(poor, lane));
                const bool done = kind == ReactionKind::stop ? lane_of(reached, lane)
                                                             : retreating[lane] >= steps_past_peak && back;
                if (done) alive[lane] = false;
                last[lane] = here;
                running = running || alive[lane];
            }
        }
    }
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
