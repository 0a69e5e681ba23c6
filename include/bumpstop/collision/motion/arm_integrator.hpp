/// @file
/// Arms that brake or follow a line, one in each lane, each with Adams steps of its own length.
#pragma once

#include "bumpstop/collision/motion/adams_history.hpp"
#include "bumpstop/collision/motion/brake_profile.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

inline constexpr int max_reaction_adams_step = 128, max_line_adams_step = 256;  ///< sub-steps

/// Changes extrapolated over an Adams step and those found at its end may differ by this much, relative to the largest
/// change, for the step to stand; the difference then corrects it, some thirty times better. Instruction sets, which round
/// differently, must still agree to 1e-12: with 1e-10 they differ by 2e-12 where the arm is fast.
inline constexpr double exact_tolerance = 1e-11;
/// The same in batches, and where a reaction matters little, for nothing is gained by more. `make validate` (batches)
/// tells how accurate distributions are with them.
inline constexpr double batch_tolerance = 1e-4;
inline constexpr double max_batch_tolerance = 1e-3;

/// Of reactions that met a singularity, which would enlarge the error of a looser Adams step.
inline constexpr double near_singular_tolerance = 1e-8;

/// A singularity is near where the sine of some row of the Jacobian is this small.
inline constexpr double near_singular_sine = 1e-2;
/// Near enough for an arm that traces to ask at every step whether it is met. Farther off no Adams step gets past it:
/// the rates asked for would have grown by more than an Adams step may extrapolate.
inline constexpr double line_near_singular_sine = 1e-3;

/// Of rates that an arm has which follows a line, relative to the largest.
inline constexpr double batch_rate_tolerance = 3e-8;

/// Arms that change their rates as fast as they may: they brake, or lag behind a line. While the same joint limits the
/// acceleration the changes of the rates are smooth, and many sub-steps are one Adams step; where they are not, the
/// controller's sub-steps are taken. An arm that follows its line extrapolates the rates themselves.
template <class T>
class ArmIntegrator {
  public:
    enum class Kind {
        brake,  ///< no velocity at all is asked for, so no rates need resolving; over once it stands
        track,  ///< extrapolates with the rates reached, too
        trace,  ///< likewise, and tells singularities
    };

    ArmIntegrator(const Chain& chain, const MotionSettings& motion, Kind kind)
        : chain_(chain),
          motion_(motion),
          full_(motion),
          kind_(kind),
          near_singular_below_(std::pow(kind == Kind::trace ? line_near_singular_sine : near_singular_sine, 2)) {}

    ArmState<T> state;
    Posture<T> posture;  ///< that of the state, as `step` looked at it
    Point3<T> target;    ///< velocity asked of the tool: the line's, or the reaction's [m/s]

    /// The lane's state and target have been set anew. Its next `step` only looks where it is. Changes of the rates
    /// may differ from those extrapolated by `tolerance`, relative to the largest, and rates that are reached by
    /// `rate_tolerance`.
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
    /// The lane's acceleration limits follow a law from here on, counted from where it was begun. `independent`: each
    /// joint brakes by itself, and none keeps its ratio to the others; the same for all lanes.
    void brake(int lane, const BrakeProfile& profile, bool independent) {
        shaped_ = true;
        independent_ = independent;
        for (int f = 0; f < motion_.free_count; ++f) set_lane(inverse_scale_[f], lane, 1 / profile.scale[f]);
        set_lane(slowing_, lane, profile.slowing);
        set_lane(ramp_, lane, profile.ramp);
        set_lane(elapsed_, lane, 0.0);
    }
    /// From here on changes need to be known so many times less well.
    void relax(const MaskOf<T>& lanes, double times) { tolerance_scale_ = select(lanes, T(times), tolerance_scale_); }
    /// The rates asked for were reached in the last sub-step.
    MaskOf<T> reached() const { return reached_; }
    /// A singularity was near at an end of the last Adams step.
    MaskOf<T> near_singular() const { return near_singular_; }
    /// Where the lane is, the rates asked for are at a singularity (of arms that trace), or slowed by a velocity limit.
    bool singular(int lane) const { return lane_of(singular_, lane); }
    bool limited(int lane) const { return lane_of(limited_, lane); }
    /// Over its last Adams step the lane had the rates asked for, and they were smooth.
    bool smooth(int lane) const { return lane_of(reaches_, lane) && lane_of(known_, lane) > 1; }

