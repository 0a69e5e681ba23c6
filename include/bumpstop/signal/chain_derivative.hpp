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
        : window_(window), degree_(degree), columns_(columns) {}

    /// Takes a sample, which must be finite and later than the last. False until the window is full.
    bool update(double time, const double* sample) noexcept {
        newest_ = time;
        time_[slot_] = time;
        for (int j = 0; j < columns_; ++j) sample_[slot_][j] = sample[j];
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
        double scratch[7][max_window];
        for (int k = 0; k < padded; ++k) {
            scratch[0][k] = k < window_ ? time_[k] - newest_ : 0.0;
            scratch[1][k] = k < window_ ? 1.0 : 0.0;
        }
        derivative_weights<L>(
            {scratch[0], scratch[1], scratch[2], scratch[3], {scratch[4], scratch[5], scratch[6]}, padded}, degree_);
        for (int first = 0; first < columns_; first += native_lanes) {
            L rate = 0.0, acceleration = 0.0;
            const L newest = load_padded(reference, first);
            for (int k = 0; k < window_; ++k) {
                const L d = load<L>(&sample_[k][first]) - newest;
                rate += d * scratch[5][k];
                acceleration += d * scratch[6][k];
            }
            store(rate, &rate_[first]);
            store(acceleration, &acceleration_[first]);
        }
    }
    L load_padded(const double* values, int first) const noexcept {
        L x = 0.0;
        for (int lane = 0; lane < native_lanes && first + lane < columns_; ++lane)
            set_lane(x, lane, values[first + lane]);
        return x;
    }

    int window_, degree_, columns_;
    int samples_ = 0, slot_ = 0;
    double newest_ = -std::numeric_limits<double>::infinity();
    std::array<double, max_window> time_{};
    std::array<std::array<double, Columns>, max_window> sample_{};
    std::array<double, Columns> rate_{}, acceleration_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
