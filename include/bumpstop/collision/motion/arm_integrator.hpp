/// @file
/// Integrates the motion of arms that brake or follow a line: one arm per lane, with Adams steps of variable length.
#pragma once

#include "bumpstop/collision/motion/adams_history.hpp"
#include "bumpstop/collision/motion/brake_profile.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

inline constexpr int max_reaction_adams_step = 128, max_line_adams_step = 256;  ///< sub-steps

/// An Adams step is accepted where the rate change predicted for its end differs from that found there by at most this
/// share of the largest. The difference corrects the step, which leaves a thirtieth of the error. Instruction sets
/// round differently and must agree to 1e-12: with 1e-10 they differ by 2e-12 for fast arms.
inline constexpr double exact_tolerance = 1e-11;
/// The tolerance in batches, and of reactions that hardly matter to the distribution: more accuracy would gain nothing.
/// `make validate` (batches) shows how accurate distributions are with it.
inline constexpr double batch_tolerance = 1e-4;
inline constexpr double max_batch_tolerance = 1e-3;

/// The tolerance of reactions near a singularity, which amplifies the error of an Adams step.
inline constexpr double near_singular_tolerance = 1e-8;

/// A singularity is near where the sine of some row of the Jacobian (see Conditioning) is this small.
inline constexpr double near_singular_sine = 1e-2;
/// The same for an arm that traces: below it, every simulation step is checked for the singularity. Above it, no Adams
/// step can cross a singularity, because the wanted rates would grow by more than a step may extrapolate.
inline constexpr double line_near_singular_sine = 1e-3;

/// The tolerance of the rates of an arm that follows its line, relative to the largest rate.
inline constexpr double batch_rate_tolerance = 3e-8;

/// In every sub-step the controller changes the rates as much as the acceleration limits allow. While the same joint is
/// the limiting one these changes are smooth, and one Adams-Bashforth step replaces many sub-steps; around a switching
/// point they are taken one by one. An arm that has reached its wanted rates extrapolates the rates themselves.
template <class T>
class ArmIntegrator {
  public:
    enum class Kind {
        brake,  ///< the wanted rates are zero: no inverse kinematics
        track,  ///< the wanted rates move the tip with `target`
        trace,  ///< as track, and singularities are looked for at line_near_singular_sine
    };

    ArmIntegrator(const Chain& chain, const MotionSettings& motion, Kind kind)
        : chain_(chain),
          motion_(motion),
          full_(motion),
          kind_(kind),
          near_singular_below_(std::pow(kind == Kind::trace ? line_near_singular_sine : near_singular_sine, 2)) {}

    ArmState<T> state;
    Posture<T> posture;  ///< posture at the end of the last Adams step
    Point3<T> target;    ///< wanted velocity of the tip: that of the line or of the reaction [m/s]

    /// Starts a lane whose state and target have been set. Its next `step` only evaluates the start. `tolerance` is
    /// that of rate changes, relative to the largest; `rate_tolerance` that of rates which are reached.
    void begin(int lane, double tolerance, double rate_tolerance = batch_rate_tolerance) {
        set_lane(tolerance_, lane, tolerance);
        set_lane(rate_tolerance_, lane, rate_tolerance);
        set_lane(tolerance_scale_, lane, 1.0);
        restarted_ = true;
        history_.reset(lane);
        for (int f = 0; f < motion_.free_count; ++f) {
            set_lane(from_[f], lane, lane_of(state.q[motion_.free_joint[f]], lane));
            set_lane(travelled_[f], lane, 0.0);
        }
        set_lane(known_, lane, 0.0);
        set_lane(next_step_, lane, 1.0);
        set_lane(error_, lane, std::numeric_limits<double>::infinity());
        set_lane(reached_, lane, false);
        set_lane(reaches_, lane, false);
    }
    /// From its start on the lane's acceleration limits follow `profile`. `independent`: every joint brakes by itself,
    /// so the rates do not keep their ratios; it is the same for all lanes.
    void brake(int lane, const BrakeProfile& profile, bool independent) {
        has_profile_ = true;
        independent_ = independent;
        for (int f = 0; f < motion_.free_count; ++f) set_lane(inverse_scale_[f], lane, 1 / profile.scale[f]);
        set_lane(slowing_, lane, profile.slowing);
        set_lane(ramp_, lane, profile.ramp);
        set_lane(elapsed_, lane, 0.0);
    }
    /// From now on the tolerance of these lanes is `times` as large.
    void relax(const MaskOf<T>& lanes, double times) { tolerance_scale_ = select(lanes, T(times), tolerance_scale_); }
    /// The wanted rates were reached in the last sub-step.
    MaskOf<T> reached() const { return reached_; }
    /// A singularity was near at the beginning or the end of the last Adams step.
    MaskOf<T> near_singular() const { return near_singular_; }
    /// At the lane's present position the arm is singular (of arms that trace).
    bool singular(int lane) const { return lane_of(singular_, lane); }
    /// At the lane's present position a velocity limit slows the wanted rates.
    bool limited(int lane) const { return lane_of(limited_, lane); }
    /// Over its last Adams step the lane had the wanted rates, and they were smooth.
    bool smooth(int lane) const { return lane_of(reaches_, lane) && lane_of(known_, lane) > 1; }

