/// @file
/// Adams-Bashforth steps of variable length: past rate changes of an arm, unevenly spaced in time, and their weights.
#pragma once

#include "bumpstop/model/kinematics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

inline constexpr int adams_order = 7;  ///< past values that an Adams-Bashforth step extrapolates from

/// Weights of the past values, newest first, in a step over the next `count` sub-steps.
template <class T>
struct AdamsWeights {
    T sum[adams_order];          ///< sum of the changes: the rates gained
    T sum_of_sums[adams_order];  ///< sum of these sums: the positions gained, in units of the sub-step
    T predict[adams_order];      ///< change after the last sub-step, extrapolated
    T last[adams_order];         ///< change in the last sub-step; only with `WithLast`
    /// Corrections of `sum`, `sum_of_sums` and `last` per unit of (change found after the step - predicted change).
    T correct_sum, correct_sum_of_sums, correct_last;
};

/// Age of history entries that are empty [sub-steps]. A value so long ago does not affect the polynomial over the
/// coming sub-steps, so a short history gives a step of lower order.
inline constexpr double never_age = 1e12;

/// Rate changes at the ends of a lane's last Adams steps, with their ages. Keeping the ages makes steps of any length
/// possible without losing history, different ones in every lane.
///
/// The Lagrange polynomial through the values is summed over the sub-steps, not integrated, so that a step ends exactly
/// where the controller's sub-steps would.
template <class T>
class AdamsHistory {
  public:
    void reset(int lane) {
        for (int j = 0; j < adams_order; ++j) {
            set_lane(age_[j], lane, never_age * j);
            for (T& change : change_[j]) set_lane(change, lane, 0.0);
        }
    }
    /// Adds the change that lanes in `taken` find after a step of `count` sub-steps.
    void push(const MaskOf<T>& taken, const T& count, const T* change, int free_count) {
        for (int j = adams_order - 1; j > 0; --j) {
            age_[j] = select(taken, age_[j - 1] + count, age_[j]);
            for (int f = 0; f < free_count; ++f) change_[j][f] = select(taken, change_[j - 1][f], change_[j][f]);
        }
        for (int f = 0; f < free_count; ++f) change_[0][f] = select(taken, change[f], change_[0][f]);
    }
    /// Drops all values but the newest.
    void keep_newest(const MaskOf<T>& lane) {
        for (int j = 1; j < adams_order; ++j) {
            age_[j] = select(lane, T(never_age * j), age_[j]);
            for (T& change : change_[j]) change = select(lane, T(0.0), change);
        }
    }
    /// The first value of lanes that have just been started.
    void set_first(const MaskOf<T>& lane, const T* change, int free_count) {
        for (int f = 0; f < free_count; ++f) change_[0][f] = select(lane, change[f], change_[0][f]);
    }
    /// The error of a prediction over `count` sub-steps from `known` values grows with this product of distances.
    T error_growth(const T& count, const T& known) const {
        T product = count;
        BUMPSTOP_UNROLL
        for (int j = 1; j < adams_order; ++j) product = product * select(known > T(double(j)), count + age_[j], T(1.0));
        return product;
    }
    T combine(const T (&weight)[adams_order], int f) const {
        T total = weight[0] * change_[0][f];
        BUMPSTOP_UNROLL
        for (int j = 1; j < adams_order; ++j) total += weight[j] * change_[j][f];
        return total;
    }

    /// The history of one lane, copied to all lanes.
    AdamsHistory broadcast(int lane, int free_count) const {
        AdamsHistory one;
        for (int j = 0; j < adams_order; ++j) {
            one.age_[j] = lane_of(age_[j], lane);
            for (int f = 0; f < free_count; ++f) one.change_[j][f] = lane_of(change_[j][f], lane);
        }
        return one;
    }

    /// Weights of a step over `count` sub-steps; a negative count goes back in time. Everything up to the last division
    /// is in whole numbers, which doubles hold exactly unless a value is very old.
    template <bool WithLast = false>
    AdamsWeights<T> weights(const T& count) const {
        constexpr int last = adams_order - 1;
        // With x the sub-steps from now: product of (x + age) over all values but the newest, whose age is 0.
        T product[last + 1] = {T(1.0)};
        BUMPSTOP_UNROLL
        for (int j = 1; j <= last; ++j) {
            product[j] = product[j - 1];
            BUMPSTOP_UNROLL
            for (int p = j - 1; p > 0; --p) product[p] = product[p] * age_[j] + product[p - 1];
            product[0] = product[0] * age_[j];
        }
        // Sums of m^p over 0 <= m < count (Faulhaber's formulas).
        const T n = count, m = n - 1.0, a = 0.5 * m * n, aa = a * a, even = a * (2.0 * n - 1.0) * (1.0 / 3);
        const T power_sum[adams_order + 2] = {
            n,
            a,
            even,
            aa,
            even * (6.0 * a - 1.0) * (1.0 / 5),
            aa * (4.0 * a - 1.0) * (1.0 / 3),
            even * (12.0 * aa - 6.0 * a + 1.0) * (1.0 / 7),
            aa * (6.0 * aa - 4.0 * a + 1.0) * (1.0 / 3),
            even * (((40.0 * a - 40.0) * a + 18.0) * a - 3.0) * (1.0 / 15),
        };
        AdamsWeights<T> weights;
        // Sums and last value of the polynomial (c[0] x^shift + .. + c[degree] x^(shift + degree)) times `inverse`.
        auto set = [&](const T* c, int shift, int degree, const T& inverse, T& sum_to, T& sum_of_sums, T& last_value) {
            T sum = c[0] * power_sum[shift], weighted = c[0] * power_sum[shift + 1];
            BUMPSTOP_UNROLL
            for (int p = 1; p <= degree; ++p) {
                sum += c[p] * power_sum[p + shift];
                weighted += c[p] * power_sum[p + shift + 1];
            }
            sum_to = sum * inverse;
            sum_of_sums = (n * sum - weighted) * inverse;
            if constexpr (WithLast) {
                T before = c[degree];
                BUMPSTOP_UNROLL
                for (int p = 1; p <= degree; ++p) before = before * m + c[degree - p];
                last_value = (shift == 1 ? before * m : before) * inverse;
            }
        };
        auto value_after = [&](const T* c, int degree) {
            T value = c[degree];
            BUMPSTOP_UNROLL
            for (int p = 1; p <= degree; ++p) value = value * n + c[degree - p];
            return value;
        };
        const T after = value_after(product, last), newest = 1.0 / product[0];
        weights.predict[0] = after * newest;
        set(product, 0, last, newest, weights.sum[0], weights.sum_of_sums[0], weights.last[0]);
        set(product, 1, last, 1.0 / max(abs(n * after), T(1e-300)), weights.correct_sum, weights.correct_sum_of_sums,
            weights.correct_last);
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
            const T inverse = 1.0 / divisor;
            weights.predict[j] = n * value_after(rest, last - 1) * inverse;
            set(rest, 1, last - 1, inverse, weights.sum[j], weights.sum_of_sums[j], weights.last[j]);
        }
        return weights;
    }

  private:
    T age_[adams_order];  ///< sub-steps ago
    T change_[adams_order][max_joints];
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
