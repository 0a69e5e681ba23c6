// Distributions of many poses at once.
#include "bumpstop/collision/batch.hpp"

#include "common.hpp"
#include "interrupt.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

View<double> rows(const BatchResult& of, const std::vector<double>& values, std::size_t width) {
    return view(values.data(), {of.end.size(), width});
}

}  // namespace

void bind_batch(nb::module_& module) {
    nb::class_<BatchSettings>(module, "BatchSettings", "What is asked of every pose.")
        .def(nb::init<>())
        .def_rw("probability", &BatchSettings::probability)
        .def_rw("limit", &BatchSettings::limit)
        .def_rw("threads", &BatchSettings::threads);
    nb::class_<BatchResult>(module, "BatchResult", "What is kept of every pose, an entry or a row each.")
        .def_prop_ro("mean", [](const BatchResult& self) { return view(self.mean); })
        .def_prop_ro("sd", [](const BatchResult& self) { return view(self.sd); })
        .def_prop_ro(
            "quantile",
            [](const BatchResult& self) { return rows(self, self.quantile, self.settings.probability.size()); })
        .def_prop_ro("exceedance",
                     [](const BatchResult& self) { return rows(self, self.exceedance, self.settings.limit.size()); })
        .def_prop_ro("trigger", [](const BatchResult& self) { return rows(self, self.trigger, self.dof); })
        .def_prop_ro("false_alarm", [](const BatchResult& self) { return view(self.false_alarm); })
        .def_prop_ro("undetected", [](const BatchResult& self) { return view(self.undetected); })
        .def_prop_ro("no_contact", [](const BatchResult& self) { return view(self.no_contact); })
        .def_prop_ro("end", [](const BatchResult& self) { return view(self.end); });
    module.def(
        "evaluate_batch",
        [](const CollisionSetup& setup, const GaussianThresholds& detector, const Contact& contact, Matrix q,
           Matrix velocity, const BatchSettings& settings, std::optional<Vector> pressed_with) {
            return unlocked([&] {
                const double* most = pressed_with ? pressed_with->data() : nullptr;
                return evaluate_batch<NativeLanes>(setup, detector, contact,
                                                   {int(q.shape(0)), q.data(), velocity.data(), most}, settings);
            });
        },
        nb::arg("setup"), nb::arg("detector"), nb::arg("contact"), nb::arg("q"), nb::arg("velocity"),
        nb::arg("settings"), nb::arg("pressed_with") = nb::none(),
        "Of a half-normal or uniform offset the size is in seconds of travel.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
