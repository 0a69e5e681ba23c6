/// @file
/// Rates and accelerations of all joints of a chain as their samples come in, at the times they really have: for the control
/// loop.
///
/// A polynomial is fitted to the last samples and differentiated at the newest, with one set of weights for all joints. A
/// lost sample makes the window longer, not the acceleration larger. Nothing is allocated.
#pragma once

#include <algorithm>
#include <array>

#include "bumpstop/signal/local_polynomial.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Columns: most numbers in a sample. Delay and noise of the estimates are said in signal/derivatives.py.
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

    /// Takes a sample of `Columns` numbers, later than the last and finite; what lies beyond `columns` means nothing.
    /// False until the window is full.
    bool update(double time, const double* sample) noexcept {
        const int next = slot_ + 1 == window_ ? 0 : slot_ + 1;
        note_interval(time - newest_);
        newest_ = time;
        if (samples_ < window_) ++samples_;
        const bool full = samples_ == window_;
        // Before the time is noted: a register that holds a number just written would have to wait for it.
        if (full) {
            if (!kept_) weigh(next);
            // By slot; the oldest sample is in the next one.
            apply(sample, &rate_share_[window_ - next], &acceleration_share_[window_ - next]);
        }
        time_[slot_] = time;
        for (int j = 0; j < columns_; j += native_lanes) store(load<L>(sample + j), &sample_[slot_][j]);
        slot_ = next;
        return full;
    }

    /// Forgets all samples.
    void reset() noexcept {
        samples_ = slot_ = even_ = 0;
        kept_ = false;
    }

    int samples() const noexcept { return samples_; }
    /// The window is full.
    bool full() const noexcept { return samples_ == window_; }
    /// From the oldest to the newest sample of a full window [s].
    double span() const noexcept { return newest_ - time_[slot_]; }
    /// At the newest sample, by column; of use once update() has said so.
    const double* rate() const noexcept { return rate_.data(); }
    const double* acceleration() const noexcept { return acceleration_.data(); }

  private:
    using L = Lanes<native_lanes>;
    static_assert(Columns % (2 * native_lanes) == 0);

    /// Shares are kept while every interval of the window is, but for the rounding of times, as it was: to 1e-9 of it.
    void note_interval(double interval) noexcept {
        const bool same = samples_ > 0 && std::fabs(interval - interval_) <= 1e-9 * interval_;
        kept_ = kept_ && same;
        even_ = same ? std::min(even_ + 1, window_) : samples_ > 0;
        if (!same) interval_ = interval;
    }

    /// Shares of the samples in the ring and a new one, which takes the place of that at slot_; `next` has the oldest.
    void weigh(int next) noexcept {
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
        // The new sample is the one that the others are told from: its own share is of zero.
        rate[slot_] = acceleration[slot_] = 0;
        // By age, and twice over, so that the ring may begin anywhere.
        for (int k = 0; k < window_; ++k) {
            const int age = k >= next ? k - next : k - next + window_;
            rate_share_[age] = rate_share_[age + window_] = rate[k] * scales.rate;
            acceleration_share_[age] = acceleration_share_[age + window_] = acceleration[k] * scales.acceleration;
        }
        kept_ = even_ >= window_ - 1;
    }

    void apply(const double* newest, const double* rate_share, const double* acceleration_share) noexcept {
        // Two registers of columns at a time, as they share what is loaded and their latencies overlap.
        for (int first = 0; first < columns_; first += 2 * native_lanes) {
            const L reference0 = load<L>(newest + first), reference1 = load<L>(newest + first + native_lanes);
            L rate0 = 0.0, rate1 = 0.0, acceleration0 = 0.0, acceleration1 = 0.0;
            const double* sample = sample_[0].data() + first;
            for (int k = 0; k < window_; ++k, sample += Columns) {
                const L for_rate = rate_share[k], for_acceleration = acceleration_share[k];
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

    /// What the shares still have to be multiplied by.
    struct Scales {
        double rate = 1, acceleration = 1;
    };
    /// What derivative_weights does, written out for degree 2. With u = x / length the sums of the powers of u make up the
    /// normal equations; their inverse's last two rows, applied to (1, u, u^2), are the shares. Any length near the
    /// window's will do: that of the sample before is known already.
    Scales parabola_weights(const double* x, int padded, double oldest, double* rate, double* acceleration) noexcept {
        double scale = scale_;
        // Twice as long or short would still do.
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
        // Divisions take long, and nothing before the very end waits for these.
        const double share = scale / (n * c00 + s1 * c01 + s2 * c02);
        scale_ = 1 / oldest;
        return {share, 2 * scale * share};
    }

    int window_, degree_, columns_;
    int samples_ = 0, slot_ = 0;
    int even_ = 0;       // intervals in a row that are alike, at most window_
    bool kept_ = false;  // the shares are those of the sample to come, too
    double newest_ = 0, interval_ = 0;
    double scale_ = 0;  // one over the length of the window before [1/s]
    std::array<double, max_window> time_{}, weight_{}, number_{};
    std::array<double, 2 * max_window> rate_share_{}, acceleration_share_{};
    std::array<std::array<double, Columns>, max_window> sample_{};
    std::array<double, Columns> rate_{}, acceleration_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
