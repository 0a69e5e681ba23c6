/// @file
/// A collision from its scenario to the distribution of its force.
#pragma once

#include <optional>

#include "bumpstop/collision/contact/reaction_paths.hpp"
#include "bumpstop/collision/distribution/cell_mixture.hpp"
#include "bumpstop/collision/distribution/monte_carlo.hpp"
#include "bumpstop/collision/distribution/offset_quadrature.hpp"
#include "bumpstop/collision/distribution/survival_criterion.hpp"
#include "bumpstop/collision/motion/line_tracer.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The distribution of a collision from its stopping curve. Dynamic contact without `settings.paths` takes the paths of
/// the line. `before`: alarms before contact of a motion at least as long, which many distributions may share.
template <class T>
CollisionDistribution integrate(const CollisionSetup& setup, const StoppingCurve& curve,
                                const GaussianThresholds& detector, QuadratureSettings settings,
                                const PreContactAlarms* before = nullptr) {
    if (curve.path.singular_start || curve.path.s.empty()) return CollisionDistribution::unknown();
    std::optional<ContactPropagator> propagator;
    ContactPaths paths;
    if (settings.paths == nullptr && (propagator = contact_propagator(setup, curve.path, settings.contact))) {
        paths = contact_paths<T>(setup, curve, *propagator, settings.contact.offset.largest());
        settings.paths = &paths;
        settings.propagator = &*propagator;
    }
    std::optional<PreContactAlarms> own;
    if (before == nullptr) before = &own.emplace(setup, detector, curve.path.ticks);
    DetectionProbabilities probabilities;
    const auto by = [&](const auto& alarms) {
        OffsetQuadrature<T, std::decay_t<decltype(alarms)>> quadrature(setup, detector, *before, alarms, probabilities);
        quadrature.detect(curve.path, settings);
        quadrature.finish(curve.max_distance);
        return quadrature.take();
    };
    return detector.correlated_noise() ? by(CorrelatedAlarms<T>(detector, *before)) : by(ExactAlarms<T>(detector));
}

namespace detail {

/// Whether every body up to `largest_offset` has separated before the last tick of a path that touches all of them.
inline bool all_separated(const CollisionSetup& setup, const LinePath& path, const ContactPropagator& by,
                          double largest_offset) {
    ContactPaths paths(setup, path);
    paths.follow_approach(by);
    const Separations separations(paths, by);
    const double last = paths.tick_step(path.ticks - 1);
    const auto separated = [&](const Separation& each) { return each.separated <= last; };
    // An arm that speeds up pushes the nearest body the longest.
    if (!separated(separations(0.0))) return false;
    const std::vector<Separation> found = separations.up_to(largest_offset);
    return std::all_of(found.begin(), found.end(), separated);
}

/// Whether the collision with the farthest body is detected with certainty before the last tick of a path.
inline bool surely_detected(const CollisionSetup& setup, const LinePath& path, const ContactPropagator& by,
                            const GaussianThresholds& detector, const Contact& contact) {
    const ContactDynamics dynamics(by);
    ContactState state;
    SurvivalCriterion<double> criterion(setup, detector, contact);
    double residual[max_joints];
    for (int i = 0; i < int(path.s.size()); ++i) {
        if (i > 0) dynamics.step(state, path.s[std::size_t(i) - 1], path.s[std::size_t(i)], contact.offset.largest());
        if (i < 1 || (i - 1) % setup.timing.period != 0) continue;
        const int tick = (i - 1) / setup.timing.period;
        dynamics.residuals(state, &path.torque_per_N[std::size_t(tick * path.dof)], path.dof, residual);
        criterion.observe_contact(state.touched, residual);
        if (criterion.finished(0)) return true;
    }
    return false;
}

/// The path of a line, as far as a distribution needs it.
template <class T>
LinePath trace_until_decided(const CollisionSetup& setup, const LineRequest& line, const GaussianThresholds& detector,
                             const Contact& contact) {
    const double largest = contact.offset.largest(), tick_duration = setup.timing.period * setup.motion.step;
    if (!contact.body.gets_away()) {
        LinePath path = trace_line<T>(setup, line, SurvivalCriterion<T>(setup, detector, contact));
        const std::optional<ContactSystem> system = contact_system(setup, path, contact);
        if (!system) return path;
        // In the end an elastic arm presses with its static stiffness; until then it lags behind its reference.
        Contact pressed = contact;
        pressed.body.stiffness = system->static_stiffness();
        double lag = settling_time(setup, *system);
        for (int doubling = 0; doubling < 8; ++doubling, lag *= 2) {
            const int ticks = int(std::ceil(lag / tick_duration));
            path =
                trace_line<T>(setup, line, LingeringCriterion(SurvivalCriterion<T>(setup, detector, pressed), ticks));
            if (path.end != PathEnd::all_detected ||
                surely_detected(setup, path, *contact_propagator(setup, path, contact), detector, contact))
                break;
        }
        return path;
    }
    // At constant speed a free body separates after half an oscillation. Three halves leave room for an arm that does
    // not keep its speed; one that speeds up may push for longer.
    const double half_oscillation = contact.system()->half_oscillation() / tick_duration;
    for (double half_oscillations = 3;; half_oscillations *= 4) {
        const int ticks = int(std::min(half_oscillations * half_oscillation, double(setup.timing.steps))) + 2;
        LinePath path = trace_line<T>(setup, line, LingeringCriterion(ContactCriterion<T>{largest}, ticks));
        if (path.end != PathEnd::all_detected ||
            all_separated(setup, path, *contact_propagator(setup, path, contact), largest))
            return path;
    }
}

}  // namespace detail

/// The stopping curve of a line. With a detector it ends once even the farthest body has been detected with certainty,
/// or has separated, which is all that a distribution needs. Without one it ends with the motion.
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