    /// Where a lane was, by free joint, `back` sub-steps before it got here: within its last Adams step.
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

    /// Takes every lane over `max_step` sub-steps or fewer, and returns over how many: 0 where the lane only looked or
    /// its Adams step was undone. `look()` is called once the state, angles too, is that at the ends of the Adams
    /// steps. Of Adams steps over more than one sub-step, `rejected(which, sub-steps)` says which are to be undone; the
    /// state means nothing then until the next call.
    template <class Look, class Rejected>
    T step(const T& max_step, Look look, Rejected rejected) {
        const int n = motion_.free_count;
        const bool follows = kind_ != Kind::brake;
        const MaskOf<T> begun = known_ > T(0.0);
        const T known = known_, next_step = follows ? next_step_ : select(reaches_, T(1.0), next_step_);
        T count = select(begun, min(next_step, max_step), T(0.0));
        if (shaped_) count = min(count, before_switch());
        const AdamsWeights<T> weights =
            follows ? history_.template weights<true>(count) : history_.template weights<false>(count);
        // Where the values known are the rates themselves, which the arm has.
        const MaskOf<T> has_rates = follows ? reaches_ : none();
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
        turn();
        const Rates<T> wanted = find_wanted();
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
        look();
        // Where no sub-step was taken there is nothing to learn about the length of steps.
        const T roughness = error / max(history_.error_growth(count, known), T(1e-300));
        const MaskOf<T> goes = count > T(0.0), long_steps = count > T(1.0), single = !long_steps,
                        limited = wanted.velocity_limited;
        // Where one regime ends and another begins is found by single sub-steps.
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
        // A switching point: what was before says nothing about what comes.
        const MaskOf<T> jumps = single & (error > T(1.0)) & (error > switch_jump * error_);
        const MaskOf<T> switches = moved & (follows ? changes | jumps : (!changes) & jumps);
        error_ = select(moved, select(switches, T(std::numeric_limits<double>::infinity()), error), error_);
        known_ = select(moved, min(select(switches, T(0.0), known_) + 1.0, T(double(adams_order))),
                        select(first, T(1.0), known_));
        // The angles stay those found before: what the corrections move it by is less than it need be known to.
        const T to_position = select(has_rates, weights.correct_sum, weights.correct_sum_of_sums) * motion_.substep();
        const T to_rate = follows ? select(has_rates, weights.correct_last, weights.correct_sum) : weights.correct_sum;
        for (int f = 0; f < n; ++f) {
            const int j = motion_.free_joint[f];
            travelled_[f] = select(moved, travelled_[f] + to_position * correction[f], travelled_before[f]);
            state.q[j] = from_[f] + travelled_[f];
            state.qd[j] = select(moved, state.qd[j] + to_rate * correction[f], qd_before[f]);
        }
        // Next Adams steps go by the changes that belong to the corrected rates. The nearer the arm is to the rates
        // asked for, the more an error of its own bends the change: with `saturation` sub-steps to go, changes of the
        // rates before the correction make extrapolations unstable that are longer than some twentieth of them.
        const MaskOf<T> lags = accepted & !(has_rates | reaches);
        T corrected[max_joints], corrected_saturation[max_joints];
        find_change(wanted.free, count, corrected, corrected_saturation);
        for (int f = 0; f < n; ++f) {
            change[f] = select(lags, corrected[f], change[f]);
            saturation[f] = select(lags, corrected_saturation[f], saturation[f]);
        }
        history_.push(moved, count, change, n);
        if (any(switches)) history_.keep_newest(switches);
        // The longest next Adams step whose error will do, by what its error grows with, but none over a switching
        // point.
        T next = count * min_ratio;
        for (double factor : ratio_factors) {
            const T longer = next * factor;
            next = select(roughness * history_.error_growth(longer, known) <= T(target_error), longer, next);
        }
        const T switching_point = count * distance_to_switch(saturation, wanted.velocity_saturation);
        // An Adams step undone may have failed for another reason than the predicted switching point, so it is halved
        // at least. It is where a switching point lies on its very end, too, or beyond, as roundings may have it: what
        // is undone must be shorter next time, down to a single sub-step, which always stands.
        const T shorter = select(changes, 0.5 * count, count - 1.0);
        next = select(accepted, min(next, switching_point - count),
                      min(select(switching_point < count, min(switching_point, 0.5 * count), next), shorter));
        for (int f = 0; f < n; ++f) saturation_[f] = select(accepted, saturation[f], saturation_[f]);
        velocity_saturation_ = select(accepted, wanted.velocity_saturation, velocity_saturation_);
        // A point that goes round with the joints may pass a top and a bottom inside one Adams step, which its ends do
        // not tell.
        T turning = 0.0;
        for (int f = 0; f < n; ++f) turning += abs(state.qd[motion_.free_joint[f]]);
        next = min(next, (max_turn / motion_.substep()) / max(turning, T(1e-200)));
        const T longer = select(known_ < T(3.0), T(1.0), max(floor(next), T(1.0)));
        next_step_ = select(goes, longer, next_step_);
        const T taken = select(moved, count, T(0.0));
        if (shaped_) elapsed_ += taken;
        return taken;
    }

