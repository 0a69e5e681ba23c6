/// @file
/// Arms that brake, one in each lane, each with leaps of its own length.
#pragma once

#include "bumpstop/collision/line_motion.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

inline constexpr int braking_order = 6;           ///< values a leap goes by
inline constexpr int longest_braking_leap = 128;  ///< sub-steps

/// What the sums over the next `count` sub-steps are of the values known, newest first.
template <class T>
struct UnevenWeights {
    T sum[braking_order];          ///< of the changes: rates gained
    T sum_of_sums[braking_order];  ///< summed once more: positions gained, in units of the sub-step
    T predict[braking_order];      ///< the change after them, extrapolated
    T last[braking_order];         ///< that of the last of them; only where asked for
};

/// The changes of the rates at the last moments a lane looked at. The moments lie as far apart as its leaps were long,
/// so no history is lost when a leap is made longer or shorter, and lanes need not agree.
///
/// The polynomial through the values is Lagrange's. It is summed over the sub-steps, not integrated, so a leap lands
/// where the controller does.
template <class T>
class UnevenHistory {
  public:
    void forget(int lane) {
        for (int j = 0; j < braking_order; ++j) {
            // Moments that never were must differ, for nothing to be divided by zero.
            set_lane(age_[j], lane, double(j));
            for (T& change : change_[j]) set_lane(change, lane, 0.0);
        }
    }
    /// Where `taken`, the arm has gone `count` sub-steps and then finds this change.
    void push(const MaskOf<T>& taken, const T& count, const T* change, int free_count) {
        for (int j = braking_order - 1; j > 0; --j) {
            age_[j] = select(taken, age_[j - 1] + count, age_[j]);
            for (int f = 0; f < free_count; ++f) change_[j][f] = select(taken, change_[j - 1][f], change_[j][f]);
        }
        for (int f = 0; f < free_count; ++f) change_[0][f] = select(taken, change[f], change_[0][f]);
    }
    /// Of a lane that has just begun.
    void set_first(int lane, const T* change, int free_count) {
        for (int f = 0; f < free_count; ++f) set_lane(change_[0][f], lane, lane_of(change[f], lane));
    }
    T combine(const T (&weight)[braking_order], int f) const {
        T total = weight[0] * change_[0][f];
        BUMPSTOP_UNROLL
        for (int j = 1; j < braking_order; ++j) total += weight[j] * change_[j][f];
        return total;
    }

    /// One lane's history in all of them.
    UnevenHistory spread(int lane, int free_count) const {
        UnevenHistory one;
        for (int j = 0; j < braking_order; ++j) {
            one.age_[j] = lane_of(age_[j], lane);
            for (int f = 0; f < free_count; ++f) one.change_[j][f] = lane_of(change_[j][f], lane);
        }
        return one;
    }

    /// Every step but the last division is in whole numbers, which doubles hold exactly. A negative count goes back.
    template <bool WithLast = false>
    UnevenWeights<T> weights(const T& count) const {
        constexpr int last = braking_order - 1;
        // With x the sub-steps from now: product of all (x + age) but the newest moment's, whose age is 0.
        T product[last + 1] = {T(1.0)};
        BUMPSTOP_UNROLL
        for (int j = 1; j <= last; ++j) {
            product[j] = product[j - 1];
            BUMPSTOP_UNROLL
            for (int p = j - 1; p > 0; --p) product[p] = product[p] * age_[j] + product[p - 1];
            product[0] = product[0] * age_[j];
        }
        // Sums of m^p over 0 <= m < count (Faulhaber).
        const T n = count, m = n - 1.0, twice = m * n * (2.0 * n - 1.0), s1 = 0.5 * m * n, square = s1 * s1;
        const T power_sum[braking_order + 1] = {
            n,
            s1,
            twice * (1.0 / 6),
            square,
            twice * (3.0 * n * m - 1.0) * (1.0 / 30),
            square * (2.0 * n * m - 1.0) * (1.0 / 3),
            twice * (3.0 * n * n * n * (n - 2.0) + 3.0 * n + 1.0) * (1.0 / 42),
        };
        UnevenWeights<T> weights;
        auto set = [&](int j, const T* c, int shift, int degree, const T& divisor) {
            const T inverse = 1.0 / divisor;
            T sum = c[0] * power_sum[shift], weighted = c[0] * power_sum[shift + 1], value = c[degree];
            BUMPSTOP_UNROLL
            for (int p = 1; p <= degree; ++p) {
                sum += c[p] * power_sum[p + shift];
                weighted += c[p] * power_sum[p + shift + 1];
                value = value * n + c[degree - p];
            }
            weights.sum[j] = sum * inverse;
            weights.sum_of_sums[j] = (n * sum - weighted) * inverse;
            weights.predict[j] = (shift == 1 ? value * n : value) * inverse;
            if constexpr (WithLast) {
                T before = c[degree];
                BUMPSTOP_UNROLL
                for (int p = 1; p <= degree; ++p) before = before * m + c[degree - p];
                weights.last[j] = (shift == 1 ? before * m : before) * inverse;
            }
        };
        set(0, product, 0, last, product[0]);
        BUMPSTOP_UNROLL
        for (int j = 1; j <= last; ++j) {
            T rest[last], divisor = -age_[j];
            rest[last - 1] = 1.0;
            BUMPSTOP_UNROLL
            for (int p = last - 1; p > 0; --p) rest[p - 1] = product[p] - age_[j] * rest[p];
            BUMPSTOP_UNROLL
            for (int i = 1; i <= last; ++i) {
                if (i != j) divisor = divisor * (age_[i] - age_[j]);
            }
            set(j, rest, 1, last - 1, divisor);
        }
        return weights;
    }

