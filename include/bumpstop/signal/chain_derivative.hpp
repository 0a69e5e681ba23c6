/// @file
/// Rates and accelerations of all joints of a chain as their samples come in: CausalDerivative for a control loop, with
/// one set of weights for all joints.
#pragma once

#include <array>
#include <limits>

#include "bumpstop/signal/local_polynomial.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Columns: most numbers in a sample. What the estimates are, their delay and what they do to noise is said at
/// CausalDerivative and in signal/derivatives.py. Nothing is allocated.
template <int Columns>
class ChainDerivative {
  public:
    static constexpr int max_window = 64;

    /// `window`: samples, more than `degree`, at most max_window. `degree`: 2 to max_fit_degree.
    ChainDerivative(int window, int degree, int columns) noexcept
        : window_(window), degree_(degree), columns_(columns) {
        for (int k = 0; k < window; ++k) weight_[k] = 1;
    }

    /// Takes a sample of `Columns` numbers, later than the last and finite; what lies beyond `columns` means nothing.
    /// False until the window is full.
    bool update(double time, const double* sample) noexcept {
        newest_ = time;
        time_[slot_] = time;
        for (int j = 0; j < columns_; j += native_lanes) store(load<L>(sample + j), &sample_[slot_][j]);
        slot_ = slot_ + 1 == window_ ? 0 : slot_ + 1;
        if (samples_ < window_) ++samples_;
        if (samples_ < window_) return false;
        fit(sample);
        return true;
    }

    /// Forgets all samples.
    void reset() noexcept { samples_ = slot_ = 0; }

    int samples() const noexcept { return samples_; }
    /// At the newest sample, by column; of use once update() has said so.
    const double* rate() const noexcept { return rate_.data(); }
    const double* acceleration() const noexcept { return acceleration_.data(); }

  private:
    using L = Lanes<native_lanes>;
    static_assert(Columns % native_lanes == 0);

    void fit(const double* reference) noexcept {
        const int padded = (window_ + native_lanes - 1) / native_lanes * native_lanes;
        alignas(64) double x[max_window], rate_share[max_window], acceleration_share[max_window];
        const double oldest = time_[slot_] - newest_;
        for (int k = 0; k < padded; k += native_lanes)
            store((load<L>(&time_[k]) - newest_) * load<L>(&weight_[k]), x + k);
        if (degree_ == 2) {
            parabola_weights(x, padded, oldest, rate_share, acceleration_share);
        } else {
            double scratch[3][max_window];
            derivative_weights<L>(
                {x, weight_.data(), scratch[0], scratch[1], {scratch[2], rate_share, acceleration_share}, padded},
                degree_);
        }
        for (int first = 0; first < columns_; first += native_lanes) {
            L rate = 0.0, acceleration = 0.0;
            const L newest = load<L>(reference + first);
            for (int k = 0; k < window_; ++k) {
                const L d = load<L>(&sample_[k][first]) - newest;
                rate += d * rate_share[k];
                acceleration += d * acceleration_share[k];
            }
            store(rate, &rate_[first]);
            store(acceleration, &acceleration_[first]);
        }
    }
    /// What derivative_weights does, written out for degree 2. With u = x / x_first the sums of the powers of u make up the
    /// normal equations; their inverse's last two rows, applied to (1, u, u^2), are the shares.
    void parabola_weights(const double* x, int padded, double oldest, double* rate,
                          double* acceleration) const noexcept {
        const double scale = 1 / oldest;
        L one = 0.0, two = 0.0, three = 0.0, four = 0.0;
        for (int k = 0; k < padded; k += native_lanes) {
            const L u = load<L>(x + k) * scale, square = u * u;
            one += u;
            two += square;
            three += square * u;
            four += square * square;
        }
        const double n = window_, s1 = sum_of(one), s2 = sum_of(two), s3 = sum_of(three), s4 = sum_of(four);
        const double c00 = s2 * s4 - s3 * s3, c01 = s2 * s3 - s1 * s4, c02 = s1 * s3 - s2 * s2;
        const double c11 = n * s4 - s2 * s2, c12 = s1 * s2 - n * s3, c22 = n * s2 - s1 * s1;
        const double share = scale / (n * c00 + s1 * c01 + s2 * c02), twice = 2 * scale * share;
        for (int k = 0; k < padded; k += native_lanes) {
            const L u = load<L>(x + k) * scale;
            store((u * (u * c12 + c11) + c01) * share, rate + k);
            store((u * (u * c22 + c12) + c02) * twice, acceleration + k);
        }
    }
    int window_, degree_, columns_;
    int samples_ = 0, slot_ = 0;
    double newest_ = -std::numeric_limits<double>::infinity();
    std::array<double, max_window> time_{}, weight_{};
    std::array<std::array<double, Columns>, max_window> sample_{};
    std::array<double, Columns> rate_{}, acceleration_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