    /// Position and rates of a lane, by free joint, `back` sub-steps ago: dense output of its last Adams step.
    void before(int lane, const T& back, T* q, T* qd) const {
        const int n = motion_.free_count;
        const AdamsHistory<T> own = history_.broadcast(lane, n);
        const T count = -back;
        const AdamsWeights<T> weights = own.template weights<true>(count);
        const bool followed = lane_of(reaches_, lane);
        for (int f = 0; f < n; ++f) {
            const int j = motion_.free_joint[f];
            const double rate = lane_of(state.qd[j], lane);
            const T gained =
                followed ? own.combine(weights.sum, f) : count * rate + own.combine(weights.sum_of_sums, f);
            const T then = followed ? own.combine(weights.last, f) : rate + own.combine(weights.sum, f);
            q[f] = lane_of(state.q[j], lane) + motion_.substep() * gained;
            qd[f] = select(back > T(0.0), then, T(rate));
        }
    }

    /// Advances every lane by at most `max_step` sub-steps and returns by how many: 0 where the lane only evaluated its
    /// start or its Adams step was rejected. `observe()` is called with the state and angles at the ends of the Adams
    /// steps, before it is known which are accepted. Of steps over more than one sub-step, `rejected(which, sub-steps)`
    /// says which the caller rejects; the state of a rejected lane is not valid until the next call.
    template <class Observe, class Rejected>
    T step(const T& max_step, Observe observe, Rejected rejected) {
        const int n = motion_.free_count;
        const bool follows = kind_ != Kind::brake;
        const MaskOf<T> begun = known_ > T(0.0);
        const T known = known_, next_step = follows ? next_step_ : select(reaches_, T(1.0), next_step_);
        T count = select(begun, min(next_step, max_step), T(0.0));
        if (has_profile_) count = min(count, before_switch());
        const AdamsWeights<T> weights =
            follows ? history_.template weights<true>(count) : history_.template weights<false>(count);
        // Lanes that have reached their wanted rates: their history holds the rates themselves, not the changes.
        const MaskOf<T> has_rates = follows ? reaches_ : mask_of<T>(false);
        T travelled_before[max_joints], qd_before[max_joints];
        for (int f = 0; f < n; ++f) {
            const int j = motion_.free_joint[f];
            travelled_before[f] = travelled_[f];
            qd_before[f] = state.qd[j];
            const T sum = history_.combine(weights.sum, f);
            T gained = count * state.qd[j] + history_.combine(weights.sum_of_sums, f), rate = state.qd[j] + sum;
            if (follows) {
                gained = select(has_rates, sum, gained);
                rate = select(has_rates, history_.combine(weights.last, f), rate);
                rate = select(count > T(0.0), rate, state.qd[j]);
            }
            travelled_[f] += motion_.substep() * gained;
            state.q[j] = from_[f] + travelled_[f];
            state.qd[j] = rate;
        }
        update_posture();
        const Rates<T> wanted = wanted_rates();
        T change[max_joints], saturation[max_joints];
        const MaskOf<T> reaches = find_change(wanted.free, count, change, saturation);
        T off = 0.0, largest = 0.0, largest_rate = 0.0, correction[max_joints];
        for (int f = 0; f < n; ++f) {
            if (follows) {
                change[f] = select(reaches, wanted.free[f], change[f]);
                largest_rate = max(largest_rate, abs(wanted.free[f]));
            }
            correction[f] = change[f] - history_.combine(weights.predict, f);
            off = max(off, abs(correction[f]));
            largest = max(largest, abs(change[f]));
        }
        const T allowed =
            follows ? select(reaches, largest_rate * rate_tolerance_, largest * tolerance_) : largest * tolerance_;
        const T error = off / max(allowed * tolerance_scale_, T(1e-300));
        observe();
        // Where no sub-step was taken, error_growth is 0 and the next step length is not estimated.
        const T roughness = error / max(history_.error_growth(count, known), T(1e-300));
        const MaskOf<T> goes = count > T(0.0), long_steps = count > T(1.0), single = !long_steps,
                        limited = wanted.velocity_limited;
        // A step that ends in another regime (wanted rates reached or lost, velocity limit active or not) is rejected,
        // so that the change of regime is found by single sub-steps.
        const MaskOf<T> met = differ(reaches, reaches_), capped = differ(limited, limited_);
        const MaskOf<T> changes = follows ? met | capped : reaches;
        const MaskOf<T> good = single | ((error <= T(1.0)) & !changes);
        const MaskOf<T> accepted = (goes | !begun) & good & !rejected(long_steps & good, count),
                        moved = accepted & goes, first = accepted & !goes;
        reached_ = select(accepted, single & goes & reaches_, reached_);
        reaches_ = select(accepted, reaches, reaches_);
        limited_ = select(accepted, limited, limited_);
        singular_ = select(accepted, wanted.conditioning.singular, singular_);
        const MaskOf<T> near_now = wanted.conditioning.min_sine_squared <= T(near_singular_below_);
        near_singular_ = select(accepted, (goes & near_singular_now_) | near_now, near_singular_);
        near_singular_now_ = select(accepted, near_now, near_singular_now_);
        history_.set_first(first, change, n);
        // At a switching point the history before it says nothing about what follows, so it is dropped.
        const MaskOf<T> jumps = single & (error > T(1.0)) & (error > switch_jump * error_);
        const MaskOf<T> switches = moved & (follows ? changes | jumps : (!changes) & jumps);
        error_ = select(moved, select(switches, T(std::numeric_limits<double>::infinity()), error), error_);
        known_ = select(moved, min(select(switches, T(0.0), known_) + 1.0, T(double(adams_order))),
                        select(first, T(1.0), known_));
        // The angles are not updated: the correction moves the arm by less than its position must be known to.
        const T to_position = select(has_rates, weights.correct_sum, weights.correct_sum_of_sums) * motion_.substep();
        const T to_rate = follows ? select(has_rates, weights.correct_last, weights.correct_sum) : weights.correct_sum;
        for (int f = 0; f < n; ++f) {
            const int j = motion_.free_joint[f];
            travelled_[f] = select(moved, travelled_[f] + to_position * correction[f], travelled_before[f]);
            state.q[j] = from_[f] + travelled_[f];
            state.qd[j] = select(moved, state.qd[j] + to_rate * correction[f], qd_before[f]);
        }
        // The history gets the changes at the corrected rates. Those at the predicted rates would make steps unstable
        // that are longer than about a twentieth of the sub-steps left to the wanted rates (`saturation`).
        const MaskOf<T> lags = accepted & !(has_rates | reaches);
        T corrected[max_joints], corrected_saturation[max_joints];
        find_change(wanted.free, count, corrected, corrected_saturation);
        for (int f = 0; f < n; ++f) {
            change[f] = select(lags, corrected[f], change[f]);
            saturation[f] = select(lags, corrected_saturation[f], saturation[f]);
        }
        history_.push(moved, count, change, n);
        if (any(switches)) history_.keep_newest(switches);
        // The next step is the longest with a predicted error within the target that crosses no switching point.
        T next = count * min_ratio;
        for (double factor : ratio_factors) {
            const T longer = next * factor;
            next = select(roughness * history_.error_growth(longer, known) <= T(target_error), longer, next);
        }
        const T switching_point = count * distance_to_switch(saturation, wanted.velocity_saturation);
        // A rejected step may have failed for another reason than the predicted switching point, or the point may lie
        // at its end or, by rounding, beyond it. So the next one is always shorter, and halved where the regime
        // changed: the sequence ends at a single sub-step, which is always accepted.
        const T shorter = select(changes, 0.5 * count, count - 1.0);
        next = select(accepted, min(next, switching_point - count),
                      min(select(switching_point < count, min(switching_point, 0.5 * count), next), shorter));
        for (int f = 0; f < n; ++f) saturation_[f] = select(accepted, saturation[f], saturation_[f]);
        velocity_saturation_ = select(accepted, wanted.velocity_saturation, velocity_saturation_);
        // A contact point that turns with the joints may pass a maximum and a minimum within one Adams step, which the
        // ends of the step do not show. So the joints may turn by no more than max_turn in a step.
        T turning = 0.0;
        for (int f = 0; f < n; ++f) turning += abs(state.qd[motion_.free_joint[f]]);
        next = min(next, (max_turn / motion_.substep()) / max(turning, T(1e-200)));
        const T longer = select(known_ < T(3.0), T(1.0), max(floor(next), T(1.0)));
        next_step_ = select(goes, longer, next_step_);
        const T taken = select(moved, count, T(0.0));
        if (has_profile_) elapsed_ += taken;
        return taken;
    }

