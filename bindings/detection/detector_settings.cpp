// What a detector is told beside its robot: limits, thresholds, payload, fitted dynamics.
#include "bumpstop/detection/detector_description.hpp"
#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

void bind_fitted(nb::module_& module) {
    nb::class_<FittedMotor>(module, "FittedMotor", "What a motor adds to the torque of its joints.")
        .def(nb::init<>())
        .def_rw("share", &FittedMotor::share)
        .def_rw("sign_speed", &FittedMotor::sign_speed)
        .def_rw("coulomb", &FittedMotor::coulomb)
        .def_rw("viscous", &FittedMotor::viscous)
        .def_rw("rotor", &FittedMotor::rotor)
        .def_rw("offset", &FittedMotor::offset)
        .def_rw("bend", &FittedMotor::bend)
        .def_rw("top_speed", &FittedMotor::top_speed)
        .def_rw("load", &FittedMotor::load)
        .def_rw("presliding", &FittedMotor::presliding);
    nb::class_<FittedDynamics>(module, "FittedDynamics", "Fitted dynamics, sample by sample.")
        .def(nb::init<>())
        .def_rw("by_all", &FittedDynamics::by_all)
        .def_rw("gain", &FittedDynamics::gain)
        .def_ro("motors", &FittedDynamics::motors)
        .def(
            "set",
            [](FittedDynamics& self, bool essential, const std::vector<LinkInertia>& links,
               const std::vector<FittedMotor>& motors) {
                FittedParameters& own = essential ? self.essential : self.all;
                std::copy_n(links.begin(), std::min(links.size(), own.link.size()), own.link.begin());
                std::copy_n(motors.begin(), std::min(motors.size(), own.motor.size()), own.motor.begin());
                self.motors = int(std::min(motors.size(), own.motor.size()));
            },
            nb::arg("essential"), nb::arg("links"), nb::arg("motors"), "One of the two sets of parameters.");
    module.attr("max_motors") = FittedParameters::max_motors;
}

}  // namespace

void bind_detector_settings(nb::module_& module) {
    bind_fitted(module);
    nb::class_<JointTorqueErrors>(module, "JointTorqueErrors",
                                  "Standard errors of one joint, in the units of the header.")
        .def(nb::init<>())
        .def_rw("A", &JointTorqueErrors::A)
        .def_rw("B", &JointTorqueErrors::B)
        .def_rw("D", &JointTorqueErrors::D)
        .def_rw("F", &JointTorqueErrors::F)
        .def_rw("coulomb", &JointTorqueErrors::coulomb)
        .def_rw("viscous", &JointTorqueErrors::viscous)
        .def_rw("stribeck", &JointTorqueErrors::stribeck)
        .def_rw("stribeck_speed", &JointTorqueErrors::stribeck_speed)
        .def_rw("load", &JointTorqueErrors::load)
        .def_rw("hysteresis", &JointTorqueErrors::hysteresis)
        .def_rw("inertia", &JointTorqueErrors::inertia)
        .def_rw("friction", &JointTorqueErrors::friction);
    nb::class_<SampleLimits>(module, "SampleLimits", "What a sample may be.")
        .def(nb::init<>())
        .def_rw("period", &SampleLimits::period)
        .def_rw("shortest_interval", &SampleLimits::shortest_interval)
        .def_rw("late_interval", &SampleLimits::late_interval)
        .def_rw("longest_interval", &SampleLimits::longest_interval)
        .def_rw("resolution", &SampleLimits::resolution)
        .def_rw("lower", &SampleLimits::lower)
        .def_rw("upper", &SampleLimits::upper)
        .def_rw("velocity", &SampleLimits::velocity)
        .def_rw("signal", &SampleLimits::signal)
        .def_rw("measured_rates", &SampleLimits::measured_rates)
        .def_rw("frozen_time", &SampleLimits::frozen_time)
        .def_rw("unmonitored", &SampleLimits::unmonitored)
        .def_rw("endless", &SampleLimits::endless);
    nb::class_<ThresholdModel>(module, "ThresholdModel", "Thresholds, constant or growing with motion.")
        .def(nb::init<>())
        .def_rw("constant", &ThresholdModel::constant)
        .def_rw("speed", &ThresholdModel::speed)
        .def_rw("acceleration", &ThresholdModel::acceleration)
        .def_rw("rest", &ThresholdModel::rest)
        .def_rw("rest_speed", &ThresholdModel::rest_speed)
        .def_rw("fast", &ThresholdModel::fast)
        .def_rw("model_errors", &ThresholdModel::model_errors);
    nb::class_<AlarmSettings>(module, "AlarmSettings", "From residuals to alarms.")
        .def(nb::init<>())
        .def_rw("thresholds", &AlarmSettings::thresholds)
        .def_rw("arming_delay", &AlarmSettings::arming_delay)
        .def_rw("rest_time", &AlarmSettings::rest_time)
        .def_rw("low_hz", &AlarmSettings::low_hz)
        .def_rw("high_hz", &AlarmSettings::high_hz)
        .def_rw("event_pause", &AlarmSettings::event_pause);
    nb::class_<Payload>(module, "Payload", "A point mass on the last link.")
        .def(nb::init<>())
        .def_rw("mass", &Payload::mass)
        .def_rw("center", &Payload::center);
    nb::class_<PayloadMonitorSettings>(module, "PayloadMonitorSettings", "When a payload counts as changed.")
        .def(nb::init<>())
        .def_rw("window", &PayloadMonitorSettings::window)
        .def_rw("interval", &PayloadMonitorSettings::interval)
        .def_rw("min_mass", &PayloadMonitorSettings::min_mass)
        .def_rw("min_share", &PayloadMonitorSettings::min_share)
        .def_rw("min_change", &PayloadMonitorSettings::min_change);
    nb::class_<DetectorSettings>(module, "DetectorSettings", "Everything the detector is told beside robot and model.")
        .def(nb::init<>())
        .def_rw("residual", &DetectorSettings::residual)
        .def_rw("source", &DetectorSettings::source)
        .def_rw("observer_gain", &DetectorSettings::observer_gain)
        .def_rw("window", &DetectorSettings::window)
        .def_rw("degree", &DetectorSettings::degree)
        .def_rw("gravity", &DetectorSettings::gravity)
        .def_rw("samples", &DetectorSettings::samples)
        .def_rw("alarm", &DetectorSettings::alarm)
        .def_rw("max_no_data_time", &DetectorSettings::max_no_data_time)
        .def_rw("unknown", &DetectorSettings::unknown)
        .def_rw("noise_sd", &DetectorSettings::noise_sd)
        .def_rw("dead_zone", &DetectorSettings::dead_zone)
        .def_rw("direction", &DetectorSettings::direction)
        .def_rw("payload", &DetectorSettings::payload)
        .def_rw("payload_monitor", &DetectorSettings::payload_monitor)
        .def(
            "set_contact",
            [](DetectorSettings& self, const Chain& chain, int link, const Vector3& point) {
                self.contact = link_point(chain, link, point);
            },
            nb::arg("chain"), nb::arg("link"), nb::arg("point"), "Where the force of an event is given.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
