/// @file
/// Far tails of the peak force, by a second route.
#pragma once

#include "bumpstop/collision/distribution/offset_quadrature.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Smaller probabilities count as zero.
inline constexpr double negligible_tail = 1e-300;

namespace detail {

/// Panels cut at the offsets where a detection at some tick just exceeds the depth.
inline std::vector<OffsetPanel> cut_at_reaches(const std::vector<OffsetPanel>& panels, const std::vector<double>& reach,
                                               double depth) {
    std::vector<OffsetPanel> made;
    for (const OffsetPanel& panel : panels) {
        allow_interruption();
        std::vector<double> ends{panel.high};
        for (double to : reach)
            if (to - depth > panel.low && to - depth < panel.high) ends.push_back(to - depth);
        std::sort(ends.begin(), ends.end());
        double low = panel.low;
        for (double high : ends) {
            if (high > low || panel.high == panel.low) made.push_back({low, high, panel.tick});
            low = high;
        }
    }
    return made;
}

}  // namespace detail

/// P(peak force > force) of collisions whose force has a bound. Nothing is interpolated and only positive terms are
/// added, so a probability of 1e-30 has as many digits as one of 0.3. For clamped contact.
template <class T>
double tail_without_interpolation(const CollisionSetup& setup, const StoppingCurve& curve,
                                  const GaussianThresholds& detector, const Contact& contact, double force) {
    const LinePath& path = curve.path;
    const int ticks = path.ticks;
    const QuadratureSettings settings{contact};
    const PreContactAlarms before(setup, detector, ticks);
    OffsetMesh mesh(setup, detector, before);
    mesh.build(path, settings, true);
    const int order = mesh.order();
    const GaussRule& rule = gauss_rule(order);
    const double end = path.max_distance(mesh.end_step()), braking = path.max_braking_distance(),
                 depth = force / contact.body.stiffness;
    std::vector<double> reach = curve.max_distance;
    reach.push_back(braking);
    std::vector<OffsetPanel> panels = mesh.panels();
    mesh.add_end_panels(mesh.edges().back(), *std::max_element(reach.begin(), reach.end()), ticks + 1, panels);
    if (path.rests()) reach.push_back(end);
    panels = detail::cut_at_reaches(panels, reach, depth);
    const auto by = [&](const auto& alarms) {
        DetectionIntegrator<T, std::decay_t<decltype(alarms)>> integrator(setup, detector, before, alarms,
                                                                          negligible_tail);
        integrator.begin(path, mesh, contact.body.stiffness * std::max(0.0, mesh.edges().back()));
        ClampedContact<T> clamped(contact.body.stiffness);
        DetectionProbabilities found;
        double total = 0;
        // Each detection exceeds the depth at all offsets of a panel, or at none.
        for (const OffsetPanel& panel : panels) {
            const double half = 0.5 * (panel.high - panel.low), mid = 0.5 * (panel.low + panel.high);
            const bool fixed = panel.high == panel.low;
            // At a cut rounding decides; a fixed offset is moved off it.
            const double place = fixed ? mid * (1 + 1e-15) : panel.high;
            const auto exceeds = [&](double distance) { return distance - depth >= place; };
            found.begin(1);
            integrator.find(clamped, panel, order, 0, found);
            // The same at all nodes: alarms before contact, and braking at the end of the line.
            double anywhere = panel.tick > ticks && exceeds(braking) ? before.survival_before(ticks) : 0;
            for (int k = before.unarmed(); k < std::min(panel.tick, ticks); ++k)
                if (exceeds(curve.max_distance[std::size_t(k)]))
                    anywhere += before.survival_before(k) * before.no_contact(k).alarm;
            const double survival = panel.tick > ticks ? 0 : before.survival_before(panel.tick);
            for (int g = 0; g < order; ++g) {
                double here = path.rests() && exceeds(end) ? found.survived[std::size_t(g)] : 0;
                for (int slot = 0; slot < found.panel[0].slots; ++slot)
                    if (exceeds(curve.max_distance[std::size_t(panel.tick + slot)]))
                        here += found.detected[std::size_t(slot * order + g)];
                const double density =
                    fixed ? 0.5 : contact.offset.density(mid + half * rule.node[std::size_t(g)]) * half;
                total += rule.weight[std::size_t(g)] * density * (anywhere + survival * here);
            }
        }
        return total;
    };
    return detector.correlated_noise() ? by(CorrelatedAlarms<T>(detector, before)) : by(ExactAlarms<T>(detector));
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