  private:
    void turn() {
        if (restarted_) {
            state.refresh_angles(chain_);  // of held joints as well
        } else {
            for (int f = 0; f < motion_.free_count; ++f) {
                const int j = motion_.free_joint[f];
                state.angle.set(chain_, j, state.q[j]);
            }
        }
        restarted_ = false;
        forward_kinematics(chain_, state.q, state.angle, posture);
    }

    /// As limited_change, in the sub-step that begins `count` after the last Adams step's end.
    MaskOf<T> find_change(const T* wanted, const T& count, T* change, T* saturation) const {
        if (!shaped_) return limited_change(motion_, full_, wanted, state, change, saturation);
        const T now = elapsed_ + count;
        const MaskOf<T> slows = now < slowing_;
        // The limits in units of what they grow to.
        const T grown = select(slows & (ramp_ > T(0.0)), min((now + 0.5) / max(ramp_, T(1e-300)), T(1.0)), T(1.0));
        T tightened[max_joints];
        for (int f = 0; f < motion_.free_count; ++f) tightened[f] = select(slows, inverse_scale_[f], T(1.0)) / grown;
        return limited_change(motion_, full_, wanted, state, change, saturation, tightened, independent_);
    }

    /// Sub-steps that an Adams step may take: what the limits grow to, and where they jump, a single one crosses.
    T before_switch() const {
        // The first sub-steps of which the limits no longer grow, and no longer are those of the stop.
        const T full = -floor(0.5 - ramp_), after = -floor(-slowing_);
        T allowed = double(max_line_adams_step) * 16;
        for (const T& switching : {full, after})
            allowed = select(elapsed_ < switching, min(allowed, max(switching - 1.0 - elapsed_, T(1.0))), allowed);
        return allowed;
    }

    Rates<T> find_wanted() const {
        if (kind_ != Kind::brake) {
            return resolved_rates(chain_, motion_, posture, target);
        }
        Rates<T> still;
        for (int f = 0; f < motion_.free_count; ++f) still.free[f] = 0.0;
        still.conditioning = {none(), T(1.0)};
        still.velocity_limited = none();
        still.velocity_saturation = 0.0;
        return still;
    }

