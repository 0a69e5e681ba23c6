/// @file
/// The probability that a joint alarms, from a table: for many laws at a time, which need no far tails.
#pragma once

#include <vector>

#include "bumpstop/detection/threshold.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// P(|r| > threshold) of every watched joint for forces that lie close together, as those on a panel of offsets do: all of
/// them are served by one polynomial in |r + mean|, whose coefficients no lane has to gather. Chebyshev's nodes leave an
/// error of 2 (reach / 2)^12 / 12! times the twelfth derivative of the normal distribution, which is below 1e4: 1e-11.
class AlarmTable {
  public:
    /// Residuals for which one polynomial is asked may lie so far apart [standard deviations of the noise].
    static constexpr double widest = 1.0;

    explicit AlarmTable(const ThresholdDetector& detector) {
        for (int w = 0; w < detector.watched; ++w) {
            sharp_ = sharp_ || !(detector.sd[w] > 0) || detector.threshold[w] > 1e3 * detector.sd[w];
            if (sharp_) return;
            Joint& joint = joint_[w];
            joint.mean = detector.mean[w];
            joint.per_sd = 1 / detector.sd[w];
            joint.first = piece_.size();
            // The last piece is 1: ten standard deviations above the threshold nothing is silent.
            joint.last = int(std::ceil((detector.threshold[w] / detector.sd[w] + 10) * pieces_per_sd));
            for (int i = 0; i < joint.last; ++i) {
                double value[terms];
                for (int n = 0; n < terms; ++n) {
                    const double c = (i / pieces_per_sd + reach * node(n)) * detector.sd[w];
                    value[n] = joint_alarm(detector, w, c - detector.mean[w]).alarm;
                }
                piece_.push_back(powers(value));
            }
            piece_.push_back({{1.0}});
        }
    }
    /// Without noise, or with hardly any, the probability is a step that no table holds.
    bool usable() const { return !sharp_; }

  private:
    static constexpr int terms = 12;
    static constexpr double pieces_per_sd = 8;
    /// Of a piece to either side of its centre [standard deviations].
    static constexpr double reach = 0.5 * (widest + 1 / pieces_per_sd);
    struct Piece {
        double power[terms];  ///< coefficients, lowest power first
    };

  public:
    /// A joint's probability of an alarm for forces near each other.
    class Near {
      public:
        template <class T>
        T alarm(T force) const {
            return polynomial(piece_->power, T(force * slope_ + shift_));
        }

      private:
        friend class AlarmTable;
        const Piece* piece_;
        double slope_, shift_;  ///< of the place in the piece, -1 to 1
    };

    /// Of watched joint w, whose noiseless residual (without the noise mean) is `torque_per_N` times the force, about
    /// that force.
    Near near(int w, double torque_per_N, double force) const {
        const Joint& joint = joint_[w];
        const double at = (torque_per_N * force + joint.mean) * joint.per_sd, sign = at < 0 ? -1.0 : 1.0;
        const int index = int(std::min(std::fabs(at) * pieces_per_sd + 0.5, double(joint.last)));
        Near near;
        near.piece_ = &piece_[joint.first + std::size_t(index)];
        near.slope_ = sign * torque_per_N * joint.per_sd / reach;
        near.shift_ = (sign * joint.mean * joint.per_sd - index / pieces_per_sd) / reach;
        return near;
    }

  private:
    struct Joint {
        double mean = 0, per_sd = 0;
        int last = 0;
        std::size_t first = 0;
    };

    /// Chebyshev's nodes on [-1, 1].
    static double node(int n) { return -std::cos(std::numbers::pi * (n + 0.5) / terms); }

    /// Of the polynomial that takes these values at the nodes.
    static Piece powers(double (&d)[terms]) {
        // Newton's divided differences, then powers.
        for (int order = 1; order < terms; ++order)
            for (int n = terms - 1; n >= order; --n) d[n] = (d[n] - d[n - 1]) / (node(n) - node(n - order));
        Piece c{{d[terms - 1]}};
        for (int n = terms - 2; n >= 0; --n) {
            for (int p = terms - 1; p > 0; --p) c.power[p] = c.power[p - 1] - node(n) * c.power[p];
            c.power[0] = d[n] - node(n) * c.power[0];
        }
        return c;
    }

    bool sharp_ = false;
    std::array<Joint, max_joints> joint_{};
    std::vector<Piece> piece_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
