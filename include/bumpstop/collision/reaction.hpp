/// @file
/// The path the contact point still travels once the arm reacts.
#pragma once

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
};

/// What of a reaction is wanted. `every_step`: all steps; one that reverses is followed until the point is back behind
/// `return_to(job)`. `only_peak`: steps far from a farthest point may be missing, and a reaction that reverses ends once
/// the point retreats for good: on the way back nothing brings it forward again unless a singularity is near. Near
/// one, it is followed until the reverse rates are reached, or half again the time has passed that the slowest joint
/// needs to stop, and 50 ms more: the source's own length of a run after detection. A reaction that stops is followed
/// until it has.
enum class ReactionDetail { every_step, only_peak };

/// No arm needs this many steps; one that cannot reverse near a singularity must not run for ever.
inline constexpr int longest_reaction_steps = 20000;
/// The steps about the farthest point tell where between two steps it lies.
inline constexpr int steps_past_peak = 3;

/// Arms that brake, one in each lane. While the same joint limits the deceleration the changes of the rates
/// are smooth, and one or more simulation steps are a leap (see leap.hpp); where they are not, the controller's
/// sub-steps are taken.
template <class T>
class BrakingArm {
  public:
    BrakingArm(const Chain& chain, const MotionSettings& motion)
        : chain_(chain), motion_(motion), table_(motion.substeps) {}

    ArmState<T> state;
    Point3<T> target;       ///< velocity the reaction asks for; zero: stop
    bool stopping = false;  ///< the target is zero in all lanes, so no rates need resolving
    MaskOf<T> reached;      ///< the rates asked for were reached in the last step
    MaskOf<T> poor;         ///< a singularity was near in it
    Posture<T> posture;     ///< after it

    void begin() {
        state.refresh_angles(chain_);
        forward_kinematics(chain_, state.q, state.angle, posture);
        history_.forget();
        look();
    }

    /// Goes on by one simulation step or more; returns how many. `alive[lane]`: the lane still matters. A leap over
    /// several steps stands only where `accept(steps)` agrees, which sees state and posture at its end.
    template <class Accept>
    int advance_steps(const bool* alive, Accept accept) {
        poor = wanted_.conditioning.poor;
        if (history_.leaps()) {
            const int steps = leap(alive, accept);
            if (steps > 0) return steps;
        }
        reached = reached_now_;
        for (int sub = 0; sub < motion_.substeps; ++sub) {
            if (sub > 0) look();
            reached = advance(chain_, motion_, wanted_.free, state);
            poor = poor | wanted_.conditioning.poor;
            if (any_alive(reached, alive)) history_.forget();
            forward_kinematics(chain_, state.q, state.angle, posture);
        }
        look();
        if (any_alive(reached_now_, alive)) history_.forget();
        history_.push(change_, motion_.free_count);
        return 1;
    }

