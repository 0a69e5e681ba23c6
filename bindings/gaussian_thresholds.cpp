// Thresholds that residuals are compared with.
#include "bumpstop/detection/gaussian_thresholds.hpp"

#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

void bind_threshold(nb::module_& module) {
    nb::class_<GaussianThresholds>(module, "Detector", "Thresholds and white noise per joint.")
        .def(
            "__init__",
            [](GaussianThresholds* self, Vector threshold, Vector sd, Vector mean, double arming_delay,
               double correlation, double filter) {
                new (self) GaussianThresholds();
                for (std::size_t j = 0; j < threshold.shape(0); ++j) {
                    self->noise_sd[j] = sd(j);
                    self->noise_mean[j] = mean(j);
                    if (std::isfinite(threshold(j))) self->watch(int(j), threshold(j), sd(j), mean(j));
                }
                self->arming_delay = arming_delay;
                self->correlation = correlation;
                self->filter = filter;
            },
            nb::arg("threshold"), nb::arg("sd"), nb::arg("mean"), nb::arg("arming_delay"), nb::arg("correlation"),
            nb::arg("filter"))
        .def(
            "alarm_probability",
            [](const GaussianThresholds& self, Vector torque) {
                const auto chance = any_alarm<double>(self, [&](int w) { return torque(self.joint[w]); });
                return nb::make_tuple(chance.alarm, chance.silent);
            },
            nb::arg("torque"), "Probability that a tick with these noiseless residuals alarms, and its complement.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
