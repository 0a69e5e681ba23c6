/// @file
/// Gauss-Legendre rules, Legendre series, and barycentric interpolation.
#pragma once

#include <array>
#include <cmath>
#include <numbers>
#include <type_traits>
#include <utility>
#include <vector>

#include "bumpstop/math/lanes.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

inline constexpr int max_order = 48;

/// The Gauss-Legendre rule of `order` nodes on [-1, 1], and the Legendre polynomials P_l there, l < order.
struct GaussRule {
    int order = 0;
    std::array<double, max_order> node{}, weight{};
    std::vector<double> legendre;  ///< P_l at a node [g * order + l]

    explicit GaussRule(int n) : order(n), legendre(std::size_t(n) * n) {
        for (int i = 0; i < n; ++i) {
            double x = std::cos(std::numbers::pi * (n - i - 0.25) / (n + 0.5)), slope = 1;
            for (int iteration = 0; iteration < 100; ++iteration) {
                double p0 = 1, p1 = x;
                for (int l = 2; l <= n; ++l) {
                    const double p2 = ((2 * l - 1) * x * p1 - (l - 1) * p0) / l;
                    p0 = p1;
                    p1 = p2;
                }
                slope = n == 1 ? 1 : n * (x * p1 - p0) / (x * x - 1);
                const double step = p1 / slope;
                x -= step;
                if (std::fabs(step) < 1e-16) break;
            }
            node[i] = n == 1 ? 0 : x;
            weight[i] = 2 / ((1 - node[i] * node[i]) * slope * slope);
        }
        for (int g = 0; g < n; ++g) {
            double p0 = 1, p1 = node[g];
            for (int l = 0; l < n; ++l) {
                legendre[std::size_t(g) * n + l] = p0;
                const double p2 = ((2 * l + 3) * node[g] * p1 - (l + 1) * p0) / (l + 2);
                p0 = p1;
                p1 = p2;
            }
        }
    }

    /// Weight of a function's value at node g in the coefficient c_l of its series sum_l c_l P_l(x).
    double to_legendre(int l, int g) const { return (l + 0.5) * weight[g] * legendre[std::size_t(g) * order + l]; }
};

namespace detail {

/// As half_legendre_sums, for `count` degrees from `first` on: so few that their sums stay in registers.
template <class T, int count>
void some_half_legendre_sums(const GaussRule& rule, const double* value, int first, double* series) {
    constexpr int lanes = Scalar<T>::lanes, registers = count / lanes;
    alignas(64) static constexpr double alternating[8] = {1, -1, 1, -1, 1, -1, 1, -1};
    const T sign = load<T>(alternating);
    T sum[registers];
    for (T& one : sum) one = 0.0;
    for (int g = 0; 2 * g < rule.order; ++g) {
        const T pair = fused(sign, T(value[rule.order - 1 - g]), T(value[g]));
        for (int r = 0; r < registers; ++r)
            sum[r] = fused(pair, load<T>(&rule.legendre[g * rule.order + first + r * lanes]), sum[r]);
    }
    for (int r = 0; r < registers; ++r) store(0.5 * sum[r], series + first + r * lanes);
}

}  // namespace detail

/// Sums of value * P_l / 2 over the nodes of a rule, by degree l; the values include the weights. The order is a
/// multiple of 8. Nodes are symmetric about zero and P_l is even or odd, so half the products suffice.
template <class T>
void half_legendre_sums(const GaussRule& rule, const double* value, double* series) {
    int l = 0;
    for (; l + 16 <= rule.order; l += 16) detail::some_half_legendre_sums<T, 16>(rule, value, l, series);
    if (l < rule.order) detail::some_half_legendre_sums<T, 8>(rule, value, l, series);
}

/// The rule of n nodes, 1 <= n <= max_order; all rules are computed once.
inline const GaussRule& gauss_rule(int n) {
    static const std::vector<GaussRule> rules = [] {
        std::vector<GaussRule> made;
        for (int order = 1; order <= max_order; ++order) made.emplace_back(order);
        return made;
    }();
    return rules[std::size_t(n - 1)];
}

/// Factors of the recurrence P_l+1 = rise[l] x P_l - fall[l] P_l-1.
struct LegendreFactors {
    std::array<double, max_order + 1> rise{}, fall{};
    constexpr LegendreFactors() {
        for (int l = 0; l <= max_order; ++l) {
            rise[l] = (2.0 * l + 1) / (l + 1);
            fall[l] = double(l) / (l + 1);
        }
    }
};
inline constexpr LegendreFactors legendre_factors;

/// The Legendre series sum_l c_l P_l(x), -1 <= x <= 1; `coefficient(l)` gives c_l, l < order.
template <class T, class Coefficient>
T legendre_series(int order, T x, Coefficient coefficient) {
    T below = 1.0, here = x;  // P_l-1 and P_l as l runs
    T value = coefficient(0);
    for (int l = 1; l < order; ++l) {
        const T above = fused(legendre_factors.rise[l] * x, here, -legendre_factors.fall[l] * below);
        value = fused(T(coefficient(l)), here, value);
        below = here;
        here = above;
    }
    return value;
}

/// `count` distinct integers from `first` to `last`, denser toward both ends like the extrema of Chebyshev polynomials,
/// which avoids Runge oscillations. Fewer where the range holds fewer; a single one is the middle.
inline std::vector<int> interpolation_nodes(int first, int last, int count) {
    std::vector<int> nodes;
    const int range = last - first;
    if (count > range) {
        for (int k = first; k <= last; ++k) nodes.push_back(k);
        return nodes;
    }
    if (count == 1) return {first + range / 2};
    for (int i = 0; i < count; ++i) {
        const double place = 0.5 * range * (1 - std::cos(std::numbers::pi * i / (count - 1)));
        int k = first + int(std::lround(place));
        if (!nodes.empty() && k <= nodes.back()) k = nodes.back() + 1;
        nodes.push_back(k);
    }
    // Making them distinct may have moved the last ones beyond the end.
    int highest = last;
    for (std::size_t i = nodes.size(); i-- > 0 && nodes[i] > highest; --highest) nodes[i] = highest;
    return nodes;
}

/// The polynomial through values at integer nodes, in barycentric form.
class Interpolation {
  public:
    explicit Interpolation(std::vector<int> nodes) : node_(std::move(nodes)), barycentric_(node_.size()) {
        // Distances in units of a quarter of the range, the capacity of the interval, keep the products from
        // overflowing.
        const double unit = node_.size() > 1 ? 4.0 / (node_.back() - node_.front()) : 1.0;
        for (std::size_t m = 0; m < node_.size(); ++m) {
            double product = 1;
            for (std::size_t j = 0; j < node_.size(); ++j) {
                if (j != m) product *= unit * (node_[m] - node_[j]);
            }
            barycentric_[m] = 1 / product;
        }
    }
    const std::vector<int>& nodes() const { return node_; }
    int size() const { return int(node_.size()); }

    /// f(place) = sum_m weight[m] f(node[m]) for a place or a register of places; the weights sum to one.
    template <class T>
    void weights(std::type_identity_t<T> place, T* weight) const {
        T sum = 0.0;
        for (int m = 0; m < size(); ++m) {
            // At a node its own weight exceeds all others by more than the precision of a double.
            const T away = place - double(node_[m]);
            weight[m] = barycentric_[m] / select(abs(away) < T(1e-100), T(1e-100), away);
            sum += weight[m];
        }
        for (int m = 0; m < size(); ++m) weight[m] = weight[m] / sum;
    }

  private:
    std::vector<int> node_;
    std::vector<double> barycentric_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
