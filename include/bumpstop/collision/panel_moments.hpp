/// @file
/// The first two moments of the peak force, over panels of offsets.
#pragma once

#include "bumpstop/math/quadrature.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Of a body of `stiffness` [N/m] that is pressed from its offset to the farthest point of a stopping path. The moments are
/// those about a force near the mean, so that a narrow law far from zero keeps its digits. `node` and `weight`: Gauss's
/// rule of `order` on [-1, 1]. A series is as of BatchDetection::find_series.
template <class T, int order>
class PanelMoments {
  public:
    PanelMoments(double stiffness, double about, const double* node, const double* weight)
        : stiffness_(stiffness), about_(about), node_(node), weight_(weight) {}

    /// The panel that comes next [m].
    void begin(double low, double high) {
        low_ = low;
        high_ = high;
        sum_[0] = sum_[1] = sum_[2] = middle_sum_[0] = middle_sum_[1] = square_sum_ = 0;
    }
    /// `factor` times the series of what is stopped at `farthest` [m].
    void add(const double* series, double factor, double farthest) {
        if (farthest >= high_) {
            const double middle = stiffness_ * (farthest - 0.5 * (low_ + high_)) - about_, zeroth = factor * series[0],
                         first = factor * series[1];
            sum_[0] += zeroth;
            sum_[1] += first;
            sum_[2] += factor * series[2];
            middle_sum_[0] += middle * zeroth;
            middle_sum_[1] += middle * first;
            square_sum_ += middle * middle * zeroth;
        } else if (farthest > low_) {
            add_reached(series, factor, farthest);
        } else {
            add_nothing(2 * factor * series[0]);
        }
    }
    /// The panel is over.
    void end() {
        // Moments of the offset about the middle; x^2 is (2 P_2 + 1) / 3.
        const double slope = stiffness_ * 0.5 * (high_ - low_);
        first_ += 2 * (middle_sum_[0] - slope * sum_[1]);
        second_ +=
            2 * (square_sum_ - 2 * slope * middle_sum_[1]) + (4 * sum_[2] + 2 * sum_[0]) * (1.0 / 3) * slope * slope;
    }
    /// What feels no force at all.
    void add_nothing(double probability) {
        first_ -= probability * about_;
        second_ += probability * about_ * about_;
    }

    double first() const { return first_; }    ///< N
    double second() const { return second_; }  ///< N^2

  private:
    /// A stopping path that ends in the panel: what lies beyond feels no force, and the rule is that of the nearer part, where
    /// the force is straight.
    void add_reached(const double* series, double factor, double farthest) {
        const double share = (farthest - low_) / (high_ - low_);
        T probability = 0.0, first = 0.0, second = 0.0;
        for (int g = 0; g < order; g += Scalar<T>::lanes) {
            const T part = 0.5 * (load<T>(node_ + g) + 1.0);  // of the way from `low` to `farthest`
            const T here = (share * factor) * load<T>(weight_ + g) *
                           legendre_series(order, T(2.0 * share * part - 1.0), [&](int l) {
                               return T((2 * l + 1) * series[l]);
                           }).value;
            const T force = stiffness_ * (farthest - low_) * (1.0 - part) - about_;
            probability += here;
            first += here * force;
            second += here * force * force;
        }
        first_ += sum_of_lanes(first);
        second_ += sum_of_lanes(second);
        add_nothing(2 * factor * series[0] - sum_of_lanes(probability));
    }

    const double stiffness_, about_, *const node_, *const weight_;
    double low_ = 0, high_ = 0;
    /// Over what passes the panel wholly: the first terms of the series, and those with powers of the force in its middle.
    double sum_[3] = {}, middle_sum_[2] = {}, square_sum_ = 0;
    double first_ = 0, second_ = 0;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
