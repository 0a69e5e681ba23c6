/// @file
/// Discrete-time filters of the detector: the momentum observer and the band-pass channel.
///
/// Sampling intervals may vary. Nothing is allocated.
#pragma once

#include <array>
#include <cmath>

#include "bumpstop/model/momentum.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// exp(-rate dt), computed anew only where dt changes by more than the rounding of times.
class Decay {
  public:
    explicit Decay(double rate = 0) noexcept : rate_(rate) {}
    double over(double dt) noexcept {
        if (!(std::fabs(dt - dt_) <= 1e-9 * dt_)) {
            dt_ = dt;
            value_ = std::exp(-rate_ * dt);
        }
        return value_;
    }

  private:
    double rate_, dt_ = 0, value_ = 1;
};

/// Estimates tau_ext from the generalised momentum, without acceleration (De Luca and Mattone 2003):
///
///   y(k) = (p(k) - p(k-1)) / dt - (b(k) + b(k-1)) / 2,    b = tau + dT/dq - g
///   e(k) = e(k-1) + (1 - exp(-K dt)) (y(k) - e(k-1))
///
/// y is the mean of tau_ext over the interval, up to the error dt^2 b'' / 12 of the trapezoidal rule. The response to a
/// torque step that accelerates the arm is 1 - exp(-K t) at every later sample, for any intervals. Where the motors
/// hold against the step, so that tau steps, too, the trapezoidal rule counts half of the interval before its first
/// sample: k samples later e is 1 - a^k (1 + a) / 2 of the step, a = exp(-K dt).
///
/// White noise of standard deviation s in tau leaves s sqrt((1 - a) / 2); in p it leaves
/// s (1 - a) / dt sqrt(2 / (1 + a)).
class MomentumObserver {
  public:
    /// `gain`: K [1/s], above 0.
    MomentumObserver(double gain, int joints) noexcept : decay_(gain), joints_(joints) {}

    /// Takes momentum and b of a sample `dt` after the last one. False for the first sample, which gives no estimate.
    bool update(double dt, const double* momentum, const double* force) noexcept {
        const bool any = has_estimate_, known = any && !rebased_;
        const double share = known ? 1 - decay_.over(dt) : 0, rate = known ? 1 / dt : 0;
        for (int j = 0; j < joints_; ++j) {
            const double mean = (momentum[j] - momentum_[j]) * rate - 0.5 * (force[j] + force_[j]);
            estimate_[j] = known ? estimate_[j] + share * (mean - estimate_[j]) : any ? estimate_[j] : 0.0;
            momentum_[j] = momentum[j];
            force_[j] = force[j];
        }
        has_estimate_ = true;
        rebased_ = false;
        return any;
    }
    void reset() noexcept { has_estimate_ = false; }
    /// Momentum and b of the next sample are those of another arm than before: the estimate stays as it is until then.
    void rebase() noexcept { rebased_ = true; }
    /// tau_ext by joint [Nm or N]; minus the residual.
    const double* estimate() const noexcept { return estimate_.data(); }

  private:
    Decay decay_;
    int joints_;
    bool has_estimate_ = false, rebased_ = false;
    std::array<double, max_joints> momentum_{}, force_{}, estimate_{};
};

/// The band-pass channel: a first-order low-pass against noise, minus a second, slower low-pass of its output.
///
///   u(k) = a u(k-1) + (1 - a) r(k),   w(k) = b w(k-1) + (1 - b) u(k),   band(k) = u(k) - w(k)
///
/// with a = exp(-2 pi f_high dt) and b = exp(-2 pi f_low dt). Both low-passes start at the first input, so that neither
/// the start nor a constant offset gives an output. A step of the input passes with the gain b and the delay of u,
/// dt a / (1 - a), and decays in about 1 / (2 pi f_low). White noise of standard deviation s leaves
/// s b (1 - a) sqrt(2 / ((1 + a) (1 + b) (1 - a b))).
class BandPass {
  public:
    /// 0 < low < high [Hz].
    BandPass(double low_hz, double high_hz) noexcept
        : low_(6.283185307179586 * low_hz), high_(6.283185307179586 * high_hz) {}

    /// The coefficients a and b of a tick `dt` after the last one. To be called once a tick.
    struct Shares {
        double high, low;
    };
    Shares step(double dt) noexcept {
        const Shares kept = known_ ? Shares{high_.over(dt), low_.over(dt)} : Shares{0, 0};
        known_ = true;
        return kept;
    }
    /// Output for the joints from `first` on, one register of them; the input is finite.
    Lanes<native_lanes> pass(const Shares& kept, int first, Lanes<native_lanes> input) noexcept {
        using L = Lanes<native_lanes>;
        const L smooth = input + kept.high * (load<L>(&smooth_[first]) - input);
        const L slow = smooth + kept.low * (load<L>(&slow_[first]) - smooth);
        store(smooth, &smooth_[first]);
        store(slow, &slow_[first]);
        return smooth - slow;
    }
    void reset() noexcept { known_ = false; }

  private:
    Decay low_, high_;
    bool known_ = false;
    std::array<double, max_joints> smooth_{}, slow_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
