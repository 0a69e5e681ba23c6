/// @file
/// The distribution of a collision over contact offset and sensor noise.
#pragma once

#include "bumpstop/collision/contact/dynamic_contact.hpp"
#include "bumpstop/collision/distribution/linear_quantity.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct CollisionDistribution {
    PiecewiseDensity density;
    LinearQuantity peak_force;  ///< where anything is detected, or the arm comes to rest [N]
    LinearQuantity force_at_detection,
        detection_delay;              ///< of detections after contact, where delays are wanted [N, s]
    LinearQuantity end_force;         ///< of collisions never detected, greatest by the end [N]
    bool rests = false;               ///< the arm comes to rest where its path ends, so that `end_force` has a bound
    double detected = 0;              ///< before contact or after, of clamped contact
    double false_alarm = 0;           ///< detection before contact
    double zero_force = 0;            ///< of those, and of motions that end before contact: no force at all
    double undetected = 0;            ///< contact, and no detection by the end of the motion
    double no_contact = 0;            ///< the motion ends before contact, no alarm
    double multi_joint = 0;           ///< two or more joints over their threshold at the tick of detection
    double trigger[max_joints] = {};  ///< joint over its threshold at the tick of detection
    bool interpolated = false;        ///< detection probabilities come from a few panels
    ContactNodes nodes;               ///< where something gives way, instead of the forces above
    EarlyReactions early_reactions;   ///< there: detections before contact

    /// Probability of collisions never detected whose force has no bound: they count as over every limit.
    double unbounded() const { return rests ? 0 : undetected; }

    /// P(peak force > force), collisions never detected and without a bound included.
    template <class T = Lanes<native_lanes>>
    double exceedance(double force) const {
        return tail<T>(density, peak_force, force).probability + unbounded();
    }
    /// The peak force that is exceeded with probability `allowed` [N]; infinite where that much is unbounded.
    template <class T = Lanes<native_lanes>>
    double upper_quantile(double allowed) const {
        return bumpstop::upper_quantile<T>(density, peak_force, allowed, unbounded());
    }
    /// Mean and standard deviation of the peak force, counting the force by the end where nothing was detected.
    Moments moments() const {
        const double bounded = peak_force.total + zero_force;
        const Moments known = mixture(peak_force.total, peak_force.moments, zero_force, {0, 0});
        // Where the arm comes to rest the others are among them.
        return rests ? known : mixture(bounded, known, end_force.total, end_force.moments);
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
