/// @file
/// Distribution of the contact offset.
#pragma once

#include <cmath>

#include "bumpstop/math/functions.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

enum class OffsetKind { half_normal, uniform, fixed };

/// Distribution of the distance o >= 0 along the normal from the contact point's start to the body.
struct OffsetDistribution {
    OffsetKind kind = OffsetKind::uniform;
    double size = 0;  ///< half-normal: its sd; uniform: its upper end; fixed: the distance [m]

    /// Beyond seven sd lies 2.6e-12 of a half-normal distribution, which is truncated there and normalised.
    static constexpr double reach = 7;
    inline static const double beyond_reach = std::erfc(reach * 0.70710678118654752440);
    inline static const double within_reach = std::erf(reach * 0.70710678118654752440);

    /// In metres, of one whose size is in seconds at the approach speed [m/s]; a fixed offset stays as it is.
    OffsetDistribution at_speed(double speed) const { return {kind, kind == OffsetKind::fixed ? size : size * speed}; }

    double median() const {
        constexpr double of_half_normal = 0.67448975019608171;
        return kind == OffsetKind::half_normal ? of_half_normal * size
               : kind == OffsetKind::uniform   ? 0.5 * size
                                               : size;
    }
    double largest() const { return kind == OffsetKind::half_normal ? reach * size : size; }

    /// Probability per metre, inside [0, largest()]. Not for a fixed offset.
    template <class T>
    T density(T o) const {
        if (kind == OffsetKind::uniform) return 1 / size;
        const T z = o * (1 / size);
        const double normalised = 0.79788456080286535588 / (size * within_reach);
        return exp_minus(T(0.5 * z * z), T(0.0)) * normalised;
    }
    template <class T>
    T probability_beyond(T o) const {
        T inside = 1.0;
        if (kind == OffsetKind::uniform) inside = 1.0 - o * (1 / size);
        if (kind == OffsetKind::half_normal)
            inside = (erfc(T(o * (0.70710678118654752440 / size))) - beyond_reach) * (1 / within_reach);
        return select(o >= T(largest()), T(0.0), select(o <= T(0.0), T(1.0), inside));
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
