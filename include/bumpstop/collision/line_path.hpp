/// @file
/// The undisturbed path of the contact point along the line, traced once for a register full of poses.
#pragma once

#include <limits>
#include <numeric>
#include <vector>

#include "bumpstop/collision/leap.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Where and in which direction the arm hits.
struct ContactGeometry {
    LinkPoint point;
    bool along_motion = true;  ///< the normal is the direction in which the point moves at the start
    Vector3 normal{};          ///< else this unit vector, base frame
};

/// How long the path is and how often the detector looks.
struct Timing {
    int steps = 5000;  ///< horizon in simulation steps
    int period = 4;    ///< steps between two feedback ticks
    int latency = 0;   ///< steps from a tick to the beginning of the reaction
    bool from_rest = false;
};

/// The arm stops following the line when ...
enum class PathEnd { horizon, joint_limit, singularity, certain_detection };

/// One pose's path, all that the force law needs of it.
struct LinePath {
    int dof = 0, free_count = 0;
    int ticks = 0;
    std::vector<double> s;               ///< distance along the normal after step i; s[0] = 0 [m]
    std::vector<double> torque_per_N;    ///< [tick][dof]: J_v' n at the tick
    std::vector<double> reaction_state;  ///< [tick][free]: q then qd at the step in which the reaction would begin
    Vector3 start{}, normal{}, velocity{};
    double approach_speed = 0;  ///< of the point along the normal when the motion has its full speed [m/s]
    PathEnd end = PathEnd::horizon;
    int end_joint = -1;
    bool velocity_limited = false;  ///< a joint-velocity limit slowed the motion somewhere
    bool singular_start = false;

    double at_tick(int k, int period) const { return s[std::size_t(k) * period + 1]; }
};

/// Tells the tracer when nothing more can happen in a lane. `finished(s, torque_per_N)` is called at every
/// tick with the distance and the contact torques per newton of all lanes and returns the lanes that need no
/// further tick.
struct NeverFinished {
    template <class T>
    MaskOf<T> operator()(const T&, const T*) {
        return T(0.0) > T(1.0);
    }
};

/// Where lines begin, one in each lane.
template <class T>
struct LineStart {
    ArmState<T> state;
    Posture<T> posture;
    Rates<T> rates;
    Point3<T> point, normal;
};

/// Begins the lines, and paths[0..count) with what is known of them.
template <class T>
LineStart<T> begin_line(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact,
                        const Timing& timing, const T* q, const Point3<T>& velocity, LinePath* paths, int count) {
    LineStart<T> line;
    for (int j = 0; j < chain.dof; ++j) {
        line.state.q[j] = q[j];
        line.state.qd[j] = 0.0;
    }
    line.state.refresh_angles(chain);
    forward_kinematics(chain, line.state.q, line.state.angle, line.posture);
    line.rates = resolved_rates(chain, motion, line.posture, velocity);
    line.point = line.posture.position(contact.point);
    Point3<T> drift{T(0.0), T(0.0), T(0.0)};  // of the contact point at full speed
    for (int f = 0; f < motion.free_count; ++f) {
        const int j = motion.free_joint[f];
        if (j > contact.point.link) continue;
        const Point3<T> column = linear_column(chain, line.posture, line.point, j);
        drift = {drift.x + column.x * line.rates.free[f], drift.y + column.y * line.rates.free[f],
                 drift.z + column.z * line.rates.free[f]};
    }
    line.normal = {T(contact.normal[0]), T(contact.normal[1]), T(contact.normal[2])};
    if (contact.along_motion) {
        const T inverse = 1.0 / maximum(square_root(dot(drift, drift)), T(1e-200));
        line.normal = {drift.x * inverse, drift.y * inverse, drift.z * inverse};
    }
    if (!timing.from_rest) {
        for (int f = 0; f < motion.free_count; ++f) line.state.qd[motion.free_joint[f]] = line.rates.free[f];
    }
    const T approach = dot(drift, line.normal);
    for (int lane = 0; lane < count; ++lane) {
        LinePath& path = paths[lane];
        path.dof = chain.dof;
        path.free_count = motion.free_count;
        path.ticks = 0;
        path.s.clear();
        path.torque_per_N.clear();
        path.reaction_state.clear();
        path.start = {lane_of(line.point.x, lane), lane_of(line.point.y, lane), lane_of(line.point.z, lane)};
        path.normal = {lane_of(line.normal.x, lane), lane_of(line.normal.y, lane), lane_of(line.normal.z, lane)};
        path.velocity = {lane_of(velocity.x, lane), lane_of(velocity.y, lane), lane_of(velocity.z, lane)};
        path.approach_speed = lane_of(approach, lane);
        path.end = PathEnd::horizon;
        path.end_joint = -1;
        path.velocity_limited = lane_of(line.rates.velocity_limited, lane);
        path.singular_start = lane_of(line.rates.conditioning.singular, lane);
    }
    return line;
}

