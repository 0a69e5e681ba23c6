/// @file
/// A course between two moments, of which values and rates are known at both.
#pragma once

#include <algorithm>
#include <cmath>

#include "bumpstop/math/mask.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The polynomial on 0 to 1 that takes the values, slopes and second derivatives given at both ends.
class HermiteCourse {
  public:
    HermiteCourse(double value0, double slope0, double bend0, double value1, double slope1, double bend1)
        : c_{value0, slope0, bend0 * 0.5} {
        const double value = value1 - c_[0] - c_[1] - c_[2], slope = slope1 - c_[1] - bend0, bend = bend1 - bend0;
        c_[3] = 10 * value - 4 * slope + 0.5 * bend;
        c_[4] = -15 * value + 7 * slope - bend;
        c_[5] = 6 * value - 3 * slope + 0.5 * bend;
    }
    /// Without second derivatives: the cubic.
    HermiteCourse(double value0, double slope0, double value1, double slope1) : c_{value0, slope0} {
        const double value = value1 - value0;
        c_[2] = 3 * value - 2 * slope0 - slope1;
        c_[3] = slope0 + slope1 - 2 * value;
    }

    /// Where it is zero, if its ends have different signs.
    double root() const {
        return polish(c_[0] / (c_[0] - value(1)), [&](double x) { return value(x) / away(slope(x)); });
    }
    /// Its greatest value, if it rises at first and falls at last.
    double summit() const {
        return value(polish(c_[1] / (c_[1] - slope(1)), [&](double x) { return slope(x) / away(bend(x)); }));
    }

  private:
    /// By Newton's method, whose step `correction` tells.
    template <class Correction>
    static double polish(double x, Correction correction) {
        for (int i = 0; i < 4; ++i) x = std::clamp(x - correction(x), 0.0, 1.0);
        return x;
    }
    static double away(double slope) { return std::fabs(slope) > 1e-300 ? slope : 1e300; }
    double value(double x) const { return c_[0] + x * (c_[1] + x * (c_[2] + x * (c_[3] + x * (c_[4] + x * c_[5])))); }
    double slope(double x) const {
        return c_[1] + x * (2 * c_[2] + x * (3 * c_[3] + x * (4 * c_[4] + x * (5 * c_[5]))));
    }
    double bend(double x) const { return 2 * c_[2] + x * (6 * c_[3] + x * (12 * c_[4] + x * (20 * c_[5]))); }

    double c_[6] = {};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