  private:
    void update_posture() {
        if (restarted_) {
            state.refresh_angles(chain_);  // held joints as well
        } else {
            for (int f = 0; f < motion_.free_count; ++f) {
                const int j = motion_.free_joint[f];
                state.angle.set(chain_, j, state.q[j]);
            }
        }
        restarted_ = false;
        forward_kinematics(chain_, state.q, state.angle, posture);
    }

    /// limited_change in the sub-step that begins `count` sub-steps after the end of the last Adams step.
    MaskOf<T> find_change(const T* wanted, const T& count, T* change, T* saturation) const {
        if (!has_profile_) return limited_change(motion_, full_, wanted, state, change, saturation);
        const T now = elapsed_ + count;
        const MaskOf<T> slows = now < slowing_;
        // Share of the limits that the ramp allows by now.
        const T grown = select(slows & (ramp_ > T(0.0)), min((now + 0.5) / max(ramp_, T(1e-300)), T(1.0)), T(1.0));
        T tightened[max_joints];
        for (int f = 0; f < motion_.free_count; ++f) tightened[f] = select(slows, inverse_scale_[f], T(1.0)) / grown;
        return limited_change(motion_, full_, wanted, state, change, saturation, tightened, independent_);
    }

    /// Sub-steps that an Adams step may take: a single sub-step crosses the end of the ramp and the end of the profile.
    T before_switch() const {
        // The first sub-steps after the ramp, and after the profile.
        const T full = -floor(0.5 - ramp_), after = -floor(-slowing_);
        T allowed = double(max_line_adams_step) * 16;
        for (const T& switching : {full, after})
            allowed = select(elapsed_ < switching, min(allowed, max(switching - 1.0 - elapsed_, T(1.0))), allowed);
        return allowed;
    }

