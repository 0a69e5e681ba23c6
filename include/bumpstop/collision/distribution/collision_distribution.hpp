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

    /// A motion that cannot begin, from a singular pose or from beyond a joint's limits.
    static CollisionDistribution unknown() {
        CollisionDistribution out;
        for (double* value : {&out.detected, &out.false_alarm, &out.zero_force, &out.undetected, &out.no_contact})
            *value = NAN;
        return out;
    }

    /// Probability of collisions never detected whose force has no bound: they count as over every limit.
    double unbounded() const { return rests ? 0 : undetected; }

    // --- The peak force, by `cell_mixture.hpp`; not a number where a motion cannot begin ---

    /// P(peak force > force), collisions never detected and without a bound included.
    template <class T = Lanes<native_lanes>>
    double exceedance(double force) const;
    /// The peak force that is exceeded with probability `allowed` [N]; infinite where that much is unbounded.
    template <class T = Lanes<native_lanes>>
    double upper_quantile(double allowed) const;
    /// Mean and standard deviation. Where nothing was detected the force of a rigid arm by the end counts; where something
    /// gives way, and a held body is pressed on, there is no bound.
    template <class T = Lanes<native_lanes>>
    Moments moments() const;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
