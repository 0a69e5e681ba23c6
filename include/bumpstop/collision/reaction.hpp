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

// A reaction that stops is followed until it has. One that reverses is followed until the point is back behind
// `return_to(job)`. On the way back nothing brings the point forward again unless a singularity is near: with `only_peak`
// it is enough that the point retreats, and that either no singularity is near or half again the time has passed that
// the slowest joint needs to stop, and 50 ms more: the source's own length of a run after detection.

// No arm needs this many steps; one that cannot reverse near a singularity must not run for ever.
inline constexpr int longest_reaction_steps = 20000;
// The steps about the farthest point tell where between two steps it lies.
inline constexpr int steps_past_peak = 3;

// Arms that brake, one in each lane. While the same joint limits the deceleration the changes of the rates
// are smooth, and a whole simulation step is one leap (see leap.hpp); where they are not, the controller's
// sub-steps are taken.
template <class T>
class BrakingArm {
  public:
    BrakingArm(const Chain& chain, const MotionSettings& motion)
        : chain_(chain), motion_(motion), weights_(motion.substeps) {}

    ArmState<T> state;
    Point3<T> target;       // velocity the reaction asks for; zero: stop
    bool stopping = false;  // the target is zero in all lanes, so no rates need resolving
    MaskOf<T> reached;      // the rates asked for were reached in the last step
    MaskOf<T> poor;         // a singularity was near in it
    Posture<T> posture;     // after it

    void begin() {
        state.refresh_angles(chain_);
        forward_kinematics(chain_, state.q, state.angle, posture);
        history_.known = 0;
        look();
    }