    Rates<T> wanted_rates() const {
        if (kind_ != Kind::brake) return resolved_rates(chain_, motion_, posture, target);
        Rates<T> still;
        for (int f = 0; f < motion_.free_count; ++f) still.free[f] = 0.0;
        still.conditioning = {mask_of<T>(false), T(1.0)};
        still.velocity_limited = mask_of<T>(false);
        still.velocity_saturation = 0.0;
        return still;
    }

    /// Distance of the next switching point from the beginning of the last Adams step, in units of that step,
    /// extrapolated from the saturations at its ends. At a switching point another joint becomes the limiting one, the
    /// wanted rates are reached or lost, a velocity limit becomes active or inactive, or the arm is singular.
    T distance_to_switch(const T* saturation, const T& velocity_saturation) const {
        const T never = 1e9;
        T largest = saturation_[0], later = saturation[0], max_later = saturation[0];
        for (int f = 1; f < motion_.free_count; ++f) {
            const auto greater = saturation_[f] > largest;
            largest = select(greater, saturation_[f], largest);
            later = select(greater, saturation[f], later);
            max_later = max(max_later, saturation[f]);
        }
        T share = never;
        auto cross = [&](const T& before, const T& after) {
            // Where a difference of two saturations falls to zero.
            const T fall = before - after;
            share = min(share, select(fall > T(0.0), before / max(fall, T(1e-300)), never));
        };
        for (int f = 0; f < motion_.free_count; ++f) cross(largest - saturation_[f], later - saturation[f]);
        const auto lags = largest > T(1.0);
        share = select(lags, share, never);
        if (independent_) {
            share = never;
            for (int f = 0; f < motion_.free_count; ++f)
                if (any(saturation_[f] > T(1.0)))
                    cross(max(saturation_[f] - 1.0, T(0.0)),
                          select(saturation_[f] > T(1.0), saturation[f] - 1.0, T(0.0)));
        }
        const T sign = select(lags, T(1.0), T(-1.0)), side = select(velocity_saturation_ > T(1.0), T(1.0), T(-1.0));
        cross(sign * (largest - 1.0), sign * (max_later - 1.0));
        cross(side * (velocity_saturation_ - 1.0), side * (velocity_saturation - 1.0));
        // Before a singularity the wanted rates, or their saturation under a velocity limit, grow without bound, and
        // beyond it they change sign. A step across two singularities in a row would not be detected.
        cross(1.0 / max(largest, T(1.0)), 1.0 / max(max_later, T(1.0)));
        cross(1.0 / max(velocity_saturation_, T(1.0)), 1.0 / max(velocity_saturation, T(1.0)));
        return share;
    }