  private:
    T age_[braking_order];  ///< sub-steps ago
    T change_[braking_order][max_joints] = {};
};

/// Extrapolated and true changes may differ by this much, relative to the largest change, for a leap to stand. Roundings
/// decide about the length of leaps, and instruction sets, which round differently, must still agree to 1e-12.
inline constexpr double braking_leap_tolerance = 1e-11;
/// The same where 1e-9 m are enough: over 0.5 s at 5 rad/s^2 the positions stay within 1e-10 rad of those of the
/// sub-steps. And where a reaction matters little, for nothing is gained by more.
inline constexpr double loose_braking_leap_tolerance = 1e-8;
inline constexpr double loosest_braking_leap_tolerance = 1e-4;

/// Of an arm that follows its line, as of one that brakes, but relative to the largest rate.
inline constexpr double following_leap_tolerance = 1e-10;

inline constexpr double tracing_leap_tolerance = 1e-8;

/// Arms that brake. While the same joint limits the deceleration the changes of the rates are smooth, and many
/// sub-steps are a leap; where they are not, the controller's sub-steps are taken.
template <class T>
class BrakingArm {
  public:
    enum class Kind {
        stops,     ///< no velocity at all is asked for, so no rates need resolving
        reverses,  ///< over once the rates asked for are reached
        follows,   ///< leaps with the rates reached, too
    };

    BrakingArm(const Chain& chain, const MotionSettings& motion, Kind kind)
        : chain_(chain), motion_(motion), kind_(kind) {}

    ArmState<T> state;
    Point3<T> target;  ///< velocity the reaction asks for
    Posture<T> posture;

    /// The lane's state and target have been set anew. Its next `advance` only looks where it is. Changes of the rates
    /// may differ from those extrapolated by `leap_tolerance`, relative to the largest.
    void begin(int lane, double leap_tolerance) {
        set_lane(tolerance_, lane, leap_tolerance);
        history_.forget(lane);
        known_[lane] = 0;
        wish_[lane] = 1;
        reached_[lane] = false;
    }
    /// The rates asked for were reached in the last sub-step.
    bool reached(int lane) const { return reached_[lane]; }
    /// A singularity was near at an end of the last leap.
    bool poor(int lane) const { return poor_[lane]; }
    /// Where the lane is, the rates asked for are at a singularity, or slowed by a velocity limit.
    bool singular(int lane) const { return singular_[lane]; }
    bool limited(int lane) const { return limited_[lane]; }

    /// Where a lane was, by free joint, `back` sub-steps before it got here: within its last leap.
    void before(int lane, const T& back, T* q, T* qd) const {
        const int n = motion_.free_count;
        const UnevenHistory<T> own = history_.spread(lane, n);
        const T count = -back;
        const UnevenWeights<T> weights = own.template weights<true>(count);
        for (int f = 0; f < n; ++f) {
            const int j = motion_.free_joint[f];
            const double rate = lane_of(state.qd[j], lane);
            const T gained =
                reaches_[lane] ? own.combine(weights.sum, f) : count * rate + own.combine(weights.sum_of_sums, f);
            const T then = reaches_[lane] ? own.combine(weights.last, f) : rate + own.combine(weights.sum, f);
            q[f] = lane_of(state.q[j], lane) + motion_.substep() * gained;
            qd[f] = select(back > T(0.0), then, T(rate));
        }
    }

