/// @file
/// How well the farthest points of stopping paths must be known.
#pragma once

#include <algorithm>

#include "bumpstop/collision/braking_arm.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Interpolated ticks may be wrong by this much at the ticks that are checked [m]. 1e-9 m is what a force law
/// can feel.
inline constexpr double farthest_tolerance = 5e-10;
/// Where a law says how probable a detection at a tick is at most, this divided by that is enough, if it is more, and
/// never more than `largest_farthest_tolerance` [m]. `make validate` (batches) tells how right laws are with it.
inline constexpr double improbable_farthest_tolerance = 1e-10;
inline constexpr double largest_farthest_tolerance = 1e-3;
/// A tick less probable than this need not be simulated because a kink is near: refinement finds what matters of it.
inline constexpr double kink_probability = 1e-5;

/// An arm that reacts to a tick less probable than this is not followed home. A path has some 1000 ticks: what they could
/// change of an exceedance is 1e-5 at most.
inline constexpr double unfelt_probability = 1e-8;

/// Near a singularity what a leap leaves out grows by orders of magnitude, and a loose leap may miss that the arm swings
/// forward again: so reactions to ticks more probable than this are followed closely there.
inline constexpr double singular_probability = 1e-5;

/// How well the overrun of every tick must be known. Without probabilities: all equally well.
struct FarthestTolerance {
    const double* probability = nullptr;  ///< by tick, at most, of a detection there

    double of(int first, int last) const {
        if (probability == nullptr) return farthest_tolerance;
        const double most = *std::max_element(probability + first, probability + last + 1);
        return std::clamp(improbable_farthest_tolerance / most, farthest_tolerance, largest_farthest_tolerance);
    }
    /// How well the reactions must be known that it is found from.
    double of_leaps(int tick) const {
        return probability == nullptr
                   ? braking_leap_tolerance
                   : std::clamp(300 * of(tick, tick), loose_braking_leap_tolerance, loosest_braking_leap_tolerance);
    }
    /// Whether an arm that may swing forward again near a singularity is followed until it cannot.
    bool follows(int tick) const { return probability == nullptr || probability[tick] > unfelt_probability; }
    /// Whether a reaction that met a singularity is followed once more, closely. Ticks before the first always are.
    bool follows_closely(int tick) const {
        return probability == nullptr || tick < 0 || probability[tick] > singular_probability;
    }
    /// To either side of a tick without a summit, how far others may lie on straight lines.
    int longest_straight() const { return probability == nullptr ? 0 : 8; }
    bool matters(int first, int last) const {
        return probability == nullptr ||
               *std::max_element(probability + first, probability + last + 1) > kink_probability;
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
