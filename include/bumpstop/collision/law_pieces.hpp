/// @file
/// A distribution made of pieces: offsets in a panel, detection at one tick.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "bumpstop/math/interruption.hpp"
#include "bumpstop/math/quadrature.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Over panel p the offset is mid[p] + half[p] x, -1 <= x <= 1. The probability that the offset is there and
/// that the collision ends in slot i has the density sum_l coefficient(i, l, p) P_l(x) in x.
///
/// Slots are numbered by the tick of detection relative to the first tick in contact: slot i is tick
/// first_tick[p] + i - slots_before. The last slot holds the collisions never detected.
struct LawPieces {
    int panels = 0;  ///< a multiple of the lanes; surplus panels have no probability
    int order = 0;   ///< of the Legendre series
    int slots_before = 0;
    int slots = 0;
    std::vector<double> mid, half;  ///< [m]
    std::vector<int> first_tick;
    std::vector<double> coefficient;  ///< [slot][order][panel]

    const double* series(int slot, int p) const { return &coefficient[(std::size_t(slot) * order) * panels + p]; }
    double* series(int slot, int p) { return &coefficient[(std::size_t(slot) * order) * panels + p]; }
};

/// A quantity that falls linearly with the offset inside a panel: centre[slot][p] - spread[p] x, and nothing
/// below zero. Forces and delays are of this kind.
struct LawQuantity {
    int first_slot = 0, end_slot = 0;  ///< the slots it is defined on
    std::vector<double> centre;        ///< [slot - first_slot][panel]
    std::vector<double> spread;        ///< [panel]
    std::vector<double> least, most;   ///< by slot: of the values in it
    std::vector<double> mass;          ///< by slot
    double total = 0;                  ///< probability that the quantity exists

    double at(int slot, int p, int panels) const { return centre[std::size_t(slot - first_slot) * panels + p]; }
};

/// Fills least, most, mass and total of a quantity whose centre and spread are set.
inline void summarise(const LawPieces& pieces, LawQuantity& quantity) {
    const int count = quantity.end_slot - quantity.first_slot;
    quantity.least.assign(count, std::numeric_limits<double>::infinity());
    quantity.most.assign(count, -std::numeric_limits<double>::infinity());
    quantity.mass.assign(count, 0.0);
    quantity.total = 0;
    for (int slot = quantity.first_slot; slot < quantity.end_slot; ++slot) {
        allow_interruption();
        const int i = slot - quantity.first_slot;
        double mass = 0;
        for (int p = 0; p < pieces.panels; ++p) {
            const double here = 2 * *pieces.series(slot, p);
            if (here == 0) continue;
            mass += here;
            const double centre = quantity.at(slot, p, pieces.panels);
            quantity.least[i] = std::min(quantity.least[i], centre - quantity.spread[p]);
            quantity.most[i] = std::max(quantity.most[i], centre + quantity.spread[p]);
        }
        quantity.mass[i] = mass;
        quantity.total += mass;
    }
}

struct TailAt {
    double probability;  ///< that the quantity exceeds y
    double density;      ///< minus its derivative
};

/// P(quantity > y) for y >= 0: whole slots where y lies outside their range, cut panels where it lies inside.
template <class T>
TailAt tail(const LawPieces& pieces, const LawQuantity& quantity, double y) {
    TailAt result{0, 0};
    for (int slot = quantity.first_slot; slot < quantity.end_slot; ++slot) {
        const int i = slot - quantity.first_slot;
        if (quantity.mass[i] == 0 || y >= quantity.most[i]) continue;
        if (y < quantity.least[i]) {
            result.probability += quantity.mass[i];
            continue;
        }
        allow_interruption();
        const double* centre = &quantity.centre[std::size_t(i) * pieces.panels];
        T probability = 0.0, density = 0.0;
        for (int p = 0; p < pieces.panels; p += Scalar<T>::lanes) {
            // A panel without width (a fixed offset) has all its probability on one side.
            const T spread = maximum(load<T>(&quantity.spread[p]), T(1e-300));
            const T cut = (load<T>(centre + p) - y) / spread;
            const T x = minimum(maximum(cut, T(-1.0)), T(1.0));
            const double* c = pieces.series(slot, p);
            const SeriesAt<T> at =
                legendre_series(pieces.order, x, [&](int l) { return load<T>(c + std::size_t(l) * pieces.panels); });
            probability += at.integral;
            density += select((cut > T(-1.0)) & (cut < T(1.0)), at.value / spread, T(0.0));
        }
        for (int lane = 0; lane < Scalar<T>::lanes; ++lane) {
            result.probability += lane_of(probability, lane);
            result.density += lane_of(density, lane);
        }
    }
    // Cancellation inside the series leaves 1e-12 or so of either sign where there is nothing.
    result.probability = std::max(0.0, result.probability);
    result.density = std::max(0.0, result.density);
    return result;
}

struct Moments {
    double mean, sd;
};

/// First and second moment, about `about`, of panels in which the quantity passes zero: below it the value is
/// zero.
template <class T>
struct CutMoments {
    T first, second;
};
template <class T, class Coefficient>
CutMoments<T> cut_moments(const GaussRule& rule, int order, Coefficient coefficient, T centre, T spread, double about) {
    // Above zero is the part left of x; a panel without width lies on one side as a whole.
    const T x = minimum(maximum(centre / maximum(spread, T(1e-300)), T(-1.0)), T(1.0));
    const T below = 2.0 * coefficient(0) - legendre_series(order, x, coefficient).integral;
    CutMoments<T> sum{-about * below, about * about * below};
    const T half = 0.5 * (x + 1.0);
    for (int g = 0; g < rule.order; ++g) {
        const T z = half * (rule.node[g] + 1) - 1.0;
        const T weight = half * rule.weight[g] * legendre_series(order, z, coefficient).value;
        const T value = centre - spread * z - about;
        sum.first += weight * value;
        sum.second += weight * value * value;
    }
    return sum;
}

