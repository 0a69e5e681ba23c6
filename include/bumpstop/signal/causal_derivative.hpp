/// @file
/// Rate and acceleration of a position as its samples come in, at the times they really have: for the control loop.
///
/// A polynomial is fitted to the last samples and differentiated at the newest. A lost sample makes the window longer, not
/// the acceleration larger. Nothing is allocated.
#pragma once

#include <array>
#include <limits>

#include "bumpstop/signal/local_polynomial.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

template <class T>
struct CausalEstimate {
    T rate = 0.0;          ///< rad/s or m/s, at the newest sample
    T acceleration = 0.0;  ///< rad/s2 or m/s2
    bool known = false;    ///< the window is full; until then both are zero
};

/// T is a double, or lanes: positions sampled at the same times.
template <class T>
class CausalDerivative {
  public:
    static constexpr int max_window = 64;

    /// `window`: samples, more than `degree`, at most max_window. `degree`: of the polynomial, 2 to max_fit_degree.
    CausalDerivative(int window, int degree) noexcept : window_(window), degree_(degree) {}

    /// Takes a sample: time [s] and position [rad or m]. One that is not later than the last, or not finite, tells
    /// nothing: it is dropped, as if lost, and the last estimate given again.
    CausalEstimate<T> update(double time, T position) noexcept {
        constexpr double largest = std::numeric_limits<double>::max();
        if (!(time > newest_ && time <= largest && all(abs(position) <= T(largest)))) return estimate_;
        newest_ = time;
        time_[slot_] = time;
        position_[slot_] = position;
        slot_ = (slot_ + 1) % window_;
        if (samples_ < window_) ++samples_;
        if (samples_ == window_) estimate_ = fitted(position);
        return estimate_;
    }

    /// Forgets all samples, as after a pause in which the arm may have done anything.
    void reset() noexcept {
        samples_ = slot_ = 0;
        newest_ = -std::numeric_limits<double>::infinity();
        estimate_ = {};
    }

    /// Samples in the window.
    int samples() const noexcept { return samples_; }

  private:
    CausalEstimate<T> fitted(T reference) const noexcept {
        using L = Lanes<native_lanes>;
        const int padded = (window_ + native_lanes - 1) / native_lanes * native_lanes;
        double scratch[7][max_window];
        for (int k = 0; k < padded; ++k) {
            scratch[0][k] = k < window_ ? time_[k] - newest_ : 0.0;
            scratch[1][k] = k < window_ ? 1.0 : 0.0;
        }
        derivative_weights<L>(
            {scratch[0], scratch[1], scratch[2], scratch[3], {scratch[4], scratch[5], scratch[6]}, padded}, degree_);
        CausalEstimate<T> result;
        for (int k = 0; k < window_; ++k) {
            const T d = position_[k] - reference;
            result.rate += d * scratch[5][k];
            result.acceleration += d * scratch[6][k];
        }
        result.known = true;
        return result;
    }

    int window_, degree_;
    int samples_ = 0, slot_ = 0;
    double newest_ = -std::numeric_limits<double>::infinity();
    /// A ring: the fit does not ask for the order of its samples.
    std::array<double, max_window> time_{};
    std::array<T, max_window> position_{};
    CausalEstimate<T> estimate_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
