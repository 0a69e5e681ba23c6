/// @file
/// Correlated noise: the density of the residual, given that there was no alarm so far, propagated from tick to tick.
#pragma once

#include <algorithm>
#include <numbers>
#include <vector>

#include "bumpstop/detection/gaussian_thresholds.hpp"
#include "bumpstop/math/quadrature.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// First-order noise of one joint, e(k) = c e(k-1) + s w(k) with w white and s = sd sqrt(1 - c^2): sd is the stationary
/// standard deviation and c the correlation from tick to tick. Without an alarm the residual is between its thresholds.
/// The quadrature nodes lie there, within `reach` standard deviations of the centre of the noise; where a threshold is
/// nearer, their range is shifted and keeps its width.
struct CorrelatedNoise {
    static constexpr double reach = 9;

    double threshold = 0, sd = 0, mean = 0;  ///< Nm or N
    double correlation = 0;                  ///< c
    double innovation = 0;                   ///< s, standard deviation of what a tick adds [Nm or N]
    double half = 0;                         ///< half-width of the range of the nodes [Nm or N]
    std::vector<double> node, weight;        ///< on [-1, 1]
    /// Transition kernel exp(-(a_i - c a_l)^2 / 2) with a_i = node_i half / s, [i][l], for noise centred in the range.
    std::vector<double> kernel;

    CorrelatedNoise(double limit, double noise_sd, double noise_mean, double noise_correlation)
        : threshold(limit), sd(noise_sd), mean(noise_mean), correlation(noise_correlation) {
        innovation = sd * std::sqrt((1 - correlation) * (1 + correlation));
        // The integrand is a product of two Gaussians as narrow as the innovation: the error of these nodes is 1e-13.
        half = std::min(threshold, reach * sd);
        const int count = std::max(12, int(std::ceil(5.5 * half / innovation)) + 8);
        const int pieces = (count + max_order - 1) / max_order;
        const GaussRule& rule = gauss_rule((count + pieces - 1) / pieces);
        for (int piece = 0; piece < pieces; ++piece) {
            for (int g = 0; g < rule.order; ++g) {
                node.push_back((2 * piece + 1 + rule.node[g]) / pieces - 1);
                weight.push_back(rule.weight[g] / pieces);
            }
        }
        if (!(half_in_innovations() < max_shift)) return;
        for (double to : node) {
            for (double from : node) {
                const double z = half_in_innovations() * (to - correlation * from);
                kernel.push_back(std::exp(-0.5 * z * z));
            }
        }
    }
    /// Half-width of the range in units of the innovation.
    double half_in_innovations() const { return half / innovation; }
    /// Limit of the product of shift and half-width, above which the factored kernel loses digits.
    static constexpr double max_shift = 300;
    int size() const { return int(node.size()); }
};

/// Density of the residual, given that there was no alarm so far.
template <class T>
struct SurvivingNoiseDensity {
    std::vector<T> value;  ///< at the nodes, per Nm; integrates to one
    T low, high;           ///< range of the nodes [Nm or N]
    T centre;              ///< noiseless residual plus noise mean [Nm or N]
    T known = 0.0;         ///< 0: no tick has been monitored yet, so the noise is stationary; else 1

    void reset(const CorrelatedNoise& noise) {
        value.assign(std::size_t(noise.size()), T(0.0));
        low = -noise.half;
        high = noise.half;
        centre = noise.mean;
        known = 0.0;
    }
    /// Begins with the same density in all lanes.
    void begin(const SurvivingNoiseDensity<double>& from) {
        value.assign(from.value.begin(), from.value.end());
        low = from.low;
        high = from.high;
        centre = from.centre;
        known = from.known;
    }
};

namespace detail {

/// Multiplies values at the nodes, which are symmetric about zero, by exp(slope node); |slope| up to
/// `CorrelatedNoise::max_shift`.
template <class T>
void multiply_by_exponential(const CorrelatedNoise& noise, T slope, T* value) {
    const auto rises = slope > T(0.0);
    for (int low = 0, high = noise.size() - 1; low < high; ++low, --high) {
        const T below = exp_minus(T(abs(slope) * noise.node[high]), T(0.0)), above = 1.0 / below;
        value[low] *= select(rises, below, above);
        value[high] *= select(rises, above, below);
    }
}

/// The density at the nodes after a tick, where their range keeps its width. With the shift d of the range relative to
/// the noise, in innovations, the kernel factors: exp(-(a_i - c a_l + d)^2 / 2) is kernel[i][l] exp(-d a_i - d^2 / 2)
/// exp(d c a_l).
template <class T>
void propagate_same_width(const CorrelatedNoise& noise, T shift, T* mass, std::vector<T>& value) {
    const int n = noise.size();
    const T slope = shift * noise.half_in_innovations();
    multiply_by_exponential(noise, T(noise.correlation * slope), mass);
    for (int i = 0; i < n; ++i) {
        const double* row = &noise.kernel[std::size_t(i) * n];
        T sum[4] = {T(0.0), T(0.0), T(0.0), T(0.0)};
        int l = 0;
        for (; l + 4 <= n; l += 4) {
            BUMPSTOP_UNROLL
            for (int k = 0; k < 4; ++k) sum[k] = fused(mass[l + k], T(row[l + k]), sum[k]);
        }
        for (; l < n; ++l) sum[0] += mass[l] * row[l];
        value[i] = (sum[0] + sum[1]) + (sum[2] + sum[3]);
    }
    multiply_by_exponential(noise, T(-slope), value.data());
    const T constant = exp_minus(T(0.5 * shift * shift), T(0.0));
    for (int i = 0; i < n; ++i) value[i] *= constant;
}

}  // namespace detail

