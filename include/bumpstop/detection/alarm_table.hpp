/// @file
/// The probability that a joint alarms, from a table: for many distributions at a time, which need no far tails.
#pragma once

#include <vector>

#include "bumpstop/detection/gaussian_thresholds.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// P(|r| > threshold) of every monitored joint for forces that lie close together, as those on a panel of offsets do: all of
/// them are served by one polynomial in |r + mean|, whose coefficients no lane has to gather. Chebyshev's nodes leave an
/// error of 2 (reach / 2)^11 / 11! times the eleventh derivative of the normal distribution, which is below 380: 5e-9. Of
/// probabilities above 1e-6 it is less than 1e-4 of themselves.
class AlarmTable {
  public:
    /// Residuals for which one polynomial is asked may lie so far apart [standard deviations of the noise].
    static constexpr double widest = 1.75;

    explicit AlarmTable(const GaussianThresholds& detector) {
        for (int w = 0; w < detector.monitored; ++w) {
            sharp_ = sharp_ || !(detector.sd[w] > 0) || detector.threshold[w] > 1e3 * detector.sd[w];
            if (sharp_) return;
            per_sd_[w] = 1 / detector.sd[w];
            mean_[w] = detector.mean[w] * per_sd_[w];
            first_[w] = piece_.size();
            // The last piece is 1: ten standard deviations above the threshold an alarm is certain.
            const int last = int(std::ceil((detector.threshold[w] / detector.sd[w] + 10) * pieces_per_sd));
            last_[w] = last;
            for (int i = 0; i < last; ++i) {
                piece_.push_back(powers(detector, w, i / pieces_per_sd));
            }
            piece_.push_back({{1.0}});
        }
    }
    /// Without noise, or with hardly any, the probability is a step that no table holds.
    bool usable() const { return !sharp_; }

  private:
    /// Odd: one of the nodes is the centre, where a joint stays that no force moves, and whose alarms are rare.
    static constexpr int terms = 11;
    static constexpr double pieces_per_sd = 8;
    /// Of a piece to either side of its centre [standard deviations].
    static constexpr double reach = 0.5 * (widest + 1 / pieces_per_sd);
    struct Piece {
        double power[terms];  ///< coefficients, lowest power first
    };

  public:
    /// The joints' probabilities of an alarm for forces near each other.
    class Near {
      public:
        /// Of monitored joint w.
        template <class T>
        T alarm(int w, T force) const {
            const Piece& piece = table_.piece_[table_.first_[w] + std::size_t(index_[w])];
            return polynomial(piece.power, T(force * slope_[w] + shift_[w]));
        }

      private:
        friend class AlarmTable;
        explicit Near(const AlarmTable& table) : table_(table) {}

        const AlarmTable& table_;
        /// Of the place in the piece, -1 to 1; each a cache line's, so that what is stored as a whole is read one by one at once.
        alignas(64) double index_[max_joints];
        alignas(64) double slope_[max_joints];
        alignas(64) double shift_[max_joints];
    };

    /// `torque_per_N`: by monitored joint, its noiseless residual (without the noise mean) divided by the force; readable up to
    /// a whole number of registers. About that force.
    template <class T>
    Near near(int monitored, const double* torque_per_N, double force) const {
        Near near(*this);
        for (int w = 0; w < monitored; w += Scalar<T>::lanes) {
            const T torque = load<T>(torque_per_N + w) * load<T>(per_sd_ + w), mean = load<T>(mean_ + w);
            const T at = torque * force + mean, sign = select(at < T(0.0), T(-1.0), T(1.0));
            const T index = min(floor(abs(at) * pieces_per_sd + 0.5), load<T>(last_ + w));
            store(index, near.index_ + w);
            store(sign * torque * (1 / reach), near.slope_ + w);
            store((sign * mean - index * (1 / pieces_per_sd)) * (1 / reach), near.shift_ + w);
        }
        return near;
    }

  private:
    /// Chebyshev's nodes on [-1, 1].
    static double node(int n) { return -std::cos(std::numbers::pi * (n + 0.5) / terms); }

    /// Of the polynomial that takes the alarms' values at the nodes about `centre` [standard deviations].
    static Piece powers(const GaussianThresholds& detector, int w, double centre) {
        double d[terms];
        for (int n = 0; n < terms; ++n) {
            const double place = centre + reach * node(n);
            d[n] = joint_alarm(detector, w, place * detector.sd[w] - detector.mean[w]).alarm;
        }
        // Newton's divided differences, then powers.
        for (int order = 1; order < terms; ++order)
            for (int n = terms - 1; n >= order; --n) d[n] = (d[n] - d[n - 1]) / (node(n) - node(n - order));
        double c[terms] = {d[terms - 1]};
        for (int n = terms - 2; n >= 0; --n) {
            for (int p = terms - 1; p > 0; --p) c[p] = c[p - 1] - node(n) * c[p];
            c[0] = d[n] - node(n) * c[0];
        }
        Piece piece;
        for (int p = 0; p < terms; ++p) piece.power[p] = c[p];
        return piece;
    }

    bool sharp_ = false;
    double mean_[max_joints] = {}, per_sd_[max_joints] = {};  ///< by monitored joint
    double last_[max_joints] = {};                            ///< a joint's last piece
    std::size_t first_[max_joints] = {};                      ///< a joint's first piece in `piece_`
    std::vector<Piece> piece_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
