/// @file
/// A collision from its scenario to the distribution of its force.
#pragma once

#include "bumpstop/collision/contact/separation_criterion.hpp"
#include "bumpstop/collision/distribution/monte_carlo.hpp"
#include "bumpstop/collision/distribution/offset_quadrature.hpp"
#include "bumpstop/collision/distribution/survival_criterion.hpp"
#include "bumpstop/collision/motion/line_tracer.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace detail {

/// The path of a line as far as a distribution needs it.
template <class T>
LinePath trace_until_decided(const CollisionSetup& setup, const LineRequest& line, const GaussianThresholds& detector,
                             const Contact& contact) {
    const std::optional<ContactPropagator> by = contact.propagator(setup.motion.step);
    if (!by) return trace_line<T>(setup, line, SurvivalCriterion<T>(setup, detector, contact));
    const double largest = contact.offset.largest();
    for (double half_oscillations = 3;; half_oscillations *= 4) {
        LinePath path =
            trace_line<T>(setup, line, SeparationCriterion<T>(*by, setup.timing, largest, half_oscillations));
        if (path.end != PathEnd::certain_detection || all_separated(path, *by, setup.timing, largest)) return path;
    }
}

}  // namespace detail

/// The stopping curve of a line. With a detector it ends where even the farthest body has been detected for certain, or has
/// got away: a distribution needs no more. Without one it ends with the motion.
template <class T>
StoppingCurve stopping_curve(const CollisionSetup& setup, const LineRequest& line, const GaussianThresholds* detector,
                             const Contact& contact) {
    StoppingCurve curve;
    curve.path = detector != nullptr ? detail::trace_until_decided<T>(setup, line, *detector, contact)
                                     : trace_line<T>(setup, line, NoCriterion<T>());
    complete_curves<T>(setup, &curve, 1, [](int) { return OvertravelTolerance{}; });
    return curve;
}

/// The distribution of the collision of an arm that follows a line, over the contact's offset and the detector's noise.
template <class T = Lanes<native_lanes>>
CollisionDistribution evaluate(const CollisionSetup& setup, const LineRequest& line, const GaussianThresholds& detector,
                               const Contact& contact) {
    return integrate<T>(setup, stopping_curve<T>(setup, line, &detector, contact), detector, {contact});
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
