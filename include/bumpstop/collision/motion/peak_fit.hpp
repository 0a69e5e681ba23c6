/// @file
/// The peaks of reactions, which are smooth functions of the tick, and their interpolation over the ticks.
#pragma once

#include <algorithm>
#include <limits>

#include "bumpstop/collision/motion/reaction.hpp"
#include "bumpstop/math/functions.hpp"
#include "bumpstop/math/quadrature.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace detail {

/// Distance travelled after the reaction began: the greatest at a simulation step.
inline double overtravel(const std::vector<double>& distance) {
    return *std::max_element(distance.begin(), distance.end()) - distance[0];
}

/// The travel of a reaction near its peak as a cubic in time: value + second/2 d^2 + third/6 d^3, where d is the time
/// since the peak at `time`, both in simulation steps.
template <class T>
struct PeakFitOf {
    T time, value, second, third;

    /// Adds `weight` times another fit.
    void add(const T& weight, const PeakFitOf<double>& fit) {
        time += weight * fit.time;
        value += weight * fit.value;
        second += weight * fit.second;
        third += weight * fit.third;
    }

    /// The greatest travel at a whole step: the overtravel.
    T at_steps() const {
        const T below = max(T(0.0), floor(time));
        return max(T(0.0), max(at(below - time), at(below + 1.0 - time)));
    }

  private:
    T at(const T& d) const { return value + d * d * (0.5 * second + d * third * (1.0 / 6)); }
};
using PeakFit = PeakFitOf<double>;

/// What rounding may add to the travel of an arm that stands [m].
inline constexpr double rounding_of_rest = 1e-12;

/// Fits the peak of a reaction from four consecutive steps around it; NaN where the travel has no interior maximum.
inline PeakFit peak_fit(const ReactionJob& job) {
    const std::vector<double>& distance = job.distance;
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const int n = int(distance.size());
    // Where the arm comes to rest at its peak, rounding decides whether it takes another sub-step to stand: by nothing.
    const double top = *std::max_element(distance.begin(), distance.end()) - rounding_of_rest;
    const int peak =
        int(std::find_if(distance.begin(), distance.end(), [&](double s) { return s >= top; }) - distance.begin());
    if (peak == 0 || peak + 1 >= n || n < 4) return {nan, nan, nan, nan};
    int first = -1;
    for (int before : {1, 2, 0, 3}) {
        const int begin = peak - before;
        if (begin < 0 || begin + 3 >= n || job.step[begin + 3] - job.step[begin] != 3) continue;
        first = begin;
        break;
    }
    if (first < 0) return {nan, nan, nan, nan};
    // Newton's form on the steps first .. first + 3, then powers of x = time - first.
    double y[4];
    for (int i = 0; i < 4; ++i) y[i] = distance[first + i] - distance[0];
    const double d1 = y[1] - y[0], d2 = 0.5 * (y[2] - 2.0 * y[1] + y[0]),
                 d3 = (y[3] - 3.0 * y[2] + 3.0 * y[1] - y[0]) / 6.0;
    const double c1 = d1 - d2 + 2.0 * d3, c2 = d2 - 3.0 * d3, c3 = d3;
    double x = double(peak - first);
    for (int i = 0; i < 20; ++i) {
        const double step = (c1 + x * (2.0 * c2 + 3.0 * c3 * x)) / (2.0 * c2 + 6.0 * c3 * x);
        x -= step;
        if (std::fabs(step) < 1e-14) break;
    }
    const double value = y[0] + x * (c1 + x * (c2 + x * c3)), second = 2.0 * c2 + 6.0 * c3 * x;
    return {job.step[first] + x, value, second, 6.0 * c3};
}

/// Overtravels between ticks whose reactions are simulated. The peak fits are interpolated, not the overtravels: these
/// are taken at simulation steps, which lie differently about the peak for every tick, so they are not smooth.
class OvertravelInterpolation {
  public:
    OvertravelInterpolation(std::vector<int> ticks, std::vector<PeakFit> peaks)
        : interpolation_(std::move(ticks)), peak_(std::move(peaks)) {}

    /// The overtravels of the ticks from `first` to `last`; negative where no peak lies after the beginning of the
    /// reaction.
    template <class T>
    std::vector<double> between(int first, int last) const {
        constexpr int lanes = Scalar<T>::lanes;
        std::vector<double> found(std::size_t((last - first) / lanes + 1) * lanes);
        for (std::size_t i = 0; i < found.size(); i += lanes) {
            T tick, weight[16];
            for (int lane = 0; lane < lanes; ++lane) set_lane(tick, lane, first + double(i) + lane);
            interpolation_.weights(tick, weight);
            PeakFitOf<T> sum{0.0, 0.0, 0.0, 0.0};
            for (int m = 0; m < interpolation_.size(); ++m) sum.add(weight[m], peak_[std::size_t(m)]);
            store(select(sum.time >= T(0.0), sum.at_steps(), T(-1.0)), &found[i]);
        }
        found.resize(std::size_t(last - first) + 1);
        return found;
    }

  private:
    Interpolation interpolation_;
    std::vector<PeakFit> peak_;
};

}  // namespace detail

}  // namespace bumpstop::inline BUMPSTOP_TARGET
