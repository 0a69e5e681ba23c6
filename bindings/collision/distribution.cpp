// Distributions of collisions.
#include "bumpstop/collision/collision.hpp"
#include "common.hpp"
#include "interrupt.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using L = NativeLanes;

LinearQuantity& quantity(CollisionDistribution& self, const std::string& name) {
    if (name == "force_at_detection") return self.force_at_detection;
    if (name == "detection_delay") return self.detection_delay;
    if (name == "end_force") return self.end_force;
    return self.peak_force;
}

// Moments, and thereby quantiles, are had when they are first asked for.
LinearQuantity& with_moments(CollisionDistribution& self, const std::string& name) {
    LinearQuantity& found = quantity(self, name);
    if (!found.has_moments) find_moments<L>(self.density, found);
    return found;
}

// The slots of every panel in an array are alike: alarms before the first tick in contact, that tick and later ones,
// and at last no detection.
struct ArraySlots {
    explicit ArraySlots(const PiecewiseDensity& density) {
        for (const PiecewiseDensity::Panel& panel : density.panel) {
            for (int i = panel.first_alarm; i < panel.end_alarm; ++i)
                before = std::max(before, panel.first_tick - density.alarm[std::size_t(i)].tick);
            after = std::max(after, panel.slots);
        }
    }
    int before = 0, after = 0;
};

// Coefficients of Legendre's polynomials, [slot][degree][panel].
auto coefficients(const PiecewiseDensity& density) {
    const ArraySlots slots(density);
    const std::size_t count = std::size_t(slots.before + slots.after + 1), order = std::size_t(density.order),
                      panels = density.panel.size();
    std::vector<double> out(count * order * panels, 0.0);
    const auto add = [&](int slot, std::size_t p, const double* series, double factor) {
        for (std::size_t l = 0; l < order; ++l)
            out[(std::size_t(slot) * order + l) * panels + p] += factor * double(2 * l + 1) * series[l];
    };
    for (std::size_t p = 0; p < panels; ++p) {
        const PiecewiseDensity::Panel& panel = density.panel[p];
        for (int slot = 0; slot < panel.slots; ++slot) add(slots.before + slot, p, density.series_of(panel, slot), 1);
        if (!density.end_series.empty()) add(int(count) - 1, p, density.end_series_of(p), 1);
        for (int i = panel.first_alarm; i < panel.end_alarm; ++i) {
            const PreContactAlarm& alarm = density.alarm[std::size_t(i)];
            add(slots.before + alarm.tick - panel.first_tick, p, density.offset_series_of(p), alarm.chance);
        }
    }
    return array_of(out, {count, order, panels});
}

template <class Scalar, class Of>
auto panels(const CollisionDistribution& self, Of of) {
    NewArray<Scalar> out({self.density.panel.size()});
    std::transform(self.density.panel.begin(), self.density.panel.end(), out.data.get(), of);
    return out.release();
}

}  // namespace

void bind_distribution(nb::module_& module) {
    // A property's array owns its memory; nanobind would tie it to the object.
    constexpr auto owned = nb::rv_policy::automatic;
    using Distribution = CollisionDistribution;
    nb::class_<Distribution>(module, "CollisionDistribution", "The distribution of a collision over offset and noise.")
        .def_ro("false_alarm", &Distribution::false_alarm)
        .def_ro("zero_force", &Distribution::zero_force)
        .def_ro("undetected", &Distribution::undetected)
        .def_ro("rests", &Distribution::rests,
                "The arm comes to rest where its path ends: collisions never detected have a force, and count with it.")
        .def_ro("no_contact", &Distribution::no_contact)
        .def_ro("multi_joint", &Distribution::multi_joint)
        .def_ro("interpolated", &Distribution::interpolated)
        .def_prop_ro("trigger", [](const Distribution& self) { return view(self.trigger, {max_joints}); })
        .def(
            "total", [](Distribution& self, const std::string& name) { return quantity(self, name).total; },
            nb::arg("quantity"))
        .def(
            "moments",
            [](Distribution& self, const std::string& name) {
                const Moments m = name == "peak_force" ? self.moments() : with_moments(self, name).moments;
                return nb::make_tuple(m.mean, m.sd);
            },
            nb::arg("quantity"), "Mean and sd; of the peak force over all collisions.")
        .def(
            "tail",
            [](Distribution& self, const std::string& name, Vector y) {
                const LinearQuantity& of = quantity(self, name);
                NewArray<double> out({y.shape(0), 2});
                unlocked([&] {
                    for (std::size_t i = 0; i < y.shape(0); ++i) {
                        const TailAt at = tail<L>(self.density, of, y(i));
                        out.data[2 * i] = at.probability;
                        out.data[2 * i + 1] = at.density;
                    }
                });
                return out.release();
            },
            nb::arg("quantity"), nb::arg("y"), "P(quantity > y) and its density at each y >= 0.")
        .def(
            "upper_quantile",
            [](Distribution& self, const std::string& name, double allowed, double never) {
                const LinearQuantity& of = with_moments(self, name);
                return unlocked([&] { return upper_quantile<L>(self.density, of, allowed, never); });
            },
            nb::arg("quantity"), nb::arg("allowed"), nb::arg("never"))
        .def_prop_ro("slots_before", [](const Distribution& self) { return ArraySlots(self.density).before; })
        .def_prop_ro(
            "coefficients", [](const Distribution& self) { return coefficients(self.density); }, owned)
        .def_prop_ro(
            "panel_mid",
            [](const Distribution& self) {
                return panels<double>(self, [](const auto& panel) { return 0.5 * (panel.low + panel.high); });
            },
            owned)
        .def_prop_ro(
            "panel_half",
            [](const Distribution& self) {
                return panels<double>(self, [](const auto& panel) { return 0.5 * (panel.high - panel.low); });
            },
            owned)
        .def_prop_ro(
            "panel_first_tick",
            [](const Distribution& self) {
                return panels<std::int32_t>(self, [](const auto& panel) { return std::int32_t(panel.first_tick); });
            },
            owned);
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
