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
    std::vector<double> node, weight;        ///< from the middle of the range [Nm or N]
    /// Transition kernel exp(-(a_i - c a_l)^2 / 2) with a_i = node_i / s, [i][l], for noise centred in the range.
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
                node.push_back(half * ((2 * piece + 1 + rule.node[g]) / pieces - 1));
                weight.push_back(half * rule.weight[g] / pieces);
            }
        }
        if (!(half < max_factored * innovation)) return;
        for (double to : node) {
            for (double from : node) {
                const double z = (to - correlation * from) / innovation;
                kernel.push_back(std::exp(-0.5 * z * z));
            }
        }
    }
    /// Limit of exponents, above which the factored kernel loses digits.
    static constexpr double max_factored = 600;
    int size() const { return int(node.size()); }
};

/// Density of the residual, given that there was no alarm so far.
template <class T>
struct SurvivingNoiseDensity {
    std::vector<T> value;  ///< at the nodes, per Nm; integrates to one
    T middle;              ///< of the range of the nodes [Nm or N]
    T centre;              ///< noiseless residual plus noise mean [Nm or N]
    bool known = false;    ///< false: no tick has been monitored yet, so the noise is stationary

    void reset(const CorrelatedNoise& noise) {
        value.assign(std::size_t(noise.size()), T(0.0));
        middle = 0.0;
        centre = noise.mean;
        known = false;
    }
    /// Begins with the same density in all lanes.
    void begin(const SurvivingNoiseDensity<double>& from) {
        value.assign(from.value.begin(), from.value.end());
        middle = from.middle;
        centre = from.centre;
        known = from.known;
    }
};

namespace detail {

/// Multiplies values at the nodes, which are symmetric about zero, by exp(slope node).
template <class T>
void multiply_by_exponential(const CorrelatedNoise& noise, T slope, T* value) {
    const auto rises = slope > T(0.0);
    for (int low = 0, high = noise.size() - 1; low < high; ++low, --high) {
        const T below = exp_minus(T(abs(slope) * noise.node[high]), T(0.0)), above = 1.0 / below;
        value[low] *= select(rises, below, above);
        value[high] *= select(rises, above, below);
    }
}

/// The sums over l of mass_l exp(-(a_i - c a_l + d)^2 / 2), by i, with d = `shift`: that of the range relative to the
/// noise, in innovations. Unless d is large the exponential factors into kernel[i][l], exp(-d a_i - d^2 / 2) and
/// exp(d c a_l). `scaled`: scratch.
template <class T>
void add_innovation(const CorrelatedNoise& noise, T shift, const T* mass, T* scaled, std::vector<T>& sums) {
    const int n = noise.size();
    const double c = noise.correlation, per_s = 1 / noise.innovation;
    if (noise.kernel.empty() ||
        !all(abs(shift) * (noise.half * per_s + abs(shift)) < T(CorrelatedNoise::max_factored))) {
        double least = lane_of(shift, 0), most = least;
        for (int lane = 1; lane < Scalar<T>::lanes; ++lane) {
            least = std::min(least, lane_of(shift, lane));
            most = std::max(most, lane_of(shift, lane));
        }
        for (int i = 0; i < n; ++i) {
            // Elsewhere the exponential is below 3e-18 in every lane.
            const double a = (noise.node[i] + (least - 9) * noise.innovation) / c,
                         b = (noise.node[i] + (most + 9) * noise.innovation) / c;
            const auto begin = noise.node.begin(), from = std::lower_bound(begin, noise.node.end(), std::min(a, b)),
                       to = std::upper_bound(from, noise.node.end(), std::max(a, b));
            sums[i] = 0.0;
            for (auto node = from; node != to; ++node) {
                const T z = shift + (noise.node[i] - c * *node) * per_s;
                sums[i] += mass[node - begin] * exp_minus(min(T(0.5 * z * z), T(700.0)), T(0.0));
            }
        }
        return;
    }
    std::copy_n(mass, n, scaled);
    multiply_by_exponential(noise, T(c * per_s * shift), scaled);
    for (int i = 0; i < n; ++i) {
        const double* row = &noise.kernel[std::size_t(i) * n];
        T sum[4] = {T(0.0), T(0.0), T(0.0), T(0.0)};
        int l = 0;
        for (; l + 4 <= n; l += 4) {
            BUMPSTOP_UNROLL
            for (int k = 0; k < 4; ++k) sum[k] = fused(scaled[l + k], T(row[l + k]), sum[k]);
        }
        for (; l < n; ++l) sum[0] += scaled[l] * row[l];
        sums[i] = (sum[0] + sum[1]) + (sum[2] + sum[3]);
    }
    multiply_by_exponential(noise, T(-per_s * shift), sums.data());
    const T constant = exp_minus(T(0.5 * shift * shift), T(0.0));
    for (int i = 0; i < n; ++i) sums[i] *= constant;
}

}  // namespace detail

/// Propagates the density over a tick: the noise changes, the noiseless residual becomes `torque`, and residuals beyond
/// the thresholds are removed. `work`: scratch for two values per node.
template <class T>
AlarmProbability<T> propagate_tick(const CorrelatedNoise& noise, SurvivingNoiseDensity<T>& density, T torque,
                                   std::vector<T>& work) {
    constexpr double root_half = 0.70710678118654752440, per_root = 0.39894228040143267794;
    constexpr double rare = 1e-3;  // complements of probabilities lose digits below
    const int n = noise.size();
    const double threshold = noise.threshold, inner = threshold - noise.half, c = noise.correlation;
    const double sd = density.known ? noise.innovation : noise.sd;  // of what the tick adds to what is known
    const T centre = torque + noise.mean, middle = min(max(centre, T(-inner)), T(inner));
    // Middles of the ranges, from the centres of the noise.
    const T before = density.middle - density.centre, after = middle - centre;
    std::vector<T>& value = density.value;
    work.resize(std::size_t(2 * n));
    T* mass = work.data();
    if (density.known) {
        for (int l = 0; l < n; ++l) mass[l] = noise.weight[l] * value[l];
        detail::add_innovation(noise, T((after - c * before) * (1 / sd)), mass, mass + n, value);
    } else {
        for (int i = 0; i < n; ++i) {
            const T z = (after + noise.node[i]) * (1 / sd);
            value[i] = exp_minus(min(T(0.5 * z * z), T(700.0)), T(0.0));
        }
    }
    T no_alarm = 0.0;
    for (int i = 0; i < n; ++i) no_alarm += noise.weight[i] * value[i];
    const T scale = 1.0 / max(no_alarm, T(1e-290));
    for (int i = 0; i < n; ++i) value[i] *= scale;
    no_alarm = min(T(no_alarm * (per_root / sd)), T(1.0));
    T alarm = 1.0 - no_alarm;
    if (any(alarm < T(rare))) {
        const auto tails = [&](T from) {
            const T distance = abs(from);
            T sum = erfc((threshold - distance) * (root_half / sd));
            // As in joint_alarm the far tail is below rounding of the near one.
            if (any(distance * threshold < T(20 * sd * sd))) sum += erfc((threshold + distance) * (root_half / sd));
            return 0.5 * sum;
        };
        T sum = 0.0;
        if (!density.known) sum = tails(centre);
        for (int l = 0; l < n && density.known; ++l) sum += mass[l] * tails(T(centre + c * (before + noise.node[l])));
        alarm = select(alarm < T(rare), sum, alarm);
    }
    density.middle = middle;
    density.centre = centre;
    density.known = true;
    return {alarm, no_alarm};
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
