/// @file
/// Legendre series from values at Gauss nodes.
#pragma once

#include "bumpstop/math/quadrature.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The Legendre series of functions that are known at the nodes of a Gauss rule.
template <class T>
class LegendreSeries {
  public:
    /// For rules of `order` nodes: a multiple of 8, at most `max_order`.
    void prepare(int order) {
        if (order_ == order) return;
        order_ = order;
        const GaussRule& rule = gauss_rule(order);
        half_legendre_.resize(std::size_t(order * order / 2));
        for (int g = 0; 2 * g < order; ++g)
            for (int l = 0; l < order; ++l)
                half_legendre_[std::size_t(g * order + l)] =
                    rule.to_legendre[std::size_t(l * order + g)] / ((2 * l + 1) * rule.weight[std::size_t(g)]);
    }

    /// From values at the nodes, weights included: the sums of their products with P_l / 2, by degree. Nodes lie in pairs
    /// about zero, where Legendre polynomials are even or odd: half the products do.
    void find(const double* value, double* series) const {
        const int order = order_;
        const double* half_legendre = half_legendre_.data();
        T sum[max_order / lanes];
        for (int r = 0; r * lanes < order; ++r) sum[r] = 0.0;
        const T sign = load<T>(alternating);
        for (int g = 0; 2 * g < order; ++g, half_legendre += order) {
            const T pair = value[g] + sign * value[order - 1 - g];
            for (int r = 0; r * lanes < order; ++r) sum[r] += pair * load<T>(half_legendre + r * lanes);
        }
        for (int r = 0; r * lanes < order; ++r) store(sum[r], series + r * lanes);
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;
    alignas(64) static constexpr double alternating[8] = {1, -1, 1, -1, 1, -1, 1, -1};

    int order_ = 0;
    std::vector<double> half_legendre_;  ///< [node of the lower half][degree]: P_l / 2
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
