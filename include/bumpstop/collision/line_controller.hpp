/// @file
/// The controller of a line as it runs, sub-step after sub-step.
#pragma once

#include "bumpstop/collision/line_motion.hpp"
#include "bumpstop/model/screw_rates.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

template <class T>
class LineController {
  public:
    LineController(const Chain& chain, const MotionSettings& motion)
        : chain_(chain),
          motion_(motion),
          screws_(chain, motion.free_joint.data(), motion.free_count, motion.tip, farthest_travel(motion).data()),
          uses_screws_(screws_.works() && motion.task_rows == 6 && motion.damping == 0),
          full_(motion) {
        for (int f = 0; f < motion.free_count; ++f) {
            const int j = motion.free_joint[f];
            most_gain_ = std::max(most_gain_, motion.acceleration_limit[j] * motion.step);
        }
    }

    /// Poses far from those before come next.
    void begin() { screws_.begin(); }

    /// As of `resolved_rates`, but for Conditioning::poor, which is not told.
    void find_rates(ArmState<T>& state, const Point3<T>& velocity, Rates<T>& found) {
        if (uses_screws_ && screws_.solve(state.angle, state.q, velocity, found.free)) {
            found.conditioning = {T(0.0) > T(1.0), T(0.0) > T(1.0)};
            slow_to_velocity_limits(motion_, found);
            return;
        }
        // Screws do without some of the angles.
        state.refresh_angles(chain_);
        Posture<T> posture;
        forward_kinematics(chain_, state.q, state.angle, posture);
        found = resolved_rates(chain_, motion_, posture, velocity);
    }

    /// One simulation step. `wanted`: the rates asked for where it begins, then those of its last sub-step. Returns where
    /// those asked for were reached in every sub-step.
    MaskOf<T> step(Rates<T>& wanted, const Point3<T>& velocity, ArmState<T>& state) {
        if (motion_.free_count == 6) return step_of<6>(wanted, velocity, state);
        if (motion_.free_count == 7) return step_of<7>(wanted, velocity, state);
        return step_of<0>(wanted, velocity, state);
    }

  private:
    template <int Free>
    MaskOf<T> step_of(Rates<T>& wanted, const Point3<T>& velocity, ArmState<T>& state) {
        // Inside the step sines and cosines follow small turns; where it ends they are worked out anew.
        T fastest = 0.0;
        for (int f = 0; f < motion_.free_count; ++f)
            fastest = maximum(fastest, absolute(state.qd[motion_.free_joint[f]]));
        const bool small = all((fastest + most_gain_) * motion_.substep() <= T(largest_small_turn));
        auto reached = T(0.0) < T(1.0);
        for (int sub = 0; sub < motion_.substeps; ++sub) {
            if (sub > 0) find_rates(state, velocity, wanted);
            reached = reached & advance<Free>(wanted.free, state);
            if (sub + 1 == motion_.substeps) {
                state.refresh_angles(chain_);
            } else {
                turn(small, state);
            }
        }
        return reached;
    }

    /// The rates change, one ratio scaling all accelerations so that none passes its limit; then the positions follow.
    template <int Free>
    MaskOf<T> advance(const T* wanted, ArmState<T>& state) const {
        const int n = Free > 0 ? Free : motion_.free_count;
        const double h = motion_.substep();
        T change[max_joints], load[max_joints];
        const auto reached = limited_change<Free>(motion_, full_, wanted, state, change, load);
        for (int f = 0; f < n; ++f) {
            const int j = motion_.free_joint[f];
            // Rates that are reached are taken over, so that no rounding keeps them apart.
            state.qd[j] = select(reached, wanted[f], state.qd[j] + change[f]);
            state.q[j] += state.qd[j] * h;
        }
        return reached;
    }

    /// Sines and cosines after a sub-step inside a step, of the joints that need them.
    void turn(bool small, ArmState<T>& state) const {
        const double h = motion_.substep();
        for (int f = 0; f < motion_.free_count; ++f) {
            const int j = motion_.free_joint[f];
            if (uses_screws_ && j >= screws_.angles_needed()) break;
            if (chain_.joint[j].prismatic) continue;
            if (small) {
                state.angle.turn(j, state.qd[j] * h);
            } else {
                state.angle.set(chain_, j, state.q[j]);
            }
        }
    }

    const Chain& chain_;
    const MotionSettings& motion_;
    ScrewRates<T> screws_;
    const bool uses_screws_;
    const FullChangeInverse full_;
    double most_gain_ = 0;  ///< of a rate in a simulation step [rad/s or m/s]
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
