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
        for (int j = 0; j < chain_.dof; ++j) {
            state_.q[j] = q[j];
            state_.qd[j] = 0.0;
        }
        state_.refresh_angles(chain_);
        look();
        start_ = posture_.position(contact_.point);
        Point3<T> drift{T(0.0), T(0.0), T(0.0)};  // of the contact point at full speed
        for (int f = 0; f < motion_.free_count; ++f) {
            const int j = motion_.free_joint[f];
            if (j > contact_.point.link) continue;
            const Point3<T> column = linear_column(chain_, posture_, start_, j);
            drift = {drift.x + column.x * rates_.free[f], drift.y + column.y * rates_.free[f],
                     drift.z + column.z * rates_.free[f]};
        }
        normal_ = {T(contact_.normal[0]), T(contact_.normal[1]), T(contact_.normal[2])};
        if (contact_.along_motion) {
            const T inverse = 1.0 / maximum(square_root(dot(drift, drift)), T(1e-200));
            normal_ = {drift.x * inverse, drift.y * inverse, drift.z * inverse};
        }
        if (!timing_.from_rest) {
            for (int f = 0; f < motion_.free_count; ++f) state_.qd[motion_.free_joint[f]] = rates_.free[f];
        }
        reached_ = T(0.0) < T(1.0);
        const T approach = dot(drift, normal_);
        for (int lane = 0; lane < lanes; ++lane) {
            last_step_[lane] = timing_.steps + timing_.latency;
            alive_[lane] = lane < count;
            if (!alive_[lane]) continue;
            LinePath& path = paths[lane];
            path.dof = chain_.dof;
            path.free_count = motion_.free_count;
            path.ticks = 0;
            path.s.clear();
            path.torque_per_N.clear();
            path.reaction_state.clear();
            path.start = {lane_of(start_.x, lane), lane_of(start_.y, lane), lane_of(start_.z, lane)};
            path.normal = {lane_of(normal_.x, lane), lane_of(normal_.y, lane), lane_of(normal_.z, lane)};
            path.velocity = {lane_of(velocity.x, lane), lane_of(velocity.y, lane), lane_of(velocity.z, lane)};
            path.approach_speed = lane_of(approach, lane);
            path.end = PathEnd::horizon;
            path.end_joint = -1;
            path.velocity_limited = lane_of(rates_.velocity_limited, lane);
            path.singular_start = lane_of(rates_.conditioning.singular, lane);
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

    T least_margin(const ArmState<T>& state) const {
        T margin = 1.0;  // to the nearest joint limit; negative beyond it
        for (int f = 0; f < motion_.free_count; ++f) {
            const int j = motion_.free_joint[f];
            margin = minimum(margin, minimum(state.q[j] - motion_.lower[j], motion_.upper[j] - state.q[j]));
        }
        return margin;
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
        for (int f = 0; f < motion_.free_count; ++f) {
            const T rate = absolute(rates_.free[f]);
            difference = maximum(difference, absolute(rates_.free[f] - history_.combine(weights.predict, f)));
            largest = maximum(largest, rate);
            use = maximum(use, rate * (1.0 / motion_.velocity_limit[motion_.free_joint[f]]));
        }
        // A limit may be passed inside a long leap that begins and ends below it.
        const MaskOf<T> near_limit = T(history_.level() > 0 ? 0.9 : 1.0) < minimum(use, 1.9 - use);
        const T margin = least_margin(state_);
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

    /// The distances at the simulation steps inside a leap, by the cubic through the last three strides and
    /// this one.
    void fill_steps() {
        const T s = distance();
        for (int lane = 0; lane < lanes; ++lane) {
            if (!alive_[lane]) continue;
            std::vector<double>& path = paths_[lane].s;
            const std::size_t end = path.size() - 1;
            const double y[4] = {path[end - 2 * stride_], path[end - stride_], path[end], lane_of(s, lane)};
            const double third = y[3] - 3 * y[2] + 3 * y[1] - y[0], second = y[3] - 2 * y[2] + y[1];
            for (int step = 1; step < stride_; ++step) {
                const double x = double(step) / stride_ - 1;  // 0 at the new stride, -1 at the one before
                path.push_back(y[3] + x * (y[3] - y[2]) + x * (x + 1) / 2 * second + x * (x + 1) * (x + 2) / 6 * third);
            }
        }
    }

    T distance() const { return dot(posture_.position(contact_.point) - start_, normal_); }

    /// Writes what is at this step into the paths. False when no lane goes on.
    bool record() {
        const int i = step_;
        const int n = motion_.free_count;
        const T s = distance();
        const T margin = least_margin(state_);
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
                if (!certain) end_at_limit(path, lane);
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

    void end_at_limit(LinePath& path, int lane) const {
        path.end = PathEnd::joint_limit;
        for (int f = 0; f < motion_.free_count; ++f) {
            const int j = motion_.free_joint[f];
            const double q = lane_of(state_.q[j], lane);
            if (q < motion_.lower[j] || q > motion_.upper[j]) path.end_joint = j;
        }
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