    static constexpr int lanes = Scalar<T>::lanes;
    /// Predicted error of the next Adams step, relative to its tolerance.
    static constexpr double target_error = 0.25;
    /// The next Adams step is at least min_ratio of the last; that times a product of some of the factors, at best.
    static constexpr double min_ratio = 0.125,
                            ratio_factors[] = {8.0, 2.8284271247461903, 1.6817928305074290, 1.2968395546510096};
    static constexpr double max_turn = 0.5;    ///< largest sum of the joints' travels in an Adams step [rad or m]
    static constexpr double switch_jump = 10;  ///< growth of a sub-step's error at a switching point

    const Chain& chain_;
    const MotionSettings& motion_;
    const InverseMaxRateChange full_;
    const Kind kind_;
    const double near_singular_below_;  ///< for the square of the smallest sine
    T tolerance_ = 1.0, rate_tolerance_ = 1.0, tolerance_scale_ = 1.0;
    bool restarted_ = true;  ///< a lane has been started since the last `step`
    /// Positions are kept as start plus travel, by free joint, so that their rounding does not accumulate.
    T from_[max_joints], travelled_[max_joints];
    AdamsHistory<T> history_;
    T saturation_[max_joints], velocity_saturation_ = 0.0;  ///< at the end of the last accepted step
    T known_ = 0.0;                                         ///< length of the history, at most adams_order
    T next_step_ = 1.0;                                     ///< length of the next Adams step [sub-steps]
    T error_ = 0.0;                                         ///< of the last accepted step, relative to its tolerance
    bool has_profile_ = false, independent_ = false;        ///< as in `brake`
    T inverse_scale_[max_joints];                           ///< 1 / BrakeProfile::scale
    T slowing_ = 0.0, ramp_ = 0.0;                          ///< as in BrakeProfile [sub-steps]
    T elapsed_ = 0.0;                                       ///< sub-steps since the lane was started
    MaskOf<T> reaches_ = mask_of<T>(false);                 ///< the next sub-step will reach the wanted rates
    MaskOf<T> reached_ = mask_of<T>(false), near_singular_ = mask_of<T>(false), near_singular_now_ = mask_of<T>(false),
              singular_ = mask_of<T>(false), limited_ = mask_of<T>(false);
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
