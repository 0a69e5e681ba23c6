/// @file
/// Alarm probabilities of joints from a table, for batches of distributions, which need no far tails.
#pragma once

#include <vector>

#include "bumpstop/detection/gaussian_thresholds.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// P(|r| > threshold) of every monitored joint for forces that lie close together, as those on a panel of offsets do.
/// One polynomial in |r + mean| serves all of them, so no lane gathers coefficients of its own. Interpolation at
/// Chebyshev nodes has an error of 2 (reach / 2)^11 / 11! times the eleventh derivative of the normal distribution,
/// which is below 380: 5e-9. The relative error of probabilities above 1e-6 is below 1e-4.
class AlarmTable {
  public:
    /// Largest range of the residuals that one polynomial serves [standard deviations of the noise].
    static constexpr double widest = 1.75;

    explicit AlarmTable(const GaussianThresholds& detector) {
        for (int w = 0; w < detector.monitored; ++w) {
            is_step_ = is_step_ || !(detector.sd[w] > 0) || detector.threshold[w] > 1e3 * detector.sd[w];
            if (is_step_) return;
            per_sd_[w] = 1 / detector.sd[w];
            mean_[w] = detector.mean[w] * per_sd_[w];
            first_[w] = piece_.size();
            // The last piece is 1: ten standard deviations above the threshold the alarm is certain.
            const int last = int(std::ceil((detector.threshold[w] / detector.sd[w] + 10) * pieces_per_sd));
            last_[w] = last;
            for (int i = 0; i < last; ++i) {
                piece_.push_back(powers(detector, w, i / pieces_per_sd));
            }
            piece_.push_back({{1.0}});
        }
    }
    /// False where there is no noise, or hardly any: then the probability is a step.
    bool usable() const { return !is_step_; }

  private:
    /// Odd, so that the centre is a node: joints that the force does not load stay there, and their alarms are rare.
    static constexpr int terms = 11;
    static constexpr double pieces_per_sd = 8;
    /// Half-width of a piece [standard deviations].
    static constexpr double reach = 0.5 * (widest + 1 / pieces_per_sd);
    struct Piece {
        double power[terms];  ///< coefficients, lowest power first
    };

  public:
    /// The joints' probabilities of an alarm for forces near each other.
    class Near {
      public:
        /// Alarm probability of monitored joint w.
        template <class T>
        T alarm(int w, T force) const {
            const Piece& piece = table_.piece_[table_.first_[w] + std::size_t(index_[w])];
            return polynomial<Rounding::fused>(piece.power, fused(force, T(slope_[w]), T(shift_[w])));
        }

      private:
        friend class AlarmTable;
        explicit Near(const AlarmTable& table) : table_(table) {}

        const AlarmTable& table_;
        /// The place in a joint's piece, from -1 to 1, is force * slope + shift. Arrays are aligned so that a register
        /// stored here lies in one cache line, which makes reading its elements fast.
        alignas(64) double index_[max_joints];
        alignas(64) double slope_[max_joints];
        alignas(64) double shift_[max_joints];
    };

    /// Polynomials for forces near `force`. `torque_per_N`: noiseless residual (without the noise mean) per newton, by
    /// monitored joint; padded to a whole number of registers.
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
    /// Chebyshev nodes on [-1, 1].
    static double node(int n) { return -std::cos(std::numbers::pi * (n + 0.5) / terms); }

    /// The polynomial that interpolates the alarm probability at the nodes about `centre` [standard deviations].
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

    bool is_step_ = false;
    double mean_[max_joints] = {}, per_sd_[max_joints] = {};  ///< by monitored joint
    double last_[max_joints] = {};                            ///< index of a joint's last piece among its own
    std::size_t first_[max_joints] = {};                      ///< index of a joint's first piece in `piece_`
    std::vector<Piece> piece_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