    /// Takes every lane over `most[lane]` sub-steps or fewer; gone[lane] is how many, 0 where the lane only looked or its
    /// leap was undone. `look()` is called once state and posture are those at the ends of the leaps. Where `accept(lane,
    /// sub-steps)` does not agree then, a leap of more than one sub-step is undone, and state and posture mean nothing
    /// until the next call.
    template <class Look, class Accept>
    void advance(const int* most, int* gone, Look look, Accept accept) {
        const int n = motion_.free_count;
        T count;
        for (int lane = 0; lane < lanes; ++lane) {
            const bool leaps = known_[lane] == braking_order && (kind_ == Kind::follows || !reaches_[lane]);
            gone[lane] = known_[lane] == 0 ? 0 : std::min(leaps ? wish_[lane] : 1, most[lane]);
            set_lane(count, lane, double(gone[lane]));
        }
        const bool follows = kind_ == Kind::follows;
        const UnevenWeights<T> weights =
            follows ? history_.template weights<true>(count) : history_.template weights<false>(count);
        T following = 0.0;  // 1: the values known are the rates themselves, which the arm has
        for (int lane = 0; follows && lane < lanes; ++lane) set_lane(following, lane, reaches_[lane] ? 1.0 : 0.0);
        const MaskOf<T> has_rates = following > T(0.0);
        T q_before[max_joints], qd_before[max_joints];
        for (int f = 0; f < n; ++f) {
            const int j = motion_.free_joint[f];
            q_before[f] = state.q[j];
            qd_before[f] = state.qd[j];
            const T sum = history_.combine(weights.sum, f);
            T gained = count * state.qd[j] + history_.combine(weights.sum_of_sums, f), rate = state.qd[j] + sum;
            if (follows) {
                gained = select(has_rates, sum, gained);
                rate = select(has_rates, history_.combine(weights.last, f), rate);
                rate = select(count > T(0.0), rate, state.qd[j]);
            }
            state.q[j] += motion_.substep() * gained;
            state.qd[j] = rate;
        }
        state.refresh_angles(chain_);
        forward_kinematics(chain_, state.q, state.angle, posture);
        Rates<T> wanted;
        if (kind_ == Kind::stops) {
            for (int f = 0; f < n; ++f) wanted.free[f] = 0.0;
            wanted.conditioning = {T(0.0) > T(1.0), T(0.0) > T(1.0)};
            wanted.velocity_limited = T(0.0) > T(1.0);
        } else {
            wanted = resolved_rates(chain_, motion_, posture, target);
        }
        T change[max_joints];
        const MaskOf<T> reaches = limited_change(motion_, wanted.free, state, change);
        T off = 0.0, largest = 0.0, largest_rate = 0.0;
        for (int f = 0; f < n; ++f) {
            if (follows) {
                change[f] = select(reaches, wanted.free[f], change[f]);
                largest_rate = maximum(largest_rate, absolute(wanted.free[f]));
            }
            off = maximum(off, absolute(change[f] - history_.combine(weights.predict, f)));
            largest = maximum(largest, absolute(change[f]));
        }
        const T allowed = follows ? select(reaches, largest_rate * following_leap_tolerance, largest * tolerance_)
                                  : largest * tolerance_;
        const T error = off / maximum(allowed, T(1e-300));
        look();
        T stands = 0.0;
        for (int lane = 0; lane < lanes; ++lane) {
            const int over = gone[lane];
            if (over == 0 && known_[lane] > 0) continue;
            const double e = lane_of(error, lane);
            const bool reaching = lane_of(reaches, lane), limited = lane_of(wanted.velocity_limited, lane);
            // Where one regime ends and another begins is found by single sub-steps.
            const bool changes = follows ? reaching != reaches_[lane] || limited != limited_[lane] : reaching;
            if (over > 1 && (!(e <= 1) || changes)) {
                wish_[lane] = std::max(1, over / 3);
                gone[lane] = 0;
                continue;
            }
            if (over > 1 && !accept(lane, over)) {
                gone[lane] = 0;
                continue;
            }
            set_lane(stands, lane, 1.0);
            reached_[lane] = over == 1 && reaches_[lane];
            reaches_[lane] = reaching;
            limited_[lane] = limited;
            singular_[lane] = lane_of(wanted.conditioning.singular, lane);
            poor_[lane] = (over > 0 && poor_now_[lane]) || lane_of(wanted.conditioning.poor, lane);
            poor_now_[lane] = lane_of(wanted.conditioning.poor, lane);
            if (over == 0) {
                history_.set_first(lane, change, n);
                known_[lane] = 1;
                continue;
            }
            // The error of a leap grows with its sixth power.
            if (known_[lane] == braking_order && e < 0.1)
                wish_[lane] = e < 1e-4 ? 4 * over : e < 4e-3 ? 2 * over : over + (over + 3) / 4;
            known_[lane] = follows && changes ? 1 : std::min(known_[lane] + 1, braking_order);
        }
        const MaskOf<T> stood = stands > T(0.0), stays = !(stood | !(count > T(0.0)));
        if (any(stays)) {
            for (int f = 0; f < n; ++f) {
                const int j = motion_.free_joint[f];
                state.q[j] = select(stays, q_before[f], state.q[j]);
                state.qd[j] = select(stays, qd_before[f], state.qd[j]);
            }
        }
        history_.push(stood & (count > T(0.0)), count, change, n);
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;

    const Chain& chain_;
    const MotionSettings& motion_;
    const Kind kind_;
    T tolerance_ = 1.0;
    UnevenHistory<T> history_;
    int known_[lanes] = {};     ///< moments of the history, at most braking_order
    int wish_[lanes] = {};      ///< length of the next leap
    bool reaches_[lanes] = {};  ///< the next sub-step will reach the rates asked for
    bool reached_[lanes] = {}, poor_[lanes] = {}, poor_now_[lanes] = {}, singular_[lanes] = {}, limited_[lanes] = {};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
