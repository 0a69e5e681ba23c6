// Exact laws.
#include "interrupt.hpp"
#include "law.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using L = NativeLanes;

template <class Work>
auto unlocked(Work work) {
    const Unlocked here;
    return work();
}

template <class Of>
auto panels(const Law& law, Of of) {
    std::vector<double> out;
    for (const PiecewiseDensity::Panel& panel : law.law.density.panel) out.push_back(of(panel));
    return array_of(out, {out.size()});
}

}  // namespace

void bind_exact_law(nb::module_& module) {
    // A property's array owns its memory; nanobind would tie it to the object.
    constexpr auto owned = nb::rv_policy::automatic;
    nb::class_<Law>(module, "Law", "An exact law.")
        .def_prop_ro("false_alarm", [](const Law& self) { return self.law.false_alarm; })
        .def_prop_ro("harmless", [](const Law& self) { return self.law.harmless; })
        .def_prop_ro("undetected", [](const Law& self) { return self.law.undetected; })
        .def_prop_ro(
            "rests", [](const Law& self) { return self.law.rests; },
            "The arm comes to rest where its path ends: collisions never detected have a force, and count with it.")
        .def_prop_ro("no_contact", [](const Law& self) { return self.law.no_contact; })
        .def_prop_ro("several", [](const Law& self) { return self.law.several; })
        .def_prop_ro("interpolated", [](const Law& self) { return self.law.interpolated; })
        .def_prop_ro(
            "trigger",
            [](const Law& self) {
                const std::size_t n = std::size_t(self.dof);
                return array_of(std::vector<double>(self.law.trigger, self.law.trigger + n), {n});
            },
            owned)
        .def(
            "total", [](Law& self, const std::string& name) { return self.quantity(name).total; }, nb::arg("quantity"))
        .def(
            "moments",
            [](Law& self, const std::string& name) {
                const Moments m = name == "peak_force" ? peak_force_moments(self.law) : self.with_moments(name).moments;
                return nb::make_tuple(m.mean, m.sd);
            },
            nb::arg("quantity"), "Mean and sd; of the peak force over all collisions.")
        .def(
            "tail",
            [](Law& self, const std::string& name, Vector y) {
                NewArray<double> out({y.shape(0), 2});
                unlocked([&] {
                    for (std::size_t i = 0; i < y.shape(0); ++i) {
                        const TailAt at = tail<L>(self.law.density, self.quantity(name), y(i));
                        out.data[2 * i] = at.probability;
                        out.data[2 * i + 1] = at.density;
                    }
                });
                return out.release();
            },
            nb::arg("quantity"), nb::arg("y"), "P(quantity > y) and its density at each y >= 0.")
        .def(
            "upper_quantile",
            [](Law& self, const std::string& name, double allowed, double never) {
                const LinearQuantity& quantity = self.with_moments(name);
                return unlocked([&] { return upper_quantile<L>(self.law.density, quantity, allowed, never); });
            },
            nb::arg("quantity"), nb::arg("allowed"), nb::arg("never"))
        .def(
            "free_nodes",
            [](const Law& self) {
                const ContactNodes& from = self.law.nodes;
                nb::dict out;
                out["peak_force"] = self.nodes(from.peak_force, from.undetected_peak_force);
                out["duration"] = self.nodes(from.duration, from.undetected_duration);
                out["force_at_detection"] = self.nodes(from.force_at_detection, {});
                return out;
            },
            "Free contact: values at the Gauss nodes, (slots, order, panels) [N, s, N].")
        .def(
            "free_alarms",
            [](const Law& self) {
                const EarlyReactions& a = self.law.early_reactions;
                const std::size_t n = a.pieces(), cells = EarlyReactions::cells, nodes = EarlyReactions::nodes;
                nb::dict out;
                out["mass"] = array_of(a.mass, {n, cells});
                out["edge_force"] = array_of(a.edge_force, {n, cells + 1});
                out["edge_duration"] = array_of(a.edge_duration, {n, cells + 1});
                out["node_mass"] = array_of(a.node_mass, {n, nodes});
                out["node_force"] = array_of(a.node_force, {n, nodes});
                out["node_duration"] = array_of(a.node_duration, {n, nodes});
                return out;
            },
            "Free contact: false alarms that still reach the body, tick by tick, in cells of offset and at nodes.")
        .def_prop_ro("slots_before", [](const Law& self) { return self.slots_before(); })
        .def_prop_ro(
            "coefficients", [](const Law& self) { return self.coefficients(); }, owned)
        .def_prop_ro(
            "panel_mid",
            [](const Law& self) { return panels(self, [](const auto& p) { return 0.5 * (p.low + p.high); }); }, owned)
        .def_prop_ro(
            "panel_half",
            [](const Law& self) { return panels(self, [](const auto& p) { return 0.5 * (p.high - p.low); }); }, owned)
        .def_prop_ro(
            "panel_first_tick",
            [](const Law& self) {
                NewArray<std::int32_t> out({self.law.density.panel.size()});
                std::transform(self.law.density.panel.begin(), self.law.density.panel.end(), out.data.get(),
                               [](const auto& panel) { return std::int32_t(panel.first_tick); });
                return out.release();
            },
            owned);
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
