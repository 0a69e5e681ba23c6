/// @file
/// Rates and accelerations of joints in a control loop: a causal Savitzky-Golay filter for any sampling times.
///
/// A polynomial is fitted to the last samples and differentiated at the newest, with the same coefficients for all
/// joints. A lost sample makes the window longer and does not disturb the estimates. Nothing is allocated.
#pragma once

#include <algorithm>
#include <array>

#include "bumpstop/signal/local_polynomial.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Columns: greatest number of values in a sample. signal/derivatives.py gives delay and noise of the estimates.
template <int Columns>
class CausalDerivative {
  public:
    static constexpr int max_window = max_window_samples;

    /// `window`: samples, more than `degree`, at most max_window. `degree`: 2 to max_fit_degree.
    CausalDerivative(int window, int degree, int columns) noexcept
        : window_(window), degree_(degree), columns_(columns) {
        for (int k = 0; k < max_window; ++k) number_[k] = k;
        for (int k = 0; k < window; ++k) weight_[k] = 1;
    }

    /// Takes a later sample of `Columns` finite numbers; those beyond `columns` are ignored. False: not full yet.
    bool update(double time, const double* sample) noexcept {
        const int next = slot_ + 1 == window_ ? 0 : slot_ + 1;
        note_interval(time - newest_);
        newest_ = time;
        if (samples_ < window_) ++samples_;
        const bool full = samples_ == window_;
        // Before the time is stored, because a register load of a value just stored would have to wait.
        if (full) {
            if (!reusable_) compute_coefficients(next);
            // By slot; the oldest sample is in the next one.
            apply(sample, &rate_coefficient_[window_ - next], &acceleration_coefficient_[window_ - next]);
        }
        time_[slot_] = time;
        for (int j = 0; j < columns_; j += native_lanes) store(load<L>(sample + j), &sample_[slot_][j]);
        slot_ = next;
        return full;
    }

    /// Forgets all samples.
    void reset() noexcept {
        samples_ = slot_ = equal_intervals_ = 0;
        reusable_ = false;
    }

    int samples() const noexcept { return samples_; }
    /// The window is full.
    bool full() const noexcept { return samples_ == window_; }
    /// From the oldest to the newest sample of a full window [s].
    double span() const noexcept { return newest_ - time_[slot_]; }
    /// Estimates at the newest sample, by column; valid once update() has returned true.
    const double* rate() const noexcept { return rate_.data(); }
    const double* acceleration() const noexcept { return acceleration_.data(); }

  private:
    using L = Lanes<native_lanes>;
    static_assert(Columns % (2 * native_lanes) == 0);

    /// The coefficients can be reused while all intervals of the window are equal, to 1e-9 because times are rounded.
    void note_interval(double interval) noexcept {
        const bool same = samples_ > 0 && std::fabs(interval - interval_) <= 1e-9 * interval_;
        reusable_ = reusable_ && same;
        equal_intervals_ = same ? std::min(equal_intervals_ + 1, window_) : samples_ > 0;
        if (!same) interval_ = interval;
    }

    /// Coefficients of the samples in the ring and of a new one, which replaces that at slot_; the oldest is at `next`.
    void compute_coefficients(int next) noexcept {
        const int padded = (window_ + native_lanes - 1) / native_lanes * native_lanes;
        alignas(64) double x[max_window], rate[max_window], acceleration[max_window];
        for (int k = 0; k < padded; k += native_lanes) {
            const L number = load<L>(&number_[k]);
            const MaskOf<L> past = (number < L(double(window_))) & !(number == L(double(slot_)));
            store(select(past, load<L>(&time_[k]) - newest_, L(0.0)), x + k);
        }
        Scales scales;
        if (degree_ == 2) {
            scales = parabola_weights(x, padded, time_[next] - newest_, rate, acceleration);
        } else {
            double scratch[3][max_window];
            derivative_weights<L>({x, weight_.data(), scratch[0], scratch[1], {scratch[2], rate, acceleration}, padded},
                                  degree_);
        }
        // Coefficients are applied to differences from the new sample, so its own is 0: the slot still holds the one that leaves.
        rate[slot_] = acceleration[slot_] = 0;
        // Stored by age, and twice in a row, so that the ring may begin anywhere.
        for (int k = 0; k < window_; ++k) {
            const int age = k >= next ? k - next : k - next + window_;
            rate_coefficient_[age] = rate_coefficient_[age + window_] = rate[k] * scales.rate;
            acceleration_coefficient_[age] = acceleration_coefficient_[age + window_] =
                acceleration[k] * scales.acceleration;
        }
        reusable_ = equal_intervals_ >= window_ - 1;
    }

