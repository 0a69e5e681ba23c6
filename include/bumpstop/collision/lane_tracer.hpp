/// @file
/// Paths of many poses, each lane with leaps of its own length.
#pragma once

#include <numeric>

#include "bumpstop/collision/braking_arm.hpp"
#include "bumpstop/collision/line_end.hpp"
#include "bumpstop/collision/outcomes.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// A line to follow, until a body at `largest_offset` would have been noticed for certain.
struct LineJob {
    const double* q = nullptr;  ///< joint positions it starts in
    Vector3 velocity{};         ///< of the tool [m/s]
    double largest_offset = 0;  ///< m
};

/// Some of them in the lanes of a register; those beyond the last hold it once more.
template <class T>
struct LineLanes {
    T q[max_joints], largest_offset;
    Point3<T> velocity;

    LineLanes(const LineJob* jobs, int count, int dof) {
        for (int lane = 0; lane < Scalar<T>::lanes; ++lane) {
            const LineJob& job = jobs[std::min(lane, count - 1)];
            for (int j = 0; j < dof; ++j) set_lane(q[j], lane, job.q[j]);
            set_lane(largest_offset, lane, job.largest_offset);
            set_lane(velocity.x, lane, job.velocity[0]);
            set_lane(velocity.y, lane, job.velocity[1]);
            set_lane(velocity.z, lane, job.velocity[2]);
        }
    }
};

/// What `LineTracer` with `CertainDetection` finds, for a detector whose noise and residual remember nothing. Lanes whose
/// joints lag behind, because their accelerations are limited, leap as well, and no lane waits for another: each takes the
/// next line as soon as it is done with one. Positions inside a leap are read from its polynomial, a register of moments of
/// one lane at a time.
template <class T>
class LaneTracer {
    using Arm = BrakingArm<T, loose_braking_order>;

  public:
    LaneTracer(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact, const Timing& timing,
               const ThresholdDetector& detector, double stiffness)
        : chain_(chain),
          motion_(motion),
          contact_(contact),
          timing_(timing),
          detector_(detector),
          stiffness_(stiffness),
          stride_(timing.latency > 0 ? std::gcd(timing.period, timing.latency) : timing.period),
          arm_(chain, motion, Arm::Kind::traces) {}

