// Many controller sub-steps in one, where the rates are smooth enough for the sum to be known.
#pragma once

#include <cmath>

#include "bumpstop/collision/line_motion.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

inline constexpr int leap_order = 6;

// While the arm follows the line with its rates reached, each sub-step adds h f(q) to the positions, f being
// the resolved rates. Along the path f is a smooth function of the sub-step's number, so the sum over the
// next `sub_steps` of them follows from its values at the beginnings of the last six stretches of that
// length: the sum is taken of the polynomial through them. This is the Adams-Bashforth method with its
// integral replaced by the very sum the controller forms, so the leap lands where the sub-steps would, not
// where the ideal motion would.
struct LeapWeights {
    double sum[leap_order];          // of the rates, newest first: positions gained, in units of the sub-step
    double predict[leap_order];      // the rates at the end of the stretch, extrapolated
    double last[leap_order];         // the rates of the last sub-step before the newest of six
    double sum_of_sums[leap_order];  // as `sum`, summed once more: positions from changes of rates

    explicit LeapWeights(int sub_steps) {
        // Lagrange's polynomials for the nodes 0, -1, ..., -5 in units of the stretch.
        auto lagrange = [](int j, double x) {
            double value = 1;
            for (int i = 0; i < leap_order; ++i) {
                if (i != j) value *= (x + i) / (i - j);
            }
            return value;
        };
        for (int j = 0; j < leap_order; ++j) {
            sum[j] = 0;
            sum_of_sums[j] = 0;
            for (int m = 0; m < sub_steps; ++m) {
                const double value = lagrange(j, double(m) / sub_steps);
                sum[j] += value;
                sum_of_sums[j] += (sub_steps - m) * value;
            }
            predict[j] = lagrange(j, 1);
            last[j] = lagrange(j, -1.0 / sub_steps);
        }
    }
};

// Rates, or their changes, at the beginnings of the last stretches, newest first.
template <class T>
struct RateHistory {
    int known = 0;
    T rate[leap_order][max_joints];  // by free joint

    void push(const T* newest, int free_count) {
        for (int j = leap_order - 1; j > 0; --j)
            for (int f = 0; f < free_count; ++f) rate[j][f] = rate[j - 1][f];
        for (int f = 0; f < free_count; ++f) rate[0][f] = newest[f];
        if (known < leap_order) ++known;
    }
    T combine(const double (&weight)[leap_order], int f) const {
        T total = weight[0] * rate[0][f];
        for (int j = 1; j < leap_order; ++j) total += weight[j] * rate[j][f];
        return total;
    }
};

// Extrapolated and resolved rates may differ by this much, relative to the largest rate, for a leap to stand.
// Over a thousand leaps of 4 ms at 1 rad/s the positions then stay within 1e-10 rad of those of the
// sub-steps.
inline constexpr double leap_tolerance = 1e-11;
// The same for the changes of the rates while the arm brakes, where the error has no time to grow: over 0.1 s
// at 5 rad/s^2 the positions stay within 1e-11 rad.
inline constexpr double braking_leap_tolerance = 1e-9;

}  // namespace bumpstop::inline BUMPSTOP_TARGET