namespace detail {

/// To the nearest limit of a free joint, `q` by joint; negative beyond it.
template <class T>
T least_margin(const MotionSettings& motion, const T* q) {
    T margin = 1.0;
    for (int f = 0; f < motion.free_count; ++f) {
        const int j = motion.free_joint[f];
        margin = minimum(margin, minimum(q[j] - motion.lower[j], motion.upper[j] - q[j]));
    }
    return margin;
}

/// The path ends because a joint is beyond its limit; `q(joint)` says where they are.
template <class Q>
void end_at_limit(const MotionSettings& motion, Q q, LinePath& path) {
    path.end = PathEnd::joint_limit;
    for (int f = 0; f < motion.free_count; ++f) {
        const int j = motion.free_joint[f];
        if (q(j) < motion.lower[j] || q(j) > motion.upper[j]) path.end_joint = j;
    }
}

/// The distances between the last one and that a stride after it, by the cubic through the last three strides and
/// this one.
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

/// Traces the paths of up to one register of poses.
template <class T, class Finished>
class LineTracer {
  public:
    LineTracer(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact, const Timing& timing,
               Finished& finished)
        : chain_(chain),
          motion_(motion),
          contact_(contact),
          timing_(timing),
          finished_(finished),
          stride_(timing.latency > 0 ? std::gcd(timing.period, timing.latency) : timing.period),
          table_(stride_ * motion.substeps) {}