/// Propagates the density over a tick: the noise changes, the noiseless residual becomes `torque`, and residuals beyond
/// the thresholds are removed. `work`: scratch for two values per node.
template <class T>
AlarmProbability<T> propagate_tick(const CorrelatedNoise& noise, SurvivingNoiseDensity<T>& density, T torque,
                                   std::vector<T>& work) {
    const int n = noise.size();
    const double s = noise.innovation, root_half = 0.70710678118654752440, per_root = 0.39894228040143267794;
    const T centre = torque + noise.mean;
    const double furthest = CorrelatedNoise::reach * noise.sd, inner = noise.threshold - noise.half;
    // Where the residual is far beyond its thresholds the range between them shrinks to this width, not to zero.
    const double least = 1e-3 * std::min(noise.sd, noise.threshold);
    // Well beyond a threshold the remaining density is concentrated at it, and the whole range would be too coarse.
    const auto whole = abs(centre) <= T(noise.threshold + 2 * s);
    const T inside = min(max(centre, T(-inner)), T(inner));
    const T low = select(whole, inside - noise.half,
                         min(max(T(-noise.threshold), centre - furthest), T(noise.threshold - least)));
    const T high = select(whole, inside + noise.half, max(min(T(noise.threshold), centre + furthest), low + least));
    const T middle = 0.5 * (low + high), half = 0.5 * (high - low);
    const auto known = density.known > T(0.5);

    work.resize(std::size_t(2 * n));
    T* arrival = work.data();  // centre of the next residual, by node
    T* mass = work.data() + n;
    const T old_middle = 0.5 * (density.low + density.high), old_half = 0.5 * (density.high - density.low);
    T alarm = 0.0;
    for (int l = 0; l < n; ++l) {
        arrival[l] = centre + noise.correlation * (old_middle + old_half * noise.node[l] - density.centre);
        mass[l] = old_half * noise.weight[l] * density.value[l];
        const T above = erfc((noise.threshold - arrival[l]) * (root_half / s));
        const T below = erfc((noise.threshold + arrival[l]) * (root_half / s));
        alarm += mass[l] * (0.5 * (above + below));
    }
    const T fresh_alarm = 0.5 * (erfc((noise.threshold - centre) * (root_half / noise.sd)) +
                                 erfc((noise.threshold + centre) * (root_half / noise.sd)));
    alarm = select(known, alarm, fresh_alarm);

    T no_alarm = 0.0;
    const bool any_known = any(known), all_known = all(known);
    std::vector<T>& value = density.value;
    const T shift = ((middle - centre) - noise.correlation * (old_middle - density.centre)) * (1 / s);
    const T full = (1 - 1e-12) * noise.half;
    const bool as_wide = any_known && !noise.kernel.empty() &&
                         all((half > full) & (old_half > full) &
                             (abs(shift) * (noise.half_in_innovations() + abs(shift)) < T(CorrelatedNoise::max_shift)));
    if (as_wide) detail::propagate_same_width(noise, shift, mass, value);
    for (int i = 0; i < n; ++i) {
        const T x = middle + half * noise.node[i];
        T sum = 0.0;
        if (as_wide) {
            sum = value[i] * (per_root / s);
        } else if (any_known) {
            for (int l = 0; l < n; ++l) {
                const T z = (x - arrival[l]) * (1 / s);
                const T exponent = 0.5 * z * z;
                if (!any(exponent < T(40.0))) continue;
                sum += mass[l] * exp_minus(min(exponent, T(700.0)), T(0.0));
            }
            sum *= per_root / s;
        }
        if (!all_known) {
            const T z = (x - centre) * (1 / noise.sd);
            const T fresh = exp_minus(min(T(0.5 * z * z), T(700.0)), T(0.0)) * (per_root / noise.sd);
            sum = select(known, sum, fresh);
        }
        value[i] = sum;
        no_alarm += half * noise.weight[i] * sum;
    }
    const T scale = 1.0 / max(no_alarm, T(1e-290));
    for (int i = 0; i < n; ++i) value[i] *= scale;
    density.low = low;
    density.high = high;
    density.centre = centre;
    density.known = 1.0;
    return {min(alarm, T(1.0)), min(no_alarm, T(1.0))};
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
