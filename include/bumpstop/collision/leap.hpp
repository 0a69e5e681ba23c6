/// @file
/// Many controller sub-steps in one, where the rates are smooth enough for the sum to be known.
#pragma once

#include <cmath>

#include "bumpstop/collision/line_motion.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

inline constexpr int leap_order = 6;
inline constexpr int leap_levels = 5;  // leaps go over 1, 2, 4, 8 or 16 stretches
/// Values that must be known for every second of them to make a history of twice the stride.
inline constexpr int doubling_order = 2 * leap_order - 1;

/// Lagrange's polynomials for the nodes 0, -1, ..., -5, as coefficients of powers: l_j(x) = sum_p [j][p] x^p.
inline constexpr auto lagrange_coefficients = [] {
    std::array<std::array<double, leap_order>, leap_order> made{};
    for (int j = 0; j < leap_order; ++j) {
        std::array<double, leap_order> product{1};
        double divisor = 1;
        for (int i = 0; i < leap_order; ++i) {
            if (i == j) continue;
            for (int p = leap_order - 1; p > 0; --p) product[p] = product[p - 1] + i * product[p];
            product[0] *= i;
            divisor *= i - j;
        }
        for (int p = 0; p < leap_order; ++p) made[j][p] = product[p] / divisor;
    }
    return made;
}();

constexpr double lagrange(int j, double x) {
    double value = 0;
    for (int p = leap_order - 1; p >= 0; --p) value = value * x + lagrange_coefficients[j][p];
    return value;
}

/// While the arm follows the line with its rates reached, each sub-step adds h f(q) to the positions, f being
/// the resolved rates. Along the path f is a smooth function of the sub-step's number, so the sum over the
/// next `count` of them follows from its values at six moments behind, `stride` sub-steps apart: the sum is taken of
/// the polynomial through them. This is the Adams-Bashforth method with its integral replaced by the very sum the
/// controller forms, so the leap lands where the sub-steps would, not where the ideal motion would.
struct LeapWeights {
    double sum[leap_order];      ///< of the rates, newest first: positions gained, in units of the sub-step
    double predict[leap_order];  ///< the rates after `count` sub-steps, extrapolated
    double last[leap_order];     ///< the rates of the last of those sub-steps
};

/// Weights of every leap over whole stretches.
class LeapTable {
  public:
    explicit LeapTable(int sub_steps) {
        std::array<double, leap_order> power_sum{};  // sum of m^p, m < count
        int count = 0;
        for (int stretches = 1; stretches <= 1 << (leap_levels - 1); ++stretches) {
            for (; count < stretches * sub_steps; ++count) {
                double power = 1;
                for (double& sum : power_sum) {
                    sum += power;
                    power *= count;
                }
            }
            for (int level = 0; level < leap_levels; ++level) {
                if (stretches <= 1 << level)
                    set(weights_[index(level, stretches)], power_sum, count, sub_steps << level);
            }
        }
    }
    /// For a history whose values are 2^level stretches apart, after that many stretches or fewer.
    const LeapWeights& after(int level, int stretches) const { return weights_[index(level, stretches)]; }
    const LeapWeights& full(int level) const { return after(level, 1 << level); }

  private:
    static int index(int level, int stretches) { return (1 << level) - 2 + stretches; }

    static void set(LeapWeights& weights, const std::array<double, leap_order>& power_sum, int count, int stride) {
        for (int j = 0; j < leap_order; ++j) {
            double sum = 0, scale = 1;  // of l_j(m / stride)
            for (int p = 0; p < leap_order; ++p) {
                sum += lagrange_coefficients[j][p] * power_sum[p] * scale;
                scale /= stride;
            }
            weights.sum[j] = sum;
            weights.predict[j] = lagrange(j, double(count) / stride);
            weights.last[j] = lagrange(j, double(count - 1) / stride);
        }
    }

    std::array<LeapWeights, (1 << leap_levels) - 1> weights_;
};

/// Rates at the beginnings of the last strides of 2^level stretches, newest first.
template <class T>
class RateHistory {
  public:
    int level() const { return level_; }
    bool leaps() const { return known_ >= leap_order; }
    void forget() { known_ = level_ = 0; }

    void push(const T* newest, int free_count) {
        newest_ = (newest_ + 1) % places;
        for (int f = 0; f < free_count; ++f) rate_[newest_][f] = newest[f];
        if (known_ < doubling_order) ++known_;
    }
    T combine(const double (&weight)[leap_order], int f) const {
        T total = weight[0] * at(0)[f];
        for (int j = 1; j < leap_order; ++j) total += weight[j] * at(j)[f];
        return total;
    }
    bool can_double() const { return known_ == doubling_order && level_ + 1 < leap_levels; }
    void double_stride(int free_count) {
        for (int j = 1; j < leap_order; ++j)
            for (int f = 0; f < free_count; ++f) at(j)[f] = at(2 * j)[f];
        known_ = leap_order;
        ++level_;
    }
    /// The values between are those of the polynomial that was good enough to leap with.
    void halve_stride(int free_count) {
        for (int f = 0; f < free_count; ++f) {
            T between[leap_order];
            for (int k = 1; k < leap_order; ++k) {
                between[k] = lagrange(0, -0.5 * k) * at(0)[f];
                for (int j = 1; j < leap_order; ++j) between[k] += lagrange(j, -0.5 * k) * at(j)[f];
            }
            for (int k = 1; k < leap_order; ++k) at(k)[f] = between[k];
        }
        known_ = leap_order;
        --level_;
    }

  private:
    static constexpr int places = 16;  ///< doubling_order and a power of two, so that the remainder is cheap
    T* at(int j) { return rate_[(newest_ + places - j) % places]; }
    const T* at(int j) const { return rate_[(newest_ + places - j) % places]; }

    int known_ = 0, level_ = 0, newest_ = 0;
    T rate_[places][max_joints];  ///< by free joint
};

/// Extrapolated and resolved rates may differ by this much, relative to the largest rate, for a leap to stand.
/// Over a second at 1 rad/s the positions then stay within 1e-10 rad of those of the sub-steps.
inline constexpr double leap_tolerance = 1e-11;
/// Whether a stride may be doubled depends on roundings, which differ between instruction sets. So a longer leap must
/// be better by this factor, and the one before it by the next: whoever leaps then lands where the others do.
inline constexpr double long_leap_margin = 1e-2;
inline constexpr double doubling_margin = 1e-3;

}  // namespace bumpstop::inline BUMPSTOP_TARGET
