// How an arm slows down in its reactions.
#include "bumpstop/collision/motion/deceleration.hpp"

#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

void bind_deceleration(nb::module_& module) {
    nb::enum_<DecelerationLaw>(module, "DecelerationLaw")
        .value("constant", DecelerationLaw::constant)
        .value("constant_time", DecelerationLaw::constant_time)
        .value("ramp", DecelerationLaw::ramp)
        .value("table", DecelerationLaw::table);
    nb::class_<StoppingTimes>(module, "StoppingTimes", "Times that joints take to stop, by extension and rate.")
        .def(nb::init<>())
        .def_rw("extension", &StoppingTimes::extension)
        .def_rw("rate", &StoppingTimes::rate)
        .def_rw("time", &StoppingTimes::time)
        .def_rw("reach", &StoppingTimes::reach)
        .def("at", &StoppingTimes::at, nb::arg("joint"), nb::arg("extended"), nb::arg("speed"),
             "Of a joint, counted from 0, that moves at a rate [rad/s or m/s], in s.");
    nb::class_<Deceleration>(module, "Deceleration", "How the arm slows down in its reactions.")
        .def(nb::init<>())
        .def_rw("law", &Deceleration::law)
        .def_rw("stopping_time", &Deceleration::stopping_time)
        .def_rw("ramp_time", &Deceleration::ramp_time)
        .def_rw("independent", &Deceleration::independent)
        .def_rw("times", &Deceleration::times);
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
