/// @file
/// Traces paths along lines with Adams steps of variable length until a criterion ends them.
#pragma once

#include <numeric>

#include "bumpstop/collision/motion/arm_integrator.hpp"
#include "bumpstop/collision/motion/line_path.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// A line to follow.
struct LineRequest {
    const double* q = nullptr;  ///< joint positions at the start [rad or m]
    Vector3 velocity{};         ///< of the tool, base frame [m/s]

    double speed() const {
        return std::sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1] + velocity[2] * velocity[2]);
    }
};

namespace detail {

/// Ends a path at its last recorded step, where the joints have positions `q` and rates `qd`, both by joint. From there
/// the arm brakes to standstill by its deceleration law, as in a reaction that stops. No tick follows, and no reaction
/// to an earlier tick begins any more: a longer latency must not let an arm stop at once.
/// `met_step`: the step in which the limit or the singularity is met. Where that is after the end of the motion, in the
/// part of the line that only reactions need, it is not what ends the motion.
inline void cut_line(const CollisionSetup& setup, PathEnd why, int met_step, const double* q, const double* qd,
                     LinePath& path) {
    const Chain& chain = setup.chain;
    const MotionSettings& motion = setup.motion;
    path.cut_step = int(path.s.size()) - 1;
    if (path.end == PathEnd::motion_end && met_step <= setup.timing.steps) path.end = why;
    const int n = motion.free_count;
    double rate[max_joints];
    for (int f = 0; f < n; ++f) rate[f] = qd[motion.free_joint[f]];
    const BrakeProfile profile = brake_profile(chain, motion, q, rate, false);
    const int longest = max_reaction_steps(profile.stop_time, path.s.size(), motion.step, motion.substeps);
    const InverseMaxRateChange full(motion);
    static constexpr double standstill[max_joints] = {};
    ArmState<double> state;
    std::copy_n(q, chain.dof, state.q);
    std::copy_n(qd, chain.dof, state.qd);
    double substep = 0;
    bool at_rest = std::all_of(rate, rate + n, [](double r) { return r == 0; });
    while (!at_rest && int(path.braking.size()) < longest) {
        for (int sub = 0; sub < motion.substeps; ++sub, ++substep) {
            double change[max_joints] = {}, saturation[max_joints], tightened[max_joints];
            for (int f = 0; f < n; ++f) tightened[f] = 1 / profile.of(f, substep);
            at_rest = limited_change(motion, full, standstill, state, change, saturation, tightened,
                                     motion.deceleration.independent);
            for (int f = 0; f < n; ++f) {
                const int j = motion.free_joint[f];
                state.qd[j] += change[f];
                state.q[j] += motion.substep() * state.qd[j];
            }
        }
        Posture<double> posture;
        state.refresh_angles(chain);
        forward_kinematics(chain, state.q, state.angle, posture);
        path.braking.push_back(
            dot(posture.position(setup.contact.point) - point3<double>(path.start), point3<double>(path.normal)));
    }
}

}  // namespace detail

/// The criterion that never ends a line early.
template <class T>
struct NoCriterion {
    void observe(const T&, const T*) {}
    bool finished(int) { return false; }
};

/// Tolerances of a traced line: of the rate changes while the arm lags behind its line, and of the rates once it has
/// the wanted ones, both relative to the largest.
struct LineTolerance {
    double lag, rate;
};
/// For single distributions: positions after a second at 1 rad/s agree with those of the sub-steps to 1e-10 rad.
inline constexpr LineTolerance exact_line{1e-10, 1e-11};
inline constexpr LineTolerance batch_line{3e-7, batch_rate_tolerance};

/// Traces lines, one in each lane; a lane takes the next line as soon as its own is finished. Positions inside an Adams
/// step come from its polynomial, evaluated for several steps of one lane at a time, one in each lane of a register.
///
/// `Criterion` tells when a line needs no further tick. `observe(s, torque_per_N)` gets steps of one line, one in each
/// lane: distances along the normal [m] and contact torques by joint [Nm/N or 1]. Then `finished(lane)` is called for
/// those of the steps that are ticks, in order.
template <class T, class Criterion>
class LineTracer {
    using Arm = ArmIntegrator<T>;

  public:
    explicit LineTracer(const CollisionSetup& setup, LineTolerance tolerance = exact_line)
        : setup_(setup),
          tolerance_(tolerance),
          chain_(setup.chain),
          motion_(setup.motion),
          timing_(setup.timing),
          stride_(timing_.latency > 0 ? std::gcd(timing_.period, timing_.latency) : timing_.period),
          arm_(chain_, motion_, Arm::Kind::trace) {}