    // One simulation step. `alive[lane]`: the lane still matters.
    void step(const bool* alive) {
        poor = wanted_.conditioning.poor;
        if (history_.known == leap_order && leap(alive)) return;
        reached = reached_now_;
        for (int sub = 0; sub < motion_.substeps; ++sub) {
            if (sub > 0) look();
            reached = advance(chain_, motion_, wanted_.free, state);
            poor = poor | wanted_.conditioning.poor;
            if (any(reached)) history_.known = 0;
            forward_kinematics(chain_, state.q, state.angle, posture);
        }
        look();
        remember();
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;

    // Wanted rates and their limited change where the arm is.
    void look() {
        if (stopping) {
            for (int f = 0; f < motion_.free_count; ++f) wanted_.free[f] = 0.0;
            wanted_.conditioning = {T(0.0) > T(1.0), T(0.0) > T(1.0)};
        } else {
            wanted_ = resolved_rates(chain_, motion_, posture, target);
        }
        reached_now_ = limited_change(motion_, wanted_.free, state, change_);
    }

    void remember() {
        if (any(reached_now_)) history_.known = 0;
        history_.push(change_, motion_.free_count);
    }

    bool leap(const bool* alive) {
        const ArmState<T> before = state;
        const Posture<T> posture_before = posture;
        const Rates<T> wanted_before = wanted_;
        const MaskOf<T> reached_before = reached_now_;
        T change_before[max_joints];
        const double h = motion_.substep();
        for (int f = 0; f < motion_.free_count; ++f) {
            const int j = motion_.free_joint[f];
            change_before[f] = change_[f];
            state.q[j] += h * (double(motion_.substeps) * state.qd[j] + history_.combine(weights_.sum_of_sums, f));
            state.qd[j] += history_.combine(weights_.sum, f);
            state.angle.set(chain_, j, state.q[j]);
        }
        forward_kinematics(chain_, state.q, state.angle, posture);
        look();
        T difference = 0.0, largest = 0.0;
        for (int f = 0; f < motion_.free_count; ++f) {
            difference = maximum(difference, absolute(change_[f] - history_.combine(weights_.predict, f)));
            largest = maximum(largest, absolute(change_[f]));
        }
        const auto lands = difference <= braking_leap_tolerance * largest;
        for (int lane = 0; lane < lanes; ++lane) {
            if (!alive[lane] || (lane_of(lands, lane) && !lane_of(reached_now_, lane))) continue;
            state = before;
            posture = posture_before;
            wanted_ = wanted_before;
            reached_now_ = reached_before;
            for (int f = 0; f < motion_.free_count; ++f) change_[f] = change_before[f];
            history_.known = 0;
            return false;
        }
        reached = T(0.0) > T(1.0);
        history_.push(change_, motion_.free_count);
        return true;
    }

    const Chain& chain_;
    const MotionSettings& motion_;
    const LeapWeights weights_;
    Rates<T> wanted_;
    T change_[max_joints];  // of the rates in the next sub-step
    MaskOf<T> reached_now_;
    RateHistory<T> history_;
};

// Packs the jobs into lanes. `pose_of(job)` gives the joint positions its path started in: held joints keep
// theirs.
template <class T, class PoseOf, class ReturnTo>
void simulate_reactions(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact,
                        const Timing& timing, ReactionKind kind, ReactionJob* jobs, int count, bool only_peak,
                        PoseOf pose_of, ReturnTo return_to) {
    constexpr int lanes = Scalar<T>::lanes;
    const int n = motion.free_count;
    BrakingArm<T> arm(chain, motion);
    arm.stopping = kind == ReactionKind::stop;
    const double sign = arm.stopping ? 0 : -1;
    for (int first = 0; first < count; first += lanes) {
        const int used = count - first < lanes ? count - first : lanes;
        Point3<T> normal, start;
        double turning_point[lanes], last[lanes];
        double patience[lanes];      // steps after which a retreat is believed near a singularity
        int retreating[lanes] = {};  // steps since the farthest point
        bool alive[lanes];
        for (int lane = 0; lane < lanes; ++lane) {
            // Surplus lanes repeat the last job.
            ReactionJob& job = jobs[first + (lane < used ? lane : used - 1)];
            const LinePath& path = *job.path;
            const double* q = pose_of(job);
            const double* rs = &path.reaction_state[std::size_t(job.tick) * 2 * n];
            for (int j = 0; j < chain.dof; ++j) {
                set_lane(arm.state.q[j], lane, q[j]);
                set_lane(arm.state.qd[j], lane, 0.0);
            }
            for (int f = 0; f < n; ++f) {
                set_lane(arm.state.q[motion.free_joint[f]], lane, rs[f]);
                set_lane(arm.state.qd[motion.free_joint[f]], lane, rs[n + f]);
            }
            set_lane(arm.target.x, lane, sign * path.velocity[0]);
            set_lane(arm.target.y, lane, sign * path.velocity[1]);
            set_lane(arm.target.z, lane, sign * path.velocity[2]);
            set_lane(normal.x, lane, path.normal[0]);
            set_lane(normal.y, lane, path.normal[1]);
            set_lane(normal.z, lane, path.normal[2]);
            set_lane(start.x, lane, path.start[0]);
            set_lane(start.y, lane, path.start[1]);
            set_lane(start.z, lane, path.start[2]);
            alive[lane] = lane < used;
            if (!alive[lane]) continue;
            turning_point[lane] = return_to(job);
            double stop_time = 0;
            for (int f = 0; f < n; ++f)
                stop_time = std::max(stop_time, std::fabs(rs[n + f]) / motion.acceleration_limit[motion.free_joint[f]]);
            patience[lane] = (0.05 + 1.5 * stop_time) / motion.step;
            last[lane] = path.s[std::size_t(job.tick) * timing.period + 1 + timing.latency];
            job.distance.assign(1, last[lane]);
        }
        arm.begin();
        bool running = true;
        for (int i = 0; running && i < longest_reaction_steps; ++i) {
            arm.step(alive);
            const T s = dot(arm.posture.position(contact.point) - start, normal);
            running = false;
            for (int lane = 0; lane < used; ++lane) {
                if (!alive[lane]) continue;
                const double here = lane_of(s, lane);
                jobs[first + lane].distance.push_back(here);
                retreating[lane] = here < last[lane] ? retreating[lane] + 1 : 0;
                const bool back =
                    here <= turning_point[lane] || (only_peak && (!lane_of(arm.poor, lane) || i > patience[lane]));
                const bool done =
                    arm.stopping ? lane_of(arm.reached, lane) : retreating[lane] >= steps_past_peak && back;
                if (done) alive[lane] = false;
                last[lane] = here;
                running = running || alive[lane];
            }
        }
    }
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