    void apply(const double* newest, const double* rate_coefficient, const double* acceleration_coefficient) noexcept {
        // Two registers of columns at a time share the loaded coefficients, and their latencies overlap.
        for (int first = 0; first < columns_; first += 2 * native_lanes) {
            const L reference0 = load<L>(newest + first), reference1 = load<L>(newest + first + native_lanes);
            L rate0 = 0.0, rate1 = 0.0, acceleration0 = 0.0, acceleration1 = 0.0;
            const double* sample = sample_[0].data() + first;
            for (int k = 0; k < window_; ++k, sample += Columns) {
                const L for_rate = rate_coefficient[k], for_acceleration = acceleration_coefficient[k];
                const L d0 = reference0 - load<L>(sample), d1 = reference1 - load<L>(sample + native_lanes);
                rate0 -= d0 * for_rate;
                rate1 -= d1 * for_rate;
                acceleration0 -= d0 * for_acceleration;
                acceleration1 -= d1 * for_acceleration;
            }
            store(rate0, &rate_[first]);
            store(rate1, &rate_[first + native_lanes]);
            store(acceleration0, &acceleration_[first]);
            store(acceleration1, &acceleration_[first + native_lanes]);
        }
    }

    /// Common factors of the coefficients.
    struct Scales {
        double rate = 1, acceleration = 1;
    };
    /// derivative_weights for degree 2 in closed form. With u = x / length the sums of powers of u form the normal
    /// equations; the last two rows of their inverse, applied to (1, u, u^2), are the coefficients. The length only
    /// conditions the sums, so that of the last window, which is known earlier, is good enough.
    Scales parabola_weights(const double* x, int padded, double oldest, double* rate, double* acceleration) noexcept {
        double scale = scale_;
        if (!(std::fabs(oldest * scale - 1) < 0.5)) scale = 1 / oldest;
        L one = 0.0, two = 0.0, three = 0.0, four = 0.0;
        for (int k = 0; k < padded; k += native_lanes) {
            const L u = load<L>(x + k) * scale, square = u * u;
            one += u;
            two += square;
            three += square * u;
            four += square * square;
        }
        const double n = window_;
        const double s1 = sum_of_lanes(one), s2 = sum_of_lanes(two), s3 = sum_of_lanes(three), s4 = sum_of_lanes(four);
        const double c00 = s2 * s4 - s3 * s3, c01 = s2 * s3 - s1 * s4, c02 = s1 * s3 - s2 * s2;
        const double c11 = n * s4 - s2 * s2, c12 = s1 * s2 - n * s3, c22 = n * s2 - s1 * s1;
        for (int k = 0; k < padded; k += native_lanes) {
            const L u = load<L>(x + k) * scale;
            store(u * (u * c12 + c11) + c01, rate + k);
            store(u * (u * c22 + c12) + c02, acceleration + k);
        }
        // The divisions come last, so that nothing waits for them.
        const double share = scale / (n * c00 + s1 * c01 + s2 * c02);
        scale_ = 1 / oldest;
        return {share, 2 * scale * share};
    }

    int window_, degree_, columns_;
    int samples_ = 0, slot_ = 0;
    int equal_intervals_ = 0;  // number of equal intervals in a row, at most window_
    bool reusable_ = false;    // the coefficients are those of the next sample, too
    double newest_ = 0, interval_ = 0;
    double scale_ = 0;  // one over the length of the last window [1/s]
    std::array<double, max_window> time_{}, weight_{}, number_{};
    std::array<double, 2 * max_window> rate_coefficient_{}, acceleration_coefficient_{};
    std::array<std::array<double, Columns>, max_window> sample_{};
    std::array<double, Columns> rate_{}, acceleration_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
