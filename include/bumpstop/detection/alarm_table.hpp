/// @file
/// The probability that a joint alarms, from a table: for many laws at a time, which need no far tails.
#pragma once

#include <vector>

#include "bumpstop/detection/threshold.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Values of cubics that lie in a row in memory, four coefficients each, lowest power first; lane i takes cubic index[i]
/// at x.
template <class T>
T cubic_of_lane(const double* cubics, IntOf<T> index, T x) {
    if constexpr (Scalar<T>::lanes == 1) {
        const double* c = cubics + 4 * index;
        return c[0] + x * (c[1] + x * (c[2] + x * c[3]));
    } else if constexpr (Scalar<T>::lanes % 4 == 0) {
        // A cubic is a register of four; four of them, transposed, are the coefficients of four lanes.
        using Four = typename Register<4>::Real;
        Four power[Scalar<T>::lanes / 4][4];
        for (int i = 0; i < Scalar<T>::lanes / 4; ++i) {
            Four row[4];
            for (int lane = 0; lane < 4; ++lane)
                std::memcpy(&row[lane], cubics + 4 * index.v[4 * i + lane], sizeof row[lane]);
            const Four even01 = __builtin_shufflevector(row[0], row[1], 0, 4, 2, 6);
            const Four odd01 = __builtin_shufflevector(row[0], row[1], 1, 5, 3, 7);
            const Four even23 = __builtin_shufflevector(row[2], row[3], 0, 4, 2, 6);
            const Four odd23 = __builtin_shufflevector(row[2], row[3], 1, 5, 3, 7);
            power[i][0] = __builtin_shufflevector(even01, even23, 0, 1, 4, 5);
            power[i][1] = __builtin_shufflevector(odd01, odd23, 0, 1, 4, 5);
            power[i][2] = __builtin_shufflevector(even01, even23, 2, 3, 6, 7);
            power[i][3] = __builtin_shufflevector(odd01, odd23, 2, 3, 6, 7);
        }
        T c[4];
        for (int p = 0; p < 4; ++p) {
            if constexpr (Scalar<T>::lanes == 4) {
                c[p] = T::of(power[0][p]);
            } else {
                c[p] = T::of(__builtin_shufflevector(power[0][p], power[1][p], 0, 1, 2, 3, 4, 5, 6, 7));
            }
        }
        return c[0] + x * (c[1] + x * (c[2] + x * c[3]));
    } else {
        T c[4] = {T(0.0), T(0.0), T(0.0), T(0.0)};
        for (int lane = 0; lane < Scalar<T>::lanes; ++lane) {
            const double* row = cubics + 4 * index.v[lane];
            for (int p = 0; p < 4; ++p) set_lane(c[p], lane, row[p]);
        }
        return c[0] + x * (c[1] + x * (c[2] + x * c[3]));
    }
}

/// P(|r| > threshold) of every watched joint as cubics in |r + mean|, 1/64 of a standard deviation long each. Chebyshev's
/// nodes leave an error of 1.4 / 3072 / 64^4 = 3e-11, as no fourth derivative of the normal distribution is above 1.4.
class AlarmTable {
  public:
    explicit AlarmTable(const ThresholdDetector& detector) {
        for (int w = 0; w < detector.watched; ++w) {
            sharp_ = sharp_ || !(detector.sd[w] > 0) || detector.threshold[w] > 1e3 * detector.sd[w];
            if (sharp_) return;
            Joint& joint = joint_[w];
            joint.mean = detector.mean[w];
            joint.per_sd = pieces_per_sd / detector.sd[w];
            joint.first = cubic_.size();
            // The last piece is 1: ten standard deviations above the threshold nothing is silent.
            const int last = int(std::ceil((detector.threshold[w] / detector.sd[w] + 10) * pieces_per_sd));
            joint.last = last;
            for (int i = 0; i < last; ++i) {
                double value[4];
                for (int n = 0; n < 4; ++n) {
                    const double c = (i + node(n)) / joint.per_sd;
                    value[n] = joint_alarm(detector, w, c - detector.mean[w]).alarm;
                }
                append(value);
            }
            for (double c : {1.0, 0.0, 0.0, 0.0}) cubic_.push_back(c);
        }
    }
    /// Without noise, or with hardly any, the probability is a step that no table holds.
    bool usable() const { return !sharp_; }

    /// Of watched joint w for the noiseless residual r (without the noise mean).
    template <class T>
    T alarm(int w, T r) const {
        const Joint& joint = joint_[w];
        const T place = minimum(absolute(r + joint.mean) * joint.per_sd, T(joint.last));
        const T shifted = place + rounding_shift;
        const IntOf<T> index = bits_of(shifted) & IntOf<T>(0x7FFFFFFF);
        return cubic_of_lane<T>(&cubic_[joint.first], index, place - (shifted - rounding_shift));
    }

  private:
    static constexpr double pieces_per_sd = 64;
    struct Joint {
        double mean = 0, per_sd = 0, last = 0;
        std::size_t first = 0;
    };

    /// Chebyshev's nodes on [-1/2, 1/2]: piece i is centred on i.
    static double node(int n) { return -0.5 * std::cos(std::numbers::pi * (n + 0.5) / 4); }

    void append(const double (&value)[4]) {
        // Newton's divided differences, then powers.
        double x[4], d[4];
        for (int n = 0; n < 4; ++n) {
            x[n] = node(n);
            d[n] = value[n];
        }
        for (int order = 1; order < 4; ++order)
            for (int n = 3; n >= order; --n) d[n] = (d[n] - d[n - 1]) / (x[n] - x[n - order]);
        double c[4] = {d[3], 0, 0, 0};
        for (int n = 2; n >= 0; --n) {
            for (int p = 3; p > 0; --p) c[p] = c[p - 1] - x[n] * c[p];
            c[0] = d[n] - x[n] * c[0];
        }
        for (double power : c) cubic_.push_back(power);
    }

    bool sharp_ = false;
    std::array<Joint, max_joints> joint_{};
    std::vector<double> cubic_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