/// Mean and standard deviation over the probability where the quantity exists, plus `extra` probability at
/// value zero.
template <class T>
Moments moments(const LawPieces& pieces, const LawQuantity& quantity, double extra) {
    // Two passes: the second about the mean of the first, so that a narrow law far from zero keeps its
    // digits.
    double about = 0, first = 0, second = 0;
    const GaussRule& rule = gauss_rule((pieces.order + 4) / 2);  // exact for the series times a square
    const double total = quantity.total + extra;
    if (!(total > 0)) return {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::quiet_NaN()};
    for (int pass = 0; pass < 2; ++pass) {
        first = -extra * about;
        second = extra * about * about;
        for (int slot = quantity.first_slot; slot < quantity.end_slot; ++slot) {
            if (quantity.mass[slot - quantity.first_slot] == 0) continue;
            allow_interruption();
            const double* series = pieces.series(slot, 0);
            const double* centres = &quantity.centre[std::size_t(slot - quantity.first_slot) * pieces.panels];
            T sum1 = 0.0, sum2 = 0.0;
            for (int p = 0; p < pieces.panels; p += Scalar<T>::lanes) {
                const T centre = load<T>(centres + p), spread = load<T>(&quantity.spread[p]);
                const auto whole = centre >= spread;
                const T c0 = select(whole, load<T>(series + p), T(0.0));
                const T c1 = pieces.order > 1 ? select(whole, load<T>(series + pieces.panels + p), T(0.0)) : T(0.0);
                const T c2 = pieces.order > 2
                                 ? select(whole, load<T>(series + 2 * std::size_t(pieces.panels) + p), T(0.0))
                                 : T(0.0);
                const T shifted = centre - about;
                const T x1 = (2.0 / 3) * spread * c1;
                sum1 += 2.0 * shifted * c0 - x1;
                sum2 += 2.0 * shifted * (shifted * c0 - x1) + spread * spread * ((2.0 / 3) * c0 + (4.0 / 15) * c2);
                if (all(whole)) continue;
                const CutMoments<T> cut = cut_moments(
                    rule, pieces.order, [&](int l) { return load<T>(series + std::size_t(l) * pieces.panels + p); },
                    centre, spread, about);
                sum1 += select(whole, T(0.0), cut.first);
                sum2 += select(whole, T(0.0), cut.second);
            }
            for (int lane = 0; lane < Scalar<T>::lanes; ++lane) {
                first += lane_of(sum1, lane);
                second += lane_of(sum2, lane);
            }
        }
        about += first / total;
    }
    const double offset = first / total;  // the second pass's own correction of the mean
    return {about, std::sqrt(std::max(0.0, second / total - offset * offset))};
}

namespace detail {

/// A first guess at the y with P(quantity > y) = `allowed`: as if every slot's probability were spread evenly.
inline double likely_quantile(const LawQuantity& quantity, double allowed, double high) {
    double low = 0;
    for (int halving = 0; halving < 20; ++halving) {
        const double y = 0.5 * (low + high);
        double beyond = 0;
        for (std::size_t i = 0; i < quantity.mass.size(); ++i) {
            if (!(quantity.mass[i] > 0)) continue;
            const double width = quantity.most[i] - quantity.least[i];
            beyond += quantity.mass[i] *
                      (width > 0 ? std::clamp((quantity.most[i] - y) / width, 0.0, 1.0) : double(quantity.most[i] > y));
        }
        (beyond > allowed ? low : high) = y;
    }
    return 0.5 * (low + high);
}

}  // namespace detail

/// The smallest y with P(quantity > y) <= allowed, to 1e-13 of the largest value. `never` is probability that counts as
/// beyond every y. Infinite where `never` alone is too much.
template <class T>
double upper_quantile(const LawPieces& pieces, const LawQuantity& quantity, double allowed, double never) {
    if (never > allowed) return std::numeric_limits<double>::infinity();
    double high = 0, above_zero = never;
    for (std::size_t i = 0; i < quantity.most.size(); ++i) {
        high = std::max(high, quantity.most[i]);
        if (quantity.least[i] > 0) above_zero += quantity.mass[i];
    }
    double low = 0;
    if (above_zero <= allowed && tail<T>(pieces, quantity, 0.0).probability + never <= allowed) return 0;
    const double resolution = 1e-13 * high;
    double y = detail::likely_quantile(quantity, allowed - never, high);
    // Newton's step for the logarithm of the tail, which falls like that of a normal law, where the step stays inside the
    // bracket; halving where it does not.
    const double wanted = allowed - never;
    for (int iteration = 0; iteration < 200 && high - low > resolution; ++iteration) {
        const TailAt at = tail<T>(pieces, quantity, y);
        const double excess = at.probability - wanted;
        (excess > 0 ? low : high) = y;
        double next = 0.5 * (low + high);
        if (at.density > 0) {
            const double step = wanted > 0 ? at.probability * std::log1p(excess / wanted) : excess;
            const double newton = y + step / at.density;
            if (std::fabs(newton - y) <= resolution) return newton;
            if (newton > low && newton < high) next = newton;
        }
        y = next;
    }
    return y;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
