/// @file
/// Zero-phase filter: a Butterworth low-pass run forward and backward over equally spaced samples.
///
/// Frequencies in Hz; samples in any unit.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "bumpstop/math/lanes.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// y = (b0 + b1 / z + b2 / z^2) / (1 + a1 / z + a2 / z^2) x
struct FilterSection {
    double b0, b1, b2, a1, a2;
};

inline constexpr int max_filter_order = 10;
inline constexpr int max_filter_sections = max_filter_order / 2;

/// A filter as a cascade of second-order sections.
struct FilterSections {
    std::array<FilterSection, max_filter_sections> section{};
    int count = 0;
};

/// Butterworth low-pass of `order` (1 to max_filter_order) by the bilinear transform, pre-warped so that its gain at
/// `cutoff` is 1 / sqrt(2). `cutoff` is above 0 and below half of `rate`.
inline FilterSections butterworth(int order, double cutoff, double rate) noexcept {
    const double w = std::tan(std::numbers::pi * cutoff / rate);
    FilterSections found;
    for (int pair = 0; pair < order / 2; ++pair) {
        // The analogue prototype has a pair of poles at -sin(angle) +- i cos(angle).
        const double damping = 2 * std::sin(std::numbers::pi * (2 * pair + 1) / (2 * order));
        const double scale = 1 / (1 + damping * w + w * w), gain = w * w * scale;
        found.section[found.count++] = {gain, 2 * gain, gain, 2 * (w * w - 1) * scale,
                                        (1 - damping * w + w * w) * scale};
    }
    if (order % 2) {
        const double gain = w / (1 + w);
        found.section[found.count++] = {gain, gain, 0, (w - 1) / (1 + w), 0};
    }
    return found;
}

/// Filters `count` samples x[0], x[step], ... in place, section after section. Every section starts in the steady state
/// of a constant input equal to the first sample. One series per lane.
template <class T>
void run_filter(const FilterSections& filter, T* x, std::ptrdiff_t step, std::size_t count) noexcept {
    for (int k = 0; k < filter.count; ++k) {
        const FilterSection s = filter.section[k];
        const T still = *x, settled = still * ((s.b0 + s.b1 + s.b2) / (1 + s.a1 + s.a2));
        T two = still * s.b2 - settled * s.a2, one = still * s.b1 - settled * s.a1 + two;
        T* at = x;
        for (std::size_t i = 0; i < count; ++i, at += step) {
            const T y = *at * s.b0 + one;
            one = *at * s.b1 - y * s.a1 + two;
            two = *at * s.b2 - y * s.a2;
            *at = y;
        }
    }
}

/// Filters `columns` series of `rows` equally spaced samples, x and out row-major, forward and backward.
///
/// Against transients each end is padded by `padding` samples (fewer than `rows`), reflected about the end point.
inline void filter_zero_phase(const FilterSections& filter, const double* x, std::size_t rows, std::size_t columns,
                              std::size_t padding, double* out) {
    using L = Lanes<native_lanes>;
    std::vector<L> series(rows + 2 * padding);
    for (std::size_t first = 0; first < columns; first += native_lanes) {
        const int own = int(std::min(columns - first, std::size_t(native_lanes)));
        for (std::size_t i = 0; i < rows; ++i) {
            const double* row = x + i * columns + first;
            L& sample = series[padding + i];
            if (own == native_lanes) {
                sample = L::load(row);
                continue;
            }
            sample = L(0.0);
            for (int lane = 0; lane < own; ++lane) sample.set(lane, row[lane]);
        }
        const L begin = series[padding] * L(2.0), end = series[padding + rows - 1] * L(2.0);
        for (std::size_t k = 1; k <= padding; ++k) {
            series[padding - k] = begin - series[padding + k];
            series[padding + rows - 1 + k] = end - series[padding + rows - 1 - k];
        }
        run_filter(filter, series.data(), 1, series.size());
        run_filter(filter, series.data() + series.size() - 1, -1, series.size());
        for (std::size_t i = 0; i < rows; ++i) {
            double* row = out + i * columns + first;
            const L sample = series[padding + i];
            if (own == native_lanes) {
                sample.store(row);
                continue;
            }
            for (int lane = 0; lane < own; ++lane) row[lane] = sample[lane];
        }
    }
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
