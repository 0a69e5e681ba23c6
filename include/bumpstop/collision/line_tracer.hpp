/// @file
/// Paths of a register full of poses, traced together with leaps that all of them can take.
#pragma once

#include <limits>
#include <numeric>

#include "bumpstop/collision/leap.hpp"
#include "bumpstop/collision/line_controller.hpp"
#include "bumpstop/collision/line_end.hpp"
#include "bumpstop/collision/line_path.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

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
          full_(motion),
          controller_(chain, motion),
          stride_(timing.latency > 0 ? std::gcd(timing.period, timing.latency) : timing.period),
          table_(stride_ * motion.substeps) {}

    /// Traces into paths[0..count). Lane l of q and velocity belongs to paths[l]; surplus lanes must repeat a
    /// valid pose.
    void trace(const T* q, const Point3<T>& velocity, LinePath* paths, int count) {
        begin(q, velocity, paths, count);
        step_ = 0;
        while (record()) {
            allow_interruption();
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
        controller_.begin();
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

    /// Posture and wanted rates where the arm is. By the last digits of these rates leaps are told to be long enough.
    void look() {
        forward_kinematics(chain_, state_.q, state_.angle, posture_);
        rates_ = resolved_rates(chain_, motion_, posture_, velocity_);
    }

    /// One simulation step of the controller as it runs.
    void step() {
        reached_ = reached_ & controller_.step(rates_, velocity_, state_);
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
        limited_change(motion_, full_, rates_.free, state_, change, load);
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
        const bool early = i >= 1 && after_first < 0 && (i == 1 || after_first % timing_.period == 0);
        bool running = false;
        for (int lane = 0; lane < lanes; ++lane) {
            if (!alive_[lane]) continue;
            LinePath& path = paths_[lane];
            const bool certain = path.end == PathEnd::certain_detection;
            if (lane_of(margin, lane) < 0) {
                alive_[lane] = false;
                path.end_joint = detail::joint_at_limit(motion_, [&](int j) { return lane_of(state_.q[j], lane); });
                cut(lane, PathEnd::joint_limit, last_q_, last_qd_);
                continue;
            }
            path.s.push_back(lane_of(s, lane));
            const bool singular = lane_of(rates_.conditioning.singular, lane);
            if (lane_of(rates_.velocity_limited, lane)) path.velocity_limited = true;
            if (tick && !certain) {
                ++path.ticks;
                for (int j = 0; j < chain_.dof; ++j) path.torque_per_N.push_back(lane_of(torque[j], lane));
                if (lane_of(complete, lane)) {
                    path.end = PathEnd::certain_detection;
                    last_step_[lane] = i + timing_.latency;
                }
            }
            if (early || (reaction && int(path.reaction_state.size()) < 2 * n * path.ticks)) {
                std::vector<double>& to = early ? path.early_state : path.reaction_state;
                for (int f = 0; f < n; ++f) to.push_back(lane_of(state_.q[motion_.free_joint[f]], lane));
                for (int f = 0; f < n; ++f) to.push_back(lane_of(state_.qd[motion_.free_joint[f]], lane));
            }
            if (i >= last_step_[lane] || singular) alive_[lane] = false;
            if (singular) cut(lane, PathEnd::singularity, state_.q, state_.qd);
            running = running || alive_[lane];
        }
        std::copy_n(state_.q, chain_.dof, last_q_);
        std::copy_n(state_.qd, chain_.dof, last_qd_);
        return running;
    }

    /// From the last step written, where the joints are at `q` and move at `qd`, the arm of a lane brakes.
    void cut(int lane, PathEnd why, const T* q, const T* qd) {
        detail::cut_line(
            chain_, motion_, contact_, timing_, why, step_, [&](int j) { return lane_of(q[j], lane); },
            [&](int j) { return lane_of(qd[j], lane); }, paths_[lane]);
    }

    const Chain& chain_;
    const MotionSettings& motion_;
    const ContactGeometry& contact_;
    const Timing& timing_;
    Finished& finished_;
    const FullChangeInverse full_;
    LineController<T> controller_;
    const int stride_;  ///< steps between the moments a path keeps: ticks, and beginnings of reactions
    const LeapTable table_;

    LinePath* paths_ = nullptr;
    Point3<T> velocity_, start_, normal_;
    ArmState<T> state_;
    T last_q_[max_joints], last_qd_[max_joints];  ///< where the last step was written
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
