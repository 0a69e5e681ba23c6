/// @file
/// How accurately the overtravels of a stopping curve must be known.
#pragma once

#include <algorithm>

#include "bumpstop/collision/motion/arm_integrator.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Largest error of interpolated overtravels at the ticks that are checked [m]. A force distribution needs 1e-9 m.
inline constexpr double min_overtravel_tolerance = 5e-10;
/// With an upper bound of the detection probability at a tick, the tolerance is this divided by that bound, clamped to
/// the least and the greatest tolerance [m]. `make validate` (batches) shows the accuracy of distributions with it.
inline constexpr double negligible_overtravel = 1e-10;
inline constexpr double max_overtravel_tolerance = 1e-3;
/// Ticks near a switching point are all simulated, unless they are less probable than this.
inline constexpr double switch_probability = 1e-5;

/// A reaction to a tick less probable than this ends with its first retreat, even where the arm might swing forward
/// again. A path has some 1000 ticks, so together they change an exceedance probability by 1e-5 at most.
inline constexpr double negligible_detection_probability = 1e-8;

/// Near a singularity the error of an Adams step grows by orders of magnitude, and with a wide tolerance the arm's
/// swing forward may be missed. So reactions to ticks more probable than this are simulated again with a narrow one.
inline constexpr double singular_probability = 1e-5;

/// How accurately the overtravel of every tick must be known. Without probabilities all ticks count equally.
struct OvertravelTolerance {
    const double* probability = nullptr;  ///< upper bounds of the detection probability, by tick

    /// Tolerance of the ticks from `first` to `last` [m].
    double of(int first, int last) const {
        if (probability == nullptr) return min_overtravel_tolerance;
        const double most = *std::max_element(probability + first, probability + last + 1);
        return std::clamp(negligible_overtravel / most, min_overtravel_tolerance, max_overtravel_tolerance);
    }
    /// Tolerance of the Adams steps of a simulated reaction.
    double of_reaction(int tick) const {
        return probability == nullptr ? exact_tolerance
                                      : std::clamp(300 * of(tick, tick), batch_tolerance, max_batch_tolerance);
    }
    /// Whether an arm that may swing forward again near a singularity is followed until it no longer can.
    bool follows(int tick) const {
        return probability == nullptr || probability[tick] > negligible_detection_probability;
    }
    /// Whether a reaction that met a singularity is simulated again. Those to ticks before tick 0 always are.
    bool refines_near_singular(int tick) const {
        return probability == nullptr || tick < 0 || probability[tick] > singular_probability;
    }
    /// Largest distance of ticks between which overtravels without a peak are interpolated linearly.
    int max_linear() const { return probability == nullptr ? 0 : 8; }
    /// Whether a detection from tick `first` to `last` is likely enough to matter near a switching point.
    bool matters(int first, int last) const {
        return probability == nullptr ||
               *std::max_element(probability + first, probability + last + 1) > switch_probability;
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
