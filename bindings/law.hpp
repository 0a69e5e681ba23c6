// A distribution as Python holds it.
#pragma once

#include <string>

#include "bumpstop/collision/distribution/offset_quadrature.hpp"
#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct Law {
    CollisionDistribution law;
    int dof;

    LinearQuantity& quantity(const std::string& name) {
        if (name == "force_at_detection") return law.force_at_detection;
        if (name == "detection_delay") return law.detection_delay;
        if (name == "end_force") return law.end_force;
        return law.peak_force;
    }
    /// Moments, and thereby quantiles, are had when they are first asked for.
    LinearQuantity& with_moments(const std::string& name) {
        LinearQuantity& found = quantity(name);
        if (!found.has_moments) find_moments<NativeLanes>(law.density, found);
        return found;
    }

    /// Slots as an array has them, the same for all panels: alarms before the first tick in contact, that tick and later
    /// ones, and at last no detection.
    int slots_before() const {
        int before = 0;
        for (const PiecewiseDensity::Panel& panel : law.density.panel)
            for (int i = panel.first_alarm; i < panel.end_alarm; ++i)
                before = std::max(before, panel.first_tick - law.density.alarm[std::size_t(i)].tick);
        return before;
    }
    int slots() const {
        int after = 0;
        for (const PiecewiseDensity::Panel& panel : law.density.panel) after = std::max(after, panel.slots);
        return slots_before() + after + 1;
    }

    /// Values by slot and degree or node: `visit(use)` calls use(slot, panel, values).
    template <class Visit>
    nb::ndarray<nb::numpy, double> dense(Visit visit) const {
        const std::size_t n = law.density.panel.size(), order = std::size_t(law.density.order);
        std::vector<double> out(std::size_t(slots()) * order * n, 0.0);
        visit([&](int slot, std::size_t p, const double* values, auto factor) {
            for (std::size_t l = 0; l < order; ++l)
                out[(std::size_t(slot) * order + l) * n + p] += factor(l) * values[l];
        });
        return array_of(out, {std::size_t(slots()), order, n});
    }
    /// Coefficients of Legendre's polynomials.
    auto coefficients() const {
        const PiecewiseDensity& density = law.density;
        const int before = slots_before(), last = slots() - 1;
        return dense([&](auto use) {
            const auto once = [](std::size_t l) { return double(2 * l + 1); };
            for (std::size_t p = 0; p < density.panel.size(); ++p) {
                const PiecewiseDensity::Panel& panel = density.panel[p];
                for (int slot = 0; slot < panel.slots; ++slot)
                    use(before + slot, p, density.series_of(panel, slot), once);
                if (!density.end_series.empty()) use(last, p, density.end_series_of(p), once);
                for (int i = panel.first_alarm; i < panel.end_alarm; ++i) {
                    const PreContactAlarm& alarm = density.alarm[std::size_t(i)];
                    use(before + alarm.tick - panel.first_tick, p, density.offset_series_of(p),
                        [&](std::size_t l) { return alarm.chance * double(2 * l + 1); });
                }
            }
        });
    }
    /// Values at nodes, and where nothing is detected.
    auto nodes(const std::vector<double>& by_slot, const std::vector<double>& undetected) const {
        const PiecewiseDensity& density = law.density;
        const std::size_t order = std::size_t(density.order);
        return dense([&](auto use) {
            const auto as_is = [](std::size_t) { return 1.0; };
            for (std::size_t p = 0; p < density.panel.size() && !by_slot.empty(); ++p)
                for (int slot = 0; slot < density.panel[p].slots; ++slot)
                    use(slot, p, &by_slot[(density.panel[p].first_slot + std::size_t(slot)) * order], as_is);
            for (std::size_t p = 0; p * order < undetected.size(); ++p)
                use(slots() - 1, p, &undetected[p * order], as_is);
        });
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