    /// How much of the last Adams step lay before the next switching point, as far as the loads at its ends can tell:
    /// more than all of it where the switching point is still to come. Kinks are where another joint limits the
    /// acceleration, where the rates asked for are reached or left, where a velocity limit begins or ends to matter,
    /// and singularities.
    T distance_to_switch(const T* saturation, const T& velocity_saturation) const {
        const T never = 1e9;
        T max_step = saturation_[0], later = saturation[0], max_later = saturation[0];
        for (int f = 1; f < motion_.free_count; ++f) {
            const auto greater = saturation_[f] > max_step;
            max_step = select(greater, saturation_[f], max_step);
            later = select(greater, saturation[f], later);
            max_later = max(max_later, saturation[f]);
        }
        T share = never;
        auto cross = [&](const T& before, const T& after) {
            // Of a difference that falls to zero.
            const T fall = before - after;
            share = min(share, select(fall > T(0.0), before / max(fall, T(1e-300)), never));
        };
        for (int f = 0; f < motion_.free_count; ++f) cross(max_step - saturation_[f], later - saturation[f]);
        const auto lags = max_step > T(1.0);
        share = select(lags, share, never);
        if (independent_) {
            share = never;
            for (int f = 0; f < motion_.free_count; ++f)
                if (any(saturation_[f] > T(1.0)))
                    cross(max(saturation_[f] - 1.0, T(0.0)),
                          select(saturation_[f] > T(1.0), saturation[f] - 1.0, T(0.0)));
        }
        const T sign = select(lags, T(1.0), T(-1.0)), way = select(velocity_saturation_ > T(1.0), T(1.0), T(-1.0));
        cross(sign * (max_step - 1.0), sign * (max_later - 1.0));
        cross(way * (velocity_saturation_ - 1.0), way * (velocity_saturation - 1.0));
        // Rates asked for that grow past all bounds point the other way beyond the singularity ahead, and those that
        // were slowed to a velocity limit show it only there: an Adams step over two of them in a row would not be
        // detected.
        cross(1.0 / max(max_step, T(1.0)), 1.0 / max(max_later, T(1.0)));
        cross(1.0 / max(velocity_saturation_, T(1.0)), 1.0 / max(velocity_saturation, T(1.0)));
        return share;
    }

    static constexpr int lanes = Scalar<T>::lanes;
    static MaskOf<T> none() { return T(0.0) > T(1.0); }
    /// Of an Adams step, relative to what is allowed.
    static constexpr double target_error = 0.25;
    /// The next Adams step is this much shorter than the last at max_step, or any product of some of the factors longer
    /// than that.
    static constexpr double min_ratio = 0.125,
                            ratio_factors[] = {8.0, 2.8284271247461903, 1.6817928305074290, 1.2968395546510096};
    /// Sum of what the joints turn, or go, in an Adams step at max_step [rad or m].
    static constexpr double max_turn = 0.5;
    static constexpr double switch_jump = 10;  ///< of the error of a single sub-step

    const Chain& chain_;
    const MotionSettings& motion_;
    const InverseMaxRateChange full_;
    const Kind kind_;
    const double near_singular_below_;  ///< of the square of the least sine
    T tolerance_ = 1.0, rate_tolerance_ = 1.0, tolerance_scale_ = 1.0;
    bool restarted_ = true;  ///< a lane has, since the last `step`
    /// Positions are kept as those of the beginning and what was gained since, by free joint: so roundings of the
    /// former do not add up.
    T from_[max_joints], travelled_[max_joints];
    AdamsHistory<T> history_;
    T saturation_[max_joints], velocity_saturation_ = 0.0;  ///< as of the last look that counted
    T known_ = 0.0;                                         ///< moments of the history, at most adams_order
    T next_step_ = 1.0;                                     ///< length of the next Adams step
    T error_ = 0.0;                                         ///< of the last Adams step that accepted
    bool shaped_ = false, independent_ = false;             ///< as of `brake`
    T inverse_scale_[max_joints];                           ///< of the limits while the lane slows down
    T slowing_ = 0.0, ramp_ = 0.0;                          ///< as of BrakeProfile [sub-steps]
    T elapsed_ = 0.0;                                       ///< sub-steps since the lane was begun
    MaskOf<T> reaches_ = none();                            ///< the next sub-step will reach the rates asked for
    MaskOf<T> reached_ = none(), near_singular_ = none(), near_singular_now_ = none(), singular_ = none(),
              limited_ = none();
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