    /// Traces into paths[0..count). Lane l of q and velocity belongs to paths[l]; surplus lanes must repeat a
    /// valid pose.
    void trace(const T* q, const Point3<T>& velocity, LinePath* paths, int count) {
        begin(q, velocity, paths, count);
        step_ = 0;
        while (record()) {
            const bool on_stride = step_ >= 1 && (step_ - 1) % stride_ == 0;
            if (on_stride) remember();
            if (on_stride && history_.leaps()) {
                const Leap leap = try_leap();
                if (leap == Leap::landed) continue;
                if (leap == Leap::all_done) return;
            }
            step();
            ++step_;
        }
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;
    enum class Leap { refused, landed, all_done };

    void begin(const T* q, const Point3<T>& velocity, LinePath* paths, int count) {
        paths_ = paths;
        velocity_ = velocity;
        history_.forget();
        const LineStart<T> line = begin_line(chain_, motion_, contact_, timing_, q, velocity, paths, count);
        state_ = line.state;
        posture_ = line.posture;
        rates_ = line.rates;
        start_ = line.point;
        normal_ = line.normal;
        reached_ = T(0.0) < T(1.0);
        for (int lane = 0; lane < lanes; ++lane) {
            last_step_[lane] = timing_.steps + timing_.latency;
            alive_[lane] = lane < count;
        }
    }

    /// Posture and wanted rates where the arm is.
    void look() {
        forward_kinematics(chain_, state_.q, state_.angle, posture_);
        rates_ = resolved_rates(chain_, motion_, posture_, velocity_);
    }

    /// One simulation step of the controller as it runs.
    void step() {
        for (int sub = 0; sub < motion_.substeps; ++sub) {
            if (sub > 0) look();
            reached_ = reached_ & advance(chain_, motion_, rates_.free, state_);
        }
        look();
    }

    /// Keeps the rates for leaping; forgets all where some living lane did not have them over the whole
    /// stretch.
    void remember() {
        bool smooth = true;
        for (int lane = 0; lane < lanes; ++lane) {
            if (alive_[lane]) smooth = smooth && lane_of(reached_, lane);
        }
        reached_ = T(0.0) < T(1.0);
        if (!smooth) history_.forget();
        history_.push(rates_.free, motion_.free_count);
        if (may_double_ && history_.can_double()) history_.double_stride(motion_.free_count);
        may_double_ = false;
    }

    /// Goes over the longest stride for which the rates found at its end are those extrapolated; else stays.
    Leap try_leap() {
        int left = std::numeric_limits<int>::max();  // steps until the first living lane's path is over
        for (int lane = 0; lane < lanes; ++lane) {
            if (alive_[lane]) left = std::min(left, last_step_[lane] - step_);
        }
        const ArmState<T> before = state_;
        const Posture<T> posture_before = posture_;
        const Rates<T> rates_before = rates_;
        for (;;) {
            if ((stride_ << history_.level()) <= left && lands(before)) break;
            state_ = before;
            posture_ = posture_before;
            rates_ = rates_before;
            if (history_.level() == 0) {
                history_.forget();
                return Leap::refused;
            }
            history_.halve_stride(motion_.free_count);
        }
        return record_between(before) ? Leap::landed : Leap::all_done;
    }

    /// Puts the arm to the end of the stride. Is it where a leap may end?
    bool lands(const ArmState<T>& before) {
        const LeapWeights& weights = table_.full(history_.level());
        place(before, weights);
        look();
        T difference = 0.0, largest = 0.0, use = 0.0;  // use: of the velocity limits
        T change[max_joints], load[max_joints], most_load = 0.0;
        limited_change(motion_, rates_.free, state_, change, load);
        for (int f = 0; f < motion_.free_count; ++f) {
            const T rate = absolute(rates_.free[f]);
            difference = maximum(difference, absolute(rates_.free[f] - history_.combine(weights.predict, f)));
            largest = maximum(largest, rate);
            use = maximum(use, rate * (1.0 / motion_.velocity_limit[motion_.free_joint[f]]));
            most_load = maximum(most_load, load[f]);
        }
        // A limit may be passed inside a long leap that begins and ends below it.
        const bool long_leap = history_.level() > 0;
        const MaskOf<T> near_limit =
            (T(long_leap ? 0.9 : 1.0) < minimum(use, 1.9 - use)) | (T(long_leap ? 0.9 : 1.0) < most_load);
        const T margin = detail::least_margin(motion_, state_.q);
        const auto agrees = difference <= (leap_tolerance * (history_.level() > 0 ? long_leap_margin : 1.0)) * largest;
        const auto close = difference <= (leap_tolerance * doubling_margin) * largest;
        may_double_ = true;
        for (int lane = 0; lane < lanes; ++lane) {
            if (!alive_[lane]) continue;
            if (!lane_of(agrees, lane) || !(lane_of(margin, lane) > 0) || lane_of(rates_.conditioning.singular, lane) ||
                lane_of(near_limit, lane))
                return false;
            may_double_ = may_double_ && lane_of(close, lane);
        }
        return true;
    }

    void place(const ArmState<T>& before, const LeapWeights& weights) {
        for (int f = 0; f < motion_.free_count; ++f) {
            const int j = motion_.free_joint[f];
            state_.q[j] = before.q[j] + motion_.substep() * history_.combine(weights.sum, f);
            state_.qd[j] = history_.combine(weights.last, f);
            state_.angle.set(chain_, j, state_.q[j]);
        }
    }

    /// Writes what lies inside a leap, stretch by stretch, and stands at its end. False when no lane goes on.
    bool record_between(const ArmState<T>& before) {
        const int stretches = 1 << history_.level();
        if (stretches > 1) {
            const ArmState<T> landing = state_;
            const Posture<T> landing_posture = posture_;
            for (int i = 1; i < stretches; ++i) {
                place(before, table_.after(history_.level(), i));
                forward_kinematics(chain_, state_.q, state_.angle, posture_);
                fill_steps();
                step_ += stride_;
                if (!record()) return false;
            }
            state_ = landing;
            posture_ = landing_posture;
        }
        fill_steps();
        step_ += stride_;
        return true;
    }

    /// The distances at the simulation steps inside a leap.
    void fill_steps() {
        const T s = distance();
        for (int lane = 0; lane < lanes; ++lane) {
            if (alive_[lane]) detail::fill_stride(paths_[lane].s, stride_, lane_of(s, lane));
        }
    }

    T distance() const { return dot(posture_.position(contact_.point) - start_, normal_); }

    /// Writes what is at this step into the paths. False when no lane goes on.
    bool record() {
        const int i = step_;
        const int n = motion_.free_count;
        const T s = distance();
        const T margin = detail::least_margin(motion_, state_.q);
        const bool tick = i >= 1 && (i - 1) % timing_.period == 0 && i - 1 < timing_.steps;
        auto complete = T(0.0) > T(1.0);
        T torque[max_joints];
        if (tick) {
            const Point3<T> p = posture_.position(contact_.point);
            for (int j = 0; j < chain_.dof; ++j) {
                torque[j] = j > contact_.point.link ? T(0.0) : dot(linear_column(chain_, posture_, p, j), normal_);
            }
            complete = finished_(s, torque);
        }
        const int after_first = i - 1 - timing_.latency;
        const bool reaction = after_first >= 0 && after_first % timing_.period == 0;
        bool running = false;
        for (int lane = 0; lane < lanes; ++lane) {
            if (!alive_[lane]) continue;
            LinePath& path = paths_[lane];
            const bool certain = path.end == PathEnd::certain_detection;
            if (lane_of(margin, lane) < 0) {
                alive_[lane] = false;
                if (!certain)
                    detail::end_at_limit(
                        motion_, [&](int j) { return lane_of(state_.q[j], lane); }, path);
                continue;
            }
            path.s.push_back(lane_of(s, lane));
            if (lane_of(rates_.conditioning.singular, lane)) {
                alive_[lane] = false;
                if (!certain) path.end = PathEnd::singularity;
            }
            if (lane_of(rates_.velocity_limited, lane)) path.velocity_limited = true;
            if (tick && !certain) {
                ++path.ticks;
                for (int j = 0; j < chain_.dof; ++j) path.torque_per_N.push_back(lane_of(torque[j], lane));
                if (lane_of(complete, lane)) {
                    path.end = PathEnd::certain_detection;
                    last_step_[lane] = i + timing_.latency;
                }
            }
            if (reaction && int(path.reaction_state.size()) < 2 * n * path.ticks) {
                for (int f = 0; f < n; ++f)
                    path.reaction_state.push_back(lane_of(state_.q[motion_.free_joint[f]], lane));
                for (int f = 0; f < n; ++f)
                    path.reaction_state.push_back(lane_of(state_.qd[motion_.free_joint[f]], lane));
            }
            if (i >= last_step_[lane]) alive_[lane] = false;
            running = running || alive_[lane];
        }
        return running;
    }

    const Chain& chain_;
    const MotionSettings& motion_;
    const ContactGeometry& contact_;
    const Timing& timing_;
    Finished& finished_;
    const int stride_;  ///< steps between the moments a path keeps: ticks, and beginnings of reactions
    const LeapTable table_;

    LinePath* paths_ = nullptr;
    Point3<T> velocity_, start_, normal_;
    ArmState<T> state_;
    Posture<T> posture_;
    Rates<T> rates_;
    RateHistory<T> history_;
    bool may_double_ = false;  ///< the last leap landed so well that one of twice the stride may
    int step_ = 0;             ///< steps behind us; posture and rates are those there
    MaskOf<T> reached_;        ///< rates reached in every sub-step since the last `remember`
    int last_step_[lanes];
    bool alive_[lanes];
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
