// Distributions of collisions.
#include "bumpstop/collision/distribution/density_arrays.hpp"
#include "bumpstop/collision/integrate.hpp"
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
                const auto found = unlocked([&] { return tails<L>(self.density, of, y.data(), y.shape(0)); });
                return array_of(found, {y.shape(0), 2});
            },
            nb::arg("quantity"), nb::arg("y"), "P(quantity > y) and its density at each y >= 0.")
        .def(
            "upper_quantile",
            [](Distribution& self, const std::string& name, double allowed, double never) {
                const LinearQuantity& of = with_moments(self, name);
                return unlocked([&] { return upper_quantile<L>(self.density, of, allowed, never); });
            },
            nb::arg("quantity"), nb::arg("allowed"), nb::arg("never"))
        .def_prop_ro("slots_before",
                     [](const Distribution& self) { return DensityArrays(self.density).slots_before(); })
        .def_prop_ro(
            "coefficients",
            [](const Distribution& self) {
                const DensityArrays arrays(self.density);
                return array_of(arrays.coefficients(), {std::size_t(arrays.slots()), arrays.order(), arrays.panels()});
            },
            owned)
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
