/// @file
/// The distribution of a collision over contact offset and sensor noise.
#pragma once

#include "bumpstop/collision/contact/dynamic_contact.hpp"
#include "bumpstop/collision/distribution/linear_quantity.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct CollisionDistribution {
    PiecewiseDensity density;
    LinearQuantity peak_force;                           ///< where anything is detected, or the arm comes to rest [N]
    LinearQuantity force_at_detection, detection_delay;  ///< of detections after contact [N, s]; empty in a batch
    LinearQuantity end_force;         ///< of undetected collisions by the end of the motion [N]; empty in a batch
    bool rests = false;               ///< the arm comes to rest where its path ends, so that `end_force` has a bound
    double detected = 0;              ///< before contact or after, of clamped contact
    double false_alarm = 0;           ///< detection before contact
    double zero_force = 0;            ///< no force at all: false alarms in time, and no contact
    double undetected = 0;            ///< contact, and no detection by the end of the motion
    double no_contact = 0;            ///< the motion ends before contact, no alarm
    double multi_joint = 0;           ///< two or more joints over their threshold at the tick of detection
    double trigger[max_joints] = {};  ///< joint over its threshold at the tick of detection
    bool interpolated = false;        ///< detection probabilities of some panels are interpolated
    ContactNodes nodes;               ///< of dynamic contact (elastic arm, or body that moves), not the forces above
    EarlyReactions early_reactions;   ///< of dynamic contact: detections before it

    /// A motion that cannot begin, from a singular pose or from beyond a joint's limits.
    static CollisionDistribution unknown() {
        CollisionDistribution out;
        for (double* value : {&out.detected, &out.false_alarm, &out.zero_force, &out.undetected, &out.no_contact})
            *value = NAN;
        return out;
    }

    /// Probability of undetected collisions whose force has no bound: they exceed every force.
    double unbounded() const { return rests ? 0 : undetected; }

    // --- The peak force, defined in `cell_mixture.hpp`; NaN where the motion cannot begin ---

    /// P(peak force > force), undetected collisions without a bound included.
    template <class T = Lanes<native_lanes>>
    double exceedance(double force) const;
    /// The peak force that is exceeded with probability `allowed` [N]; infinite where that much is unbounded.
    template <class T = Lanes<native_lanes>>
    double upper_quantile(double allowed) const;
    /// Mean and standard deviation; infinite and NaN where a collision may be undetected without a bound.
    template <class T = Lanes<native_lanes>>
    Moments moments() const;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
