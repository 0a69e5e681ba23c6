/// @file
/// A course between two moments, of which values and rates are known at both.
#pragma once

#include "bumpstop/math/functions.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The polynomial on 0 to 1 that takes the values, slopes and second derivatives given at both ends.
template <class T>
class HermiteCourse {
  public:
    HermiteCourse(T value0, T slope0, T bend0, T value1, T slope1, T bend1) : c_{value0, slope0, bend0 * 0.5} {
        const T value = value1 - c_[0] - c_[1] - c_[2], slope = slope1 - c_[1] - bend0, bend = bend1 - bend0;
        c_[3] = 10.0 * value - 4.0 * slope + 0.5 * bend;
        c_[4] = -15.0 * value + 7.0 * slope - bend;
        c_[5] = 6.0 * value - 3.0 * slope + 0.5 * bend;
    }
    /// Without second derivatives: the cubic.
    HermiteCourse(T value0, T slope0, T value1, T slope1) : c_{value0, slope0} {
        const T value = value1 - value0;
        c_[2] = 3.0 * value - 2.0 * slope0 - slope1;
        c_[3] = slope0 + slope1 - 2.0 * value;
    }

    /// Where it is zero, in lanes whose ends have different signs.
    T root() const {
        const T end = value(T(1.0));
        return polish(c_[0] / (c_[0] - end), [&](T x, T& f, T& slope) {
            f = value(x);
            slope = this->slope(x);
        });
    }
    /// Its greatest value, in lanes that rise at first and fall at last.
    T summit() const {
        const T x = polish(c_[1] / (c_[1] - slope(T(1.0))), [&](T at, T& f, T& slope) {
            f = this->slope(at);
            slope = bend(at);
        });
        return value(x);
    }

  private:
    template <class Function>
    static T polish(T x, Function function) {
        for (int i = 0; i < 4; ++i) {
            T f, slope;
            function(x, f, slope);
            const T step = f / select(abs(slope) > T(1e-300), slope, T(1e300));
            x = min(max(x - step, T(0.0)), T(1.0));
        }
        return x;
    }
    T value(T x) const { return c_[0] + x * (c_[1] + x * (c_[2] + x * (c_[3] + x * (c_[4] + x * c_[5])))); }
    T slope(T x) const { return c_[1] + x * (2.0 * c_[2] + x * (3.0 * c_[3] + x * (4.0 * c_[4] + x * (5.0 * c_[5])))); }
    T bend(T x) const { return 2.0 * c_[2] + x * (6.0 * c_[3] + x * (12.0 * c_[4] + x * (20.0 * c_[5]))); }

    T c_[6] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