    /// Calls visit(i, posture) for the steps i = 1 .. steps - 1 inside the leap that ended last.
    template <class Visit>
    void visit_inside(int steps, Visit visit) const {
        ArmState<T> inside = before_;
        Posture<T> there;
        for (int i = 1; i < steps; ++i) {
            const LeapWeights& weights = table_.after(leapt_.level(), i);
            for (int f = 0; f < motion_.free_count; ++f) {
                const int j = motion_.free_joint[f];
                inside.q[j] = before_.q[j] + motion_.substep() * (double(i * motion_.substeps) * before_.qd[j] +
                                                                  leapt_.combine(weights.sum_of_sums, f));
                inside.angle.set(chain_, j, inside.q[j]);
            }
            forward_kinematics(chain_, inside.q, inside.angle, there);
            visit(i, there);
        }
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;

    static bool any_alive(const MaskOf<T>& mask, const bool* alive) {
        for (int lane = 0; lane < lanes; ++lane) {
            if (alive[lane] && lane_of(mask, lane)) return true;
        }
        return false;
    }

    /// Wanted rates and their limited change where the arm is.
    void look() {
        if (stopping) {
            for (int f = 0; f < motion_.free_count; ++f) wanted_.free[f] = 0.0;
            wanted_.conditioning = {T(0.0) > T(1.0), T(0.0) > T(1.0)};
        } else {
            wanted_ = resolved_rates(chain_, motion_, posture, target);
        }
        reached_now_ = limited_change(motion_, wanted_.free, state, change_);
    }

    /// The longest leap that lands where the changes are those extrapolated, in steps; 0: none does.
    template <class Accept>
    int leap(const bool* alive, Accept accept) {
        before_ = state;
        const Posture<T> posture_before = posture;
        const Rates<T> wanted_before = wanted_;
        const MaskOf<T> reached_before = reached_now_;
        T change_before[max_joints];
        for (int f = 0; f < motion_.free_count; ++f) change_before[f] = change_[f];
        for (;;) {
            const int steps = 1 << history_.level();
            bool close = true;
            if (lands(alive, close) && (steps == 1 || accept(steps))) {
                leapt_ = history_;
                reached = T(0.0) > T(1.0);
                poor = poor | wanted_.conditioning.poor;
                history_.push(change_, motion_.free_count);
                if (close && history_.can_double()) history_.double_stride(motion_.free_count);
                return steps;
            }
            state = before_;
            posture = posture_before;
            wanted_ = wanted_before;
            reached_now_ = reached_before;
            for (int f = 0; f < motion_.free_count; ++f) change_[f] = change_before[f];
            if (history_.level() == 0) {
                history_.forget();
                return 0;
            }
            history_.halve_stride(motion_.free_count);
        }
    }

    bool lands(const bool* alive, bool& close) {
        const LeapWeights& weights = table_.full(history_.level());
        const double sub_steps = motion_.substeps << history_.level();
        for (int f = 0; f < motion_.free_count; ++f) {
            const int j = motion_.free_joint[f];
            state.q[j] = before_.q[j] +
                         motion_.substep() * (sub_steps * before_.qd[j] + history_.combine(weights.sum_of_sums, f));
            state.qd[j] = before_.qd[j] + history_.combine(weights.sum, f);
            state.angle.set(chain_, j, state.q[j]);
        }
        forward_kinematics(chain_, state.q, state.angle, posture);
        look();
        T difference = 0.0, largest = 0.0;
        for (int f = 0; f < motion_.free_count; ++f) {
            difference = maximum(difference, absolute(change_[f] - history_.combine(weights.predict, f)));
            largest = maximum(largest, absolute(change_[f]));
        }
        const auto agrees =
            difference <= (braking_leap_tolerance * (history_.level() > 0 ? long_leap_margin : 1.0)) * largest;
        const auto very_close = difference <= (braking_leap_tolerance * doubling_margin) * largest;
        for (int lane = 0; lane < lanes; ++lane) {
            if (!alive[lane]) continue;
            if (!lane_of(agrees, lane) || lane_of(reached_now_, lane)) return false;
            close = close && lane_of(very_close, lane);
        }
        return true;
    }

    const Chain& chain_;
    const MotionSettings& motion_;
    const LeapTable table_;
    Rates<T> wanted_;
    T change_[max_joints];  ///< of the rates in the next sub-step
    MaskOf<T> reached_now_;
    RateHistory<T> history_, leapt_;  ///< leapt_: as it was when the last leap began
    ArmState<T> before_;              ///< the state then
};

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

/// Packs the jobs into lanes. `pose_of(job)` gives the joint positions its path started in: held joints keep
/// theirs.
template <class T, class PoseOf, class ReturnTo>
void simulate_reactions(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact,
                        const Timing& timing, ReactionKind kind, ReactionJob* jobs, int count, ReactionDetail detail,
                        PoseOf pose_of, ReturnTo return_to) {
    constexpr int lanes = Scalar<T>::lanes;
    const int n = motion.free_count;
    const bool only_peak = detail == ReactionDetail::only_peak;
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
            job.step.assign(1, 0);
        }
        arm.begin();
        T rising = detail::speed_along(chain, motion, arm.state, arm.posture, contact.point, normal);
        for (int i = 0; i < longest_reaction_steps;) {
            bool fill = false;  // some step inside the leap matters
            T speed = rising;
            const int steps = arm.advance_steps(alive, [&](int over) {
                speed = detail::speed_along(chain, motion, arm.state, arm.posture, contact.point, normal);
                fill = !only_peak;
                for (int lane = 0; lane < used; ++lane)
                    fill = fill || (alive[lane] && lane_of(rising, lane) >= 0 && lane_of(speed, lane) <= 0);
                // The farthest point wants four steps in a row about it.
                return !fill || !only_peak || over > 2;
            });
            if (steps == 1 || !only_peak)
                speed = detail::speed_along(chain, motion, arm.state, arm.posture, contact.point, normal);
            rising = speed;
            auto record = [&](int step, const Posture<T>& posture) {
                const T s = dot(posture.position(contact.point) - start, normal);
                for (int lane = 0; lane < used; ++lane) {
                    if (!alive[lane]) continue;
                    jobs[first + lane].distance.push_back(lane_of(s, lane));
                    jobs[first + lane].step.push_back(step);
                }
            };
            if (fill)
                arm.visit_inside(steps, [&](int inside, const Posture<T>& posture) { record(i + inside, posture); });
            i += steps;
            record(i, arm.posture);
            bool running = false;
            for (int lane = 0; lane < used; ++lane) {
                if (!alive[lane]) continue;
                const double here = jobs[first + lane].distance.back();
                retreating[lane] = here < last[lane] ? retreating[lane] + steps : 0;
                const bool back =
                    here <= turning_point[lane] ||
                    (only_peak && (!lane_of(arm.poor, lane) || lane_of(arm.reached, lane) || i > patience[lane]));
                const bool done =
                    arm.stopping ? lane_of(arm.reached, lane) : retreating[lane] >= steps_past_peak && back;
                if (done) alive[lane] = false;
                last[lane] = here;
                running = running || alive[lane];
            }
            if (!running) break;
        }
    }
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
