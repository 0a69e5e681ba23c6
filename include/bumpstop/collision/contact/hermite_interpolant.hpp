/// @file
/// Hermite interpolation between two times, for roots and maxima.
#pragma once

#include <algorithm>
#include <cmath>

#include "bumpstop/math/mask.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The polynomial on 0 to 1 that takes the values, slopes and second derivatives given at both ends.
class HermiteInterpolant {
  public:
    HermiteInterpolant(double value0, double slope0, double second0, double value1, double slope1, double second1)
        : c_{value0, slope0, second0 * 0.5} {
        const double value = value1 - c_[0] - c_[1] - c_[2], slope = slope1 - c_[1] - second0,
                     second = second1 - second0;
        c_[3] = 10 * value - 4 * slope + 0.5 * second;
        c_[4] = -15 * value + 7 * slope - second;
        c_[5] = 6 * value - 3 * slope + 0.5 * second;
    }
    /// Without second derivatives: the cubic.
    HermiteInterpolant(double value0, double slope0, double value1, double slope1) : c_{value0, slope0} {
        const double value = value1 - value0;
        c_[2] = 3 * value - 2 * slope0 - slope1;
        c_[3] = slope0 + slope1 - 2 * value;
    }

    double at(double x) const { return c_[0] + x * (c_[1] + x * (c_[2] + x * (c_[3] + x * (c_[4] + x * c_[5])))); }
    /// Where it is zero, if the values at its ends differ in sign.
    double root() const {
        return newton(c_[0] / (c_[0] - at(1)), [&](double x) { return at(x) / nonzero(slope(x)); });
    }
    /// Its maximum, if it rises at the first end and falls at the last.
    double maximum() const {
        return at(newton(c_[1] / (c_[1] - slope(1)), [&](double x) { return slope(x) / nonzero(second(x)); }));
    }

  private:
    /// Newton's method from x on; `step(x)` is the quotient that it subtracts.
    template <class Step>
    static double newton(double x, Step step) {
        for (int i = 0; i < 4; ++i) x = std::clamp(x - step(x), 0.0, 1.0);
        return x;
    }
    static double nonzero(double slope) { return std::fabs(slope) > 1e-300 ? slope : 1e300; }
    double slope(double x) const {
        return c_[1] + x * (2 * c_[2] + x * (3 * c_[3] + x * (4 * c_[4] + x * (5 * c_[5]))));
    }
    double second(double x) const { return 2 * c_[2] + x * (6 * c_[3] + x * (12 * c_[4] + x * (20 * c_[5]))); }

    double c_[6] = {};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
