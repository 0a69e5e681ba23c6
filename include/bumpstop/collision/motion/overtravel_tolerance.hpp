/// @file
/// How well the farthest points of stopping paths must be known.
#pragma once

#include <algorithm>

#include "bumpstop/collision/motion/arm_integrator.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Interpolated ticks may be wrong by this much at the ticks that are checked [m]. 1e-9 m is the
/// accuracy that a force distribution asks for.
inline constexpr double min_overtravel_tolerance = 5e-10;
/// Where a distribution says how probable a detection at a tick is at most, this divided by that is enough, if it is
/// more, and never more than `max_overtravel_tolerance` [m]. `make validate` (batches) tells how accurate distributions
/// are with it.
inline constexpr double negligible_overtravel = 1e-10;
inline constexpr double max_overtravel_tolerance = 1e-3;
/// A tick less probable than this need not be simulated because a switching point is near: the grid finds what matters
/// of it.
inline constexpr double switch_probability = 1e-5;

/// An arm that reacts to a tick less probable than this is not followed to its retreat. A path has some 1000 ticks:
/// what they could change of an exceedance is 1e-5 at most.
inline constexpr double negligible_detection_probability = 1e-8;

/// Near a singularity the error of an Adams step grows by orders of magnitude, and a loose one may miss that the arm
/// swings forward again: so reactions to ticks more probable than this are followed closely there.
inline constexpr double singular_probability = 1e-5;

/// How well the overtravel of every tick must be known. Without probabilities: all equally well.
struct OvertravelTolerance {
    const double* probability = nullptr;  ///< by tick, at most, of a detection there

    double of(int first, int last) const {
        if (probability == nullptr) return min_overtravel_tolerance;
        const double most = *std::max_element(probability + first, probability + last + 1);
        return std::clamp(negligible_overtravel / most, min_overtravel_tolerance, max_overtravel_tolerance);
    }
    /// How well the reactions must be known that it is found from.
    double of_reaction(int tick) const {
        return probability == nullptr ? exact_tolerance
                                      : std::clamp(300 * of(tick, tick), batch_tolerance, max_batch_tolerance);
    }
    /// Whether an arm that may swing forward again near a singularity is followed until it cannot.
    bool follows(int tick) const {
        return probability == nullptr || probability[tick] > negligible_detection_probability;
    }
    /// Whether a reaction that met a singularity is followed once more, closely. Ticks before the first always are.
    bool refines_near_singular(int tick) const {
        return probability == nullptr || tick < 0 || probability[tick] > singular_probability;
    }
    /// To either side of a tick without a peak, how far others may lie on straight lines.
    int max_linear() const { return probability == nullptr ? 0 : 8; }
    bool matters(int first, int last) const {
        return probability == nullptr ||
               *std::max_element(probability + first, probability + last + 1) > switch_probability;
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