    /// As of `LineTracer::trace`, for any number of lines.
    void trace(const LineJob* jobs, LinePath* paths, int count) {
        begin(jobs, paths, count);
        int busy = std::min(lanes, count), next = busy;
        for (int lane = 0; lane < lanes; ++lane) {
            // Lanes without a line of their own stand where the last one began.
            load(lane, jobs, paths, std::min(lane, count - 1));
            if (lane >= count) lane_[lane].path = nullptr;
        }
        T most, margin;
        auto look = [&] { margin = detail::least_margin(motion_, arm_.state.q); };
        auto refused = [](const auto&, const T&) { return T(0.0) > T(1.0); };
        while (busy > 0) {
            allow_interruption();
            for (int lane = 0; lane < lanes; ++lane) set_lane(most, lane, double(longest(lane)));
            const T gone = arm_.advance(most, look, refused);
            for (int lane = 0; lane < lanes; ++lane) {
                Lane& at = lane_[lane];
                if (at.path == nullptr || (at.begun && lane_of(gone, lane) == 0)) continue;
                at.begun = true;
                if (take(lane, int(lane_of(gone, lane)), lane_of(margin, lane))) continue;
                if (next < count) {
                    load(lane, jobs, paths, next++);
                } else {
                    --busy;
                }
            }
        }
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;

    struct Lane {
        LinePath* path = nullptr;  ///< null: the lane is done
        int gone = 0;              ///< sub-steps
        int last_step = 0;
        bool begun = false;    ///< the arm has been looked at
        bool careful = false;  ///< every step is kept
        double largest_offset = 0;
        double survival = 1;  ///< of the farthest body
        Point3<T> start, normal;
        double q[max_joints];                            ///< where held joints stay
        double last_q[max_joints], last_qd[max_joints];  ///< of the free joints at the last step written
        int next_step = 0;                               ///< none before it is still to be kept
        int waiting = 0;  ///< moments that wait to be written, until they fill a register
        int step[lanes];  ///< of those
        T waiting_q[max_joints], waiting_qd[max_joints];  ///< of the free joints then
    };

    /// Begins all paths, and keeps the rates they begin with.
    void begin(const LineJob* jobs, LinePath* paths, int count) {
        first_rate_.resize(std::size_t(count) * chain_.dof);
        least_square_.resize(std::size_t(count));
        for (int first = 0; first < count; first += lanes) {
            const int here = std::min(lanes, count - first);
            const LineLanes<T> start(jobs + first, here, chain_.dof);
            const LineStart<T> line =
                begin_line(chain_, motion_, contact_, timing_, start.q, start.velocity, paths + first, here);
            for (int lane = 0; lane < here; ++lane) {
                least_square_[std::size_t(first + lane)] = lane_of(line.rates.conditioning.least_square, lane);
                for (int j = 0; j < chain_.dof; ++j)
                    first_rate_[std::size_t(first + lane) * chain_.dof + j] = lane_of(line.state.qd[j], lane);
            }
        }
    }

    void load(int lane, const LineJob* jobs, LinePath* paths, int i) {
        const LinePath& path = paths[i];
        for (int j = 0; j < chain_.dof; ++j) {
            set_lane(arm_.state.q[j], lane, jobs[i].q[j]);
            set_lane(arm_.state.qd[j], lane, first_rate_[std::size_t(i) * chain_.dof + j]);
        }
        set_lane(arm_.target.x, lane, path.velocity[0]);
        set_lane(arm_.target.y, lane, path.velocity[1]);
        set_lane(arm_.target.z, lane, path.velocity[2]);
        arm_.begin(lane, tracing_leap_tolerance, least_square_[std::size_t(i)]);
        Lane& at = lane_[lane];
        at = Lane{};
        at.path = &paths[i];
        at.last_step = timing_.steps + timing_.latency;
        at.largest_offset = jobs[i].largest_offset;
        at.start = {T(path.start[0]), T(path.start[1]), T(path.start[2])};
        at.normal = {T(path.normal[0]), T(path.normal[1]), T(path.normal[2])};
        std::copy_n(jobs[i].q, chain_.dof, at.q);
    }

    int longest(int lane) const {
        const Lane& at = lane_[lane];
        if (at.path == nullptr) return 0;
        // Whether a singularity is met is asked where a step ends.
        if (lane_of(arm_.poor(), lane)) return motion_.substeps - at.gone % motion_.substeps;
        return std::min(longest_braking_leap, at.last_step * motion_.substeps - at.gone);
    }

    /// The first steps are looked at one by one, and those about the end of a motion that nothing was noticed in; those
    /// between other moments are interpolated.
    bool every_step(const Lane& at, int step) const {
        if (step <= 1 + 2 * stride_) return true;
        const int before_end = timing_.steps - (timing_.steps - 1) % stride_;
        return at.path->end == PathEnd::horizon && step > before_end && step <= before_end + stride_;
    }

    /// Keeps the moments a lane has passed, and writes them as soon as there are enough. False when its path is over.
    bool take(int lane, int gone, double margin) {
        Lane& at = lane_[lane];
        LinePath& path = *at.path;
        at.gone += gone;
        path.velocity_limited = path.velocity_limited || arm_.limited(lane);
        path.met_singularity = path.met_singularity || lane_of(arm_.poor(), lane);
        const bool singular = at.gone % motion_.substeps == 0 && arm_.singular(lane);
        const int last = at.gone / motion_.substeps;
        // Where it will end is found step by step, and so that no step lies far behind, from well before on.
        at.careful = at.careful || lane_of(arm_.poor(), lane) || margin < 0.05;
        // After the last moment that a path keeps, the steps to its end are looked at one by one.
        const int last_kept = at.last_step - (at.last_step - 1) % stride_;
        int wanted[lanes], known = 0;
        for (int step = at.next_step; step <= last; ++step) {
            if (!at.careful && !every_step(at, step) && step <= last_kept)
                step += stride_ - 1 - (step + stride_ - 2) % stride_;
            if (step > last) break;
            wanted[known++] = step;
            at.next_step = step + 1;
            if (at.waiting + known == lanes) {
                keep(lane, wanted, known);
                if (!write_waiting(lane)) return false;
                known = 0;
            }
        }
        if (known > 0) keep(lane, wanted, known);
        const bool enough = 2 * at.waiting >= lanes || singular || last >= at.last_step;
        if (enough && !write_waiting(lane)) return false;
        if (singular) {
            cut(lane, PathEnd::singularity, last);
            at.path = nullptr;
        }
        return at.path != nullptr;
    }

    /// Where a lane was at these steps of its last leap, in order.
    void keep(int lane, const int* steps, int count) {
        Lane& at = lane_[lane];
        if (count == 1 && steps[0] * motion_.substeps == at.gone) {
            // The end of the leap, where the arm is.
            const int to = at.waiting++;
            at.step[to] = steps[0];
            for (int f = 0; f < motion_.free_count; ++f) {
                const int j = motion_.free_joint[f];
                set_lane(at.waiting_q[f], to, lane_of(arm_.state.q[j], lane));
                set_lane(at.waiting_qd[f], to, lane_of(arm_.state.qd[j], lane));
            }
            return;
        }
        T back, q[max_joints], qd[max_joints];
        for (int i = 0; i < lanes; ++i)
            set_lane(back, i, double(at.gone - steps[std::min(i, count - 1)] * motion_.substeps));
        arm_.before(lane, back, q, qd);
        if (at.waiting == 0) {
            std::copy_n(q, motion_.free_count, at.waiting_q);
            std::copy_n(qd, motion_.free_count, at.waiting_qd);
            std::copy_n(steps, count, at.step);
            at.waiting = count;
            return;
        }
        for (int i = 0; i < count; ++i) {
            const int to = at.waiting++;
            at.step[to] = steps[i];
            for (int f = 0; f < motion_.free_count; ++f) {
                set_lane(at.waiting_q[f], to, lane_of(q[f], i));
                set_lane(at.waiting_qd[f], to, lane_of(qd[f], i));
            }
        }
    }

    /// Writes the moments of a lane that wait. False when its path is over.
    bool write_waiting(int lane) {
        Lane& at = lane_[lane];
        const int count = at.waiting, n = motion_.free_count;
        at.waiting = 0;
        if (count == 0) return true;
        T q[max_joints];
        for (int j = 0; j < chain_.dof; ++j) q[j] = at.q[j];
        for (int f = 0; f < n; ++f) q[motion_.free_joint[f]] = at.waiting_q[f];
        JointAngles<T> angle;
        for (int j = 0; j < chain_.dof; ++j) angle.set(chain_, j, q[j]);
        Posture<T> posture;
        forward_kinematics(chain_, q, angle, posture);
        const Point3<T> point = posture.position(contact_.point);
        const T s = dot(point - at.start, at.normal);
        const T margin = detail::least_margin(motion_, q);
        T torque[max_joints];
        for (int j = 0; j < chain_.dof; ++j)
            torque[j] = j > contact_.point.link ? T(0.0) : dot(linear_column(chain_, posture, point, j), at.normal);
        const T silent = silence(lane, s, torque);
        for (int i = 0; i < count; ++i) {
            if (lane_of(margin, i) < 0) {
                at.path->end_joint = detail::joint_at_limit(motion_, [&](int j) { return lane_of(q[j], i); });
                cut(lane, PathEnd::joint_limit, at.step[i]);
                at.path = nullptr;
                return false;
            }
            write(lane, at.step[i], i, s, torque, lane_of(silent, i), at.waiting_q, at.waiting_qd);
            if (at.step[i] < at.last_step) continue;
            at.path = nullptr;
            return false;
        }
        return true;
    }

    /// From the last step written on the arm of a lane brakes.
    void cut(int lane, PathEnd why, int met_step) {
        const Lane& at = lane_[lane];
        double q[max_joints], qd[max_joints] = {};
        std::copy_n(at.q, chain_.dof, q);
        for (int f = 0; f < motion_.free_count; ++f) {
            q[motion_.free_joint[f]] = at.last_q[f];
            qd[motion_.free_joint[f]] = at.last_qd[f];
        }
        detail::cut_line(
            chain_, motion_, contact_, timing_, why, met_step, [&](int j) { return q[j]; },
            [&](int j) { return qd[j]; }, *at.path);
    }

    /// Probability that a body at the largest offset goes unnoticed at each of a lane's moments.
    T silence(int lane, const T& s, const T* torque) const {
        const T force = maximum(s - lane_[lane].largest_offset, T(0.0)) * stiffness_;
        const auto touched = force > T(0.0);
        if (!any(touched)) return 1.0;
        const auto chance = any_alarm<T>(detector_, [&](int w) { return torque[detector_.joint[w]] * force; });
        return select(touched, chance.silent, T(1.0));
    }

    void write(int lane, int step, int i, const T& s, const T* torque, double silent, const T* q, const T* qd) {
        Lane& at = lane_[lane];
        LinePath& path = *at.path;
        const int n = motion_.free_count;
        if (int(path.s.size()) < step) detail::fill_stride(path.s, stride_, lane_of(s, i));
        path.s.push_back(lane_of(s, i));
        for (int f = 0; f < n; ++f) {
            at.last_q[f] = lane_of(q[f], i);
            at.last_qd[f] = lane_of(qd[f], i);
        }
        const int after_first = step - 1;
        const bool tick = after_first >= 0 && after_first % timing_.period == 0 && after_first < timing_.steps;
        if (tick && path.end != PathEnd::certain_detection) {
            const double time = (double(path.ticks) * timing_.period + 1) * motion_.step;
            ++path.ticks;
            double* to = added(path.torque_per_N, chain_.dof);
            for (int j = 0; j < chain_.dof; ++j) to[j] = lane_of(torque[j], i);
            if (detector_.armed(time)) at.survival *= silent;
            if (at.survival < certain_survival) {
                path.end = PathEnd::certain_detection;
                at.last_step = step + timing_.latency;
            }
        }
        const int after_latency = after_first - timing_.latency;
        const bool due = after_first == 0 || (after_first > 0 && after_latency % timing_.period == 0);
        if (due && (after_latency < 0 || int(path.reaction_state.size()) < 2 * n * path.ticks)) {
            double* to = added(after_latency < 0 ? path.early_state : path.reaction_state, 2 * n);
            for (int f = 0; f < n; ++f) to[f] = lane_of(q[f], i);
            for (int f = 0; f < n; ++f) to[n + f] = lane_of(qd[f], i);
        }
    }

    /// Where so many values more may be written.
    static double* added(std::vector<double>& values, int count) {
        values.resize(values.size() + std::size_t(count));
        return &values[values.size() - std::size_t(count)];
    }

    const Chain& chain_;
    const MotionSettings& motion_;
    const ContactGeometry& contact_;
    const Timing& timing_;
    const ThresholdDetector& detector_;
    const double stiffness_;
    const int stride_;  ///< steps between the moments a path keeps: ticks, and beginnings of reactions
    Arm arm_;
    Lane lane_[lanes];
    std::vector<double> first_rate_;    ///< [line][dof]
    std::vector<double> least_square_;  ///< [line]: as of Conditioning where it begins
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
