/// @file
/// The distribution of a collision, by quadrature.
#pragma once

#include <optional>

#include "bumpstop/collision/contact/reaction_paths.hpp"
#include "bumpstop/collision/distribution/cell_mixture.hpp"
#include "bumpstop/collision/distribution/offset_quadrature.hpp"

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

}  // namespace bumpstop::inline BUMPSTOP_TARGET