    /// Traces line i of `count` into paths[i], until criteria[i] ends it.
    void trace(const LineRequest* requests, Criterion* criteria, LinePath* paths, int count) {
        begin(requests, paths, count);
        int busy = std::min(lanes, count), next = busy;
        for (int lane = 0; lane < lanes; ++lane) {
            // Lanes without a line of their own hold the start of the last one.
            load(lane, requests, criteria, paths, std::min(lane, count - 1));
            if (lane >= count) lane_[lane].path = nullptr;
        }
        T max_step = 0.0, margin = 0.0;
        auto observe = [&] { margin = detail::min_limit_margin(motion_, arm_.state.q); };
        auto rejected = [](const auto&, const T&) { return mask_of<T>(false); };
        while (busy > 0) {
            allow_interruption();
            for (int lane = 0; lane < lanes; ++lane) set_lane(max_step, lane, double(max_substeps(lane)));
            const T taken = arm_.step(max_step, observe, rejected);
            for (int lane = 0; lane < lanes; ++lane) {
                Lane& at = lane_[lane];
                if (at.path == nullptr || (at.begun && lane_of(taken, lane) == 0)) continue;
                at.begun = true;
                if (record_step(lane, int(lane_of(taken, lane)), lane_of(margin, lane))) continue;
                if (next < count) {
                    load(lane, requests, criteria, paths, next++);
                } else {
                    --busy;
                }
            }
        }
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;
    static constexpr int min_smooth_strides = 3;

    struct Lane {
        LinePath* path = nullptr;  ///< null: the lane is finished
        Criterion* criterion = nullptr;
        int taken = 0;  ///< sub-steps so far
        int last_step = 0;
        bool begun = false;  ///< the start has been evaluated
        bool keep_every_step = false;
        int smooth_from = 0;  ///< since this step the arm has followed its line smoothly
        Point3<T> start, normal;
        double q[max_joints];                            ///< start positions by joint: those of held joints stay
        double last_q[max_joints], last_qd[max_joints];  ///< of the free joints at the last step written
        int next_step = 0;                               ///< the first step that has not been recorded
        int pending = 0;  ///< recorded steps that are not written yet: at most a register
        int step[lanes];  ///< their numbers
        T pending_q[max_joints], pending_qd[max_joints];  ///< of the free joints there
    };

    /// Starts all paths, and stores the rates at their starts.
    void begin(const LineRequest* requests, LinePath* paths, int count) {
        first_rate_.resize(std::size_t(count) * chain_.dof);
        for (int first = 0; first < count; first += lanes) {
            const int here = std::min(lanes, count - first);
            T q[max_joints];
            Point3<T> velocity;
            for (int lane = 0; lane < lanes; ++lane) {
                const LineRequest& request = requests[first + std::min(lane, here - 1)];
                for (int j = 0; j < chain_.dof; ++j) set_lane(q[j], lane, request.q[j]);
                set_lane(velocity, lane, request.velocity);
            }
            const LineStart<T> line = begin_line(setup_, q, velocity, paths + first, here);
            for (int lane = 0; lane < here; ++lane) {
                for (int j = 0; j < chain_.dof; ++j)
                    first_rate_[std::size_t(first + lane) * chain_.dof + j] = lane_of(line.state.qd[j], lane);
            }
        }
    }

    void load(int lane, const LineRequest* requests, Criterion* criteria, LinePath* paths, int i) {
        const LinePath& path = paths[i];
        for (int j = 0; j < chain_.dof; ++j) {
            set_lane(arm_.state.q[j], lane, requests[i].q[j]);
            set_lane(arm_.state.qd[j], lane, first_rate_[std::size_t(i) * chain_.dof + j]);
        }
        set_lane(arm_.target, lane, path.velocity);
        arm_.begin(lane, tolerance_.lag, tolerance_.rate);
        Lane& at = lane_[lane];
        at = Lane{};
        at.path = &paths[i];
        at.criterion = &criteria[i];
        at.last_step = timing_.steps + timing_.latency;
        at.start = point3<T>(path.start);
        at.normal = point3<T>(path.normal);
        std::copy_n(requests[i].q, chain_.dof, at.q);
    }

    int max_substeps(int lane) const {
        const Lane& at = lane_[lane];
        if (at.path == nullptr) return 0;
        // Singularities are checked at the ends of simulation steps.
        if (lane_of(arm_.near_singular(), lane)) return motion_.substeps - at.taken % motion_.substeps;
        return std::min(max_line_adams_step, at.last_step * motion_.substeps - at.taken);
    }

    /// The next step that a lane records, if it is not after `last`: the end of its next stride, where the distances
    /// within the stride can be interpolated from the ends of this and the three strides before.
    int next_recorded(const Lane& at, int last) const {
        const int step = at.next_step;
        if (at.keep_every_step || step <= 1 + 2 * stride_) return step;
        // The Adams step that covers the stride is lost later, so an incomplete stride is recorded step by step.
        const bool begins = (step - 2) % stride_ == 0, ends = step - 1 + stride_ <= last;
        return begins && ends && step - 1 - 2 * stride_ >= at.smooth_from ? step - 1 + stride_ : step;
    }

    /// Records the steps that a lane has passed and writes them once there are enough. False: its path is over.
    bool record_step(int lane, int taken, double margin) {
        Lane& at = lane_[lane];
        LinePath& path = *at.path;
        at.taken += taken;
        path.velocity_limited = path.velocity_limited || arm_.limited(lane);
        path.met_singularity = path.met_singularity || lane_of(arm_.near_singular(), lane);
        const bool singular = at.taken % motion_.substeps == 0 && arm_.singular(lane);
        const int last = at.taken / motion_.substeps;
        // The step in which the line ends is found step by step; recording every step begins well before it, so that
        // the step before it is still within the last Adams step.
        at.keep_every_step = at.keep_every_step || lane_of(arm_.near_singular(), lane) || margin < 0.05;
        // A cubic is accurate enough within a stride only where the Adams steps are several strides long.
        if (!arm_.smooth(lane) || taken < min_smooth_strides * stride_ * motion_.substeps) at.smooth_from = last + 1;
        int wanted[lanes], known = 0;
        for (int step = next_recorded(at, last); step <= last; step = next_recorded(at, last)) {
            wanted[known++] = step;
            at.next_step = step + 1;
            if (at.pending + known == lanes) {
                record(lane, wanted, known);
                if (!flush(lane)) return false;
                known = 0;
            }
        }
        if (known > 0) record(lane, wanted, known);
        const bool enough = 2 * at.pending >= lanes || singular || last >= at.last_step;
        if (enough && !flush(lane)) return false;
        if (singular) {
            cut(lane, PathEnd::singularity, last);
            at.path = nullptr;
        }
        return at.path != nullptr;
    }

    /// Records the states of a lane at these steps of its last Adams step, in order.
    void record(int lane, const int* steps, int count) {
        Lane& at = lane_[lane];
        if (count == 1 && steps[0] * motion_.substeps == at.taken) {
            // The end of the Adams step, where the arm is.
            const int to = at.pending++;
            at.step[to] = steps[0];
            for (int f = 0; f < motion_.free_count; ++f) {
                const int j = motion_.free_joint[f];
                set_lane(at.pending_q[f], to, lane_of(arm_.state.q[j], lane));
                set_lane(at.pending_qd[f], to, lane_of(arm_.state.qd[j], lane));
            }
            return;
        }
        T back, q[max_joints], qd[max_joints];
        for (int i = 0; i < lanes; ++i)
            set_lane(back, i, double(at.taken - steps[std::min(i, count - 1)] * motion_.substeps));
        arm_.before(lane, back, q, qd);
        if (at.pending == 0) {
            std::copy_n(q, motion_.free_count, at.pending_q);
            std::copy_n(qd, motion_.free_count, at.pending_qd);
            std::copy_n(steps, count, at.step);
            at.pending = count;
            return;
        }
        for (int i = 0; i < count; ++i) {
            const int to = at.pending++;
            at.step[to] = steps[i];
            for (int f = 0; f < motion_.free_count; ++f) {
                set_lane(at.pending_q[f], to, lane_of(q[f], i));
                set_lane(at.pending_qd[f], to, lane_of(qd[f], i));
            }
        }
    }

    /// Writes the pending steps of a lane. False when its path is over.
    bool flush(int lane) {
        Lane& at = lane_[lane];
        const int count = at.pending, n = motion_.free_count;
        at.pending = 0;
        if (count == 0) return true;
        T q[max_joints];
        for (int j = 0; j < chain_.dof; ++j) q[j] = at.q[j];
        for (int f = 0; f < n; ++f) q[motion_.free_joint[f]] = at.pending_q[f];
        JointAngles<T> angle;
        for (int j = 0; j < chain_.dof; ++j) angle.set(chain_, j, q[j]);
        Posture<T> posture;
        forward_kinematics(chain_, q, angle, posture);
        const Point3<T> point = posture.position(setup_.contact.point);
        const T s = dot(point - at.start, at.normal);
        const T margin = detail::min_limit_margin(motion_, q);
        T torque[max_joints];
        for (int j = 0; j < chain_.dof; ++j)
            torque[j] =
                j > setup_.contact.point.link ? T(0.0) : dot(linear_column(chain_, posture, point, j), at.normal);
        at.criterion->observe(s, torque);
        for (int i = 0; i < count; ++i) {
            if (lane_of(margin, i) < 0) {
                for (int f = 0; f < n; ++f) {
                    const int j = motion_.free_joint[f];
                    if (detail::limit_margin(motion_, j, lane_of(q[j], i)) < 0) at.path->end_joint = j;
                }
                cut(lane, PathEnd::joint_limit, at.step[i]);
                at.path = nullptr;
                return false;
            }
            write(lane, at.step[i], i, s, torque);
            if (at.step[i] < at.last_step) continue;
            at.path = nullptr;
            return false;
        }
        return true;
    }

    /// Ends the path of a lane at its last written step, from where the arm brakes.
    void cut(int lane, PathEnd why, int met_step) {
        const Lane& at = lane_[lane];
        double q[max_joints], qd[max_joints] = {};
        std::copy_n(at.q, chain_.dof, q);
        for (int f = 0; f < motion_.free_count; ++f) {
            q[motion_.free_joint[f]] = at.last_q[f];
            qd[motion_.free_joint[f]] = at.last_qd[f];
        }
        detail::cut_line(setup_, why, met_step, q, qd, *at.path);
    }

    void write(int lane, int step, int i, const T& s, const T* torque) {
        Lane& at = lane_[lane];
        LinePath& path = *at.path;
        const int n = motion_.free_count;
        if (int(path.s.size()) < step) detail::fill_stride(path.s, stride_, lane_of(s, i));
        path.s.push_back(lane_of(s, i));
        for (int f = 0; f < n; ++f) {
            at.last_q[f] = lane_of(at.pending_q[f], i);
            at.last_qd[f] = lane_of(at.pending_qd[f], i);
        }
        const int after_first = step - 1;
        const bool tick = after_first >= 0 && after_first % timing_.period == 0 && after_first < timing_.steps;
        if (tick && path.end != PathEnd::all_detected) {
            ++path.ticks;
            double* to = append(path.torque_per_N, chain_.dof);
            for (int j = 0; j < chain_.dof; ++j) to[j] = lane_of(torque[j], i);
            if (at.criterion->finished(i)) {
                path.end = PathEnd::all_detected;
                at.last_step = step + timing_.latency;
            }
        }
        const int after_latency = after_first - timing_.latency;
        const bool due = after_first == 0 || (after_first > 0 && after_latency % timing_.period == 0);
        if (due && (after_latency < 0 || int(path.reaction_state.size()) < 2 * n * path.ticks)) {
            double* to = append(after_latency < 0 ? path.early_state : path.reaction_state, 2 * n);
            for (int f = 0; f < n; ++f) to[f] = at.last_q[f];
            for (int f = 0; f < n; ++f) to[n + f] = at.last_qd[f];
        }
    }

    /// Appends `count` values, to be written by the caller.
    static double* append(std::vector<double>& values, int count) {
        values.resize(values.size() + std::size_t(count));
        return &values[values.size() - std::size_t(count)];
    }

    const CollisionSetup& setup_;
    const LineTolerance tolerance_;
    const Chain& chain_;
    const MotionSettings& motion_;
    const Timing& timing_;
    const int stride_;  ///< steps between those a path must have: ticks, and beginnings of reactions
    Arm arm_;
    Lane lane_[lanes];
    std::vector<double> first_rate_;  ///< [line][dof]
};

/// The path of one line.
template <class T, class Criterion>
LinePath trace_line(const CollisionSetup& setup, const LineRequest& request, Criterion criterion) {
    LinePath path;
    LineTracer<T, Criterion>(setup).trace(&request, &criterion, &path, 1);
    return path;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
