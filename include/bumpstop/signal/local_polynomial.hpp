/// @file
/// Derivatives by local polynomial regression: a Savitzky-Golay filter for any sampling times.
///
/// Units: t [s], q [rad or any other], derivatives per s and s2.
#pragma once

#include <cstddef>
#include <vector>

#include "bumpstop/math/lanes.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

inline constexpr int max_fit_degree = 5;
/// Largest window of the fits in a control loop.
inline constexpr int max_window_samples = 512;

/// Samples in a window of `time` seconds, one every `period` seconds, from the oldest to the newest: at least one more
/// than `degree`, which a fit needs, and at most max_window_samples.
inline int window_samples(double time, double period, int degree) noexcept {
    // Values up to just above a half are rounded down: 70 ms at 250 Hz are 17 intervals for any clock near 4 ms.
    const double intervals = time / period + 0.45;
    // For NaN the condition holds, too: it gives the smallest window.
    if (!(intervals > degree)) return degree + 1;
    return intervals >= max_window_samples ? max_window_samples : int(intervals) + 1;
}

/// Arrays of a fit, `n` numbers each: a whole number of registers of T.
struct FitArrays {
    const double* x;       ///< time of a sample minus the time of the estimate [s]
    const double* weight;  ///< of its squared deviation, not negative; 0: the sample is ignored
    double* before;        ///< scratch
    double* current;       ///< scratch
    double* out[3];        ///< out[r][k]: filter coefficient of sample k for derivative r [1/s^r]
    int n;
};

/// Filter coefficients out[r][k]: sum_k out[r][k] q_k is derivative r = 0, 1, 2, at x = 0, of the polynomial fitted to
/// q. More than `degree` samples must have a weight above 0 and distinct times.
///
/// The polynomials that are orthogonal under the weights are computed by their three-term recurrence (Forsythe, J. SIAM
/// 5, 1957), so no ill-conditioned system is solved. One sample per lane.
template <class T>
void derivative_weights(const FitArrays& a, int degree) noexcept {
    constexpr int lanes = Scalar<T>::lanes;
    for (int k = 0; k < a.n; k += lanes) {
        store(T(0.0), a.before + k);
        store(T(1.0), a.current + k);
        for (double* out : a.out) store(T(0.0), out + k);
    }
    double at[3] = {1, 0, 0}, at_before[3] = {0, 0, 0};  // the polynomial and its derivatives at x = 0
    double norm_before = 1;
    for (int j = 0;; ++j) {
        T square = 0.0, moment = 0.0;
        for (int k = 0; k < a.n; k += lanes) {
            const T p = load<T>(a.current + k), term = load<T>(a.weight + k) * p * p;
            square += term;
            moment += term * load<T>(a.x + k);
        }
        const double norm = sum_of_lanes(square), center = sum_of_lanes(moment) / norm,
                     b = j > 0 ? norm / norm_before : 0;
        const double share[3] = {at[0] / norm, at[1] / norm, at[2] / norm};
        for (int k = 0; k < a.n; k += lanes) {
            const T p = load<T>(a.current + k), weighted = load<T>(a.weight + k) * p;
            for (int r = 0; r < 3; ++r) store(load<T>(a.out[r] + k) + weighted * share[r], a.out[r] + k);
            store((load<T>(a.x + k) - center) * p - load<T>(a.before + k) * b, a.current + k);
            store(p, a.before + k);
        }
        if (j == degree) return;
        for (int r = 2; r >= 0; --r) {
            const double next = (r > 0 ? r * at[r - 1] : 0) - center * at[r] - b * at_before[r];
            at_before[r] = at[r];
            at[r] = next;
        }
        norm_before = norm;
    }
}

/// Smoothed positions, rates and accelerations of `columns` series at `rows` common, increasing times. q and out are
/// row-major.
///
/// At every time a polynomial is fitted to the samples closer than h, with the weights 1 - (dt / h)^2. The weights are
/// zero at the edge, so samples enter and leave the window without a step. h is half the window. It grows to the whole
/// window towards the ends of the record and, where samples are sparse, until degree + 1 on either side lie within 0.8
/// h.
inline void local_derivatives(const double* t, const double* q, std::size_t rows, std::size_t columns, double window,
                              int degree, double* const (&out)[3]) {
    using L = Lanes<native_lanes>;
    const std::size_t groups = (columns + native_lanes - 1) / native_lanes;
    std::vector<L> value(rows * groups, L(0.0));
    for (std::size_t i = 0; i < rows; ++i)
        for (std::size_t j = 0; j < columns; ++j)
            set_lane(value[i * groups + j / native_lanes], int(j % native_lanes), q[i * columns + j]);

    const std::size_t side = std::size_t(degree) + 1;
    std::vector<double> scratch;
    std::size_t begin = 0, end = 0;  // samples closer than h; both only increase
    for (std::size_t i = 0; i < rows; ++i) {
        double h = std::max(0.5 * window, window - std::min(t[i] - t[0], t[rows - 1] - t[i]));
        while (t[i] - t[begin] >= h) ++begin;
        while (end < rows && t[end] - t[i] < h) ++end;
        // At an end of the record the other side makes up for the samples that are missing.
        const std::size_t past = i, future = rows - 1 - i;
        const std::size_t back = std::min(past, side + (side - std::min(side, future)));
        const std::size_t ahead = std::min(future, side + (side - std::min(side, past)));
        h = std::max(h, 1.25 * std::max(t[i] - t[i - back], t[i + ahead] - t[i]));
        std::size_t first = begin, last = end;
        while (first > 0 && t[i] - t[first - 1] < h) --first;
        while (last < rows && t[last] - t[i] < h) ++last;
        const int count = int(last - first), padded = (count + native_lanes - 1) / native_lanes * native_lanes;
        if (scratch.size() < std::size_t(7 * padded)) scratch.resize(std::size_t(7 * padded));
        double* s = scratch.data();
        double *x = s, *weight = s + padded;
        for (int k = 0; k < padded; ++k) {
            x[k] = k < count ? t[first + k] - t[i] : 0.0;
            weight[k] = k < count ? 1 - (x[k] / h) * (x[k] / h) : 0.0;
        }
        const FitArrays fit{
            x, weight, s + 2 * padded, s + 3 * padded, {s + 4 * padded, s + 5 * padded, s + 6 * padded}, padded};
        derivative_weights<L>(fit, degree);
        for (std::size_t g = 0; g < groups; ++g) {
            // Differences to the sample itself avoid cancellation where the signal has a large constant.
            const L reference = value[i * groups + g];
            L sum[3] = {0.0, 0.0, 0.0};
            for (int k = 0; k < count; ++k) {
                const L d = value[(first + k) * groups + g] - reference;
                for (int r = 0; r < 3; ++r) sum[r] += d * fit.out[r][k];
            }
            sum[0] += reference;
            const std::size_t j = g * native_lanes;
            for (int r = 0; r < 3; ++r)
                for (int lane = 0; lane < native_lanes && j + lane < columns; ++lane)
                    out[r][i * columns + j + lane] = lane_of(sum[r], lane);
        }
    }
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
