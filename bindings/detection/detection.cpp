// The detector over the rows of a recording, and tick by tick.
#include <nanobind/stl/pair.h>

#include "bumpstop/detection/detector_description.hpp"
#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

void store_row(const std::array<double, max_joints>& values, NewArray<double>& out, std::size_t row) {
    const std::size_t width = out.shape[1];
    for (std::size_t j = 0; j < width; ++j) out.data[row * width + j] = values[j];
}

// An alarm is taken as dealt with once every residual has been below its threshold for `rearm` seconds. Where the detector
// has no data no residual is known to be below its threshold, and the time of such a row may be none or one long past:
// the first tick that is judged again begins anew.
class Rearming {
  public:
    explicit Rearming(double after) : after_(after) {}
    bool over(double t, bool alarm, bool loud) {
        if (!alarm || loud) {
            quiet_ = t;
            judged_ = alarm;
            return false;
        }
        if (!judged_) quiet_ = t;
        judged_ = true;
        return t - quiet_ >= after_;
    }

  private:
    double after_, quiet_ = -std::numeric_limits<double>::infinity();
    bool judged_ = false;
};

nb::tuple run(Detector& detector, Vector t, Matrix q, Matrix signal, std::optional<Matrix> qd, double rearm) {
    const std::size_t rows = t.shape(0), width = std::size_t(detector.joints());
    NewArray<double> residual({rows, width}), fast({rows, width}), threshold({rows, width});
    NewArray<std::uint8_t> state({rows}), fault({rows}), flags({rows});
    std::vector<DetectorEvent> events;
    {
        nb::gil_scoped_release unlocked;
        Rearming rearming(rearm);
        DetectorSample sample;
        for (std::size_t i = 0; i < rows; ++i) {
            sample.t = t(i);
            for (std::size_t j = 0; j < width; ++j) {
                sample.q[j] = q(i, j);
                sample.signal[j] = signal(i, j);
                if (qd) sample.qd[j] = (*qd)(i, j);
            }
            const long before = detector.events();
            const DetectorOutput& out = detector.update(sample);
            if (detector.events() != before) {
                events.push_back(detector.event());
            } else if ((out.over | out.over_fast) != 0 && !events.empty()) {
                events.back().span = detector.event().span;
            }
            store_row(out.residual, residual, i);
            store_row(out.fast, fast, i);
            store_row(out.threshold, threshold, i);
            state.data[i] = std::uint8_t(out.state);
            fault.data[i] = std::uint8_t(out.fault);
            flags.data[i] =
                std::uint8_t(out.stop | out.late << 1 | out.masked_while_arming << 2 | out.payload_changed << 3);
            if (rearming.over(out.t, out.state == DetectorState::alarm, (out.over | out.over_fast) != 0))
                detector.acknowledge();
        }
    }
    return nb::make_tuple(residual.release(), fast.release(), threshold.release(), state.release(), fault.release(),
                          flags.release(), events);
}

// The same for residuals that come from elsewhere. Before rows whose `anew` is not 0 there were some without data. `events` are
// rows.
nb::tuple run_alarm_logic(const AlarmSettings& settings, Vector t, Matrix residual, Matrix qd, Matrix qdd, Vector anew,
                          double rearm) {
    const std::size_t rows = t.shape(0), width = residual.shape(1);
    NewArray<double> fast({rows, width}), threshold({rows, width});
    NewArray<std::uint8_t> state({rows}), masked({rows});
    std::vector<std::size_t> events;
    std::vector<std::uint32_t> over, over_fast;
    std::vector<EventSpan> spans;
    {
        nb::gil_scoped_release unlocked;
        AlarmLogic logic(settings, int(width));
        Rearming rearming(rearm);
        for (std::size_t i = 0; i < rows; ++i) {
            const double dt = i > 0 ? t(i) - t(i - 1) : 0;
            if (anew(i) != 0) {
                logic.interrupt();
                rearming.over(t(i), false, false);
            }
            std::array<double, max_joints> r{}, v{}, a{};
            for (std::size_t j = 0; j < width; ++j) {
                r[j] = residual(i, j);
                v[j] = qd(i, j);
                a[j] = qdd(i, j);
            }
            if (logic.update(t(i), dt, r.data(), v.data(), a.data(), nullptr)) {
                events.push_back(i);
                over.push_back(logic.over());
                over_fast.push_back(logic.over_fast());
                spans.emplace_back().start(t(i), r.data(), logic.threshold(), int(width));
            } else if (logic.over_armed()) {
                spans.back().extend(t(i), r.data(), logic.threshold(), int(width));
            }
            std::copy(logic.fast(), logic.fast() + width, &fast.data[i * width]);
            std::copy(logic.threshold(), logic.threshold() + width, &threshold.data[i * width]);
            state.data[i] = std::uint8_t(logic.state());
            masked.data[i] = logic.masked_while_arming();
            if (rearming.over(t(i), logic.state() == DetectorState::alarm, (logic.over() | logic.over_fast()) != 0))
                logic.acknowledge();
        }
    }
    return nb::make_tuple(fast.release(), threshold.release(), state.release(), masked.release(), events, over,
                          over_fast, spans);
}

// The settings give the noise of the residual, the contact point and the direction.
ContactEstimate contact_of(const Chain& chain, const DetectorSettings& settings, Vector q, Vector residual,
                           Vector hidden) {
    JointAngles<double> angle{};
    angle.set(chain, q.data());
    Posture<double> posture{};
    forward_kinematics(chain, q.data(), angle, posture);
    const auto noise = contact_noise(chain.dof, residual.data(), settings.noise_sd.data(), hidden.data());
    return estimate_contact(chain, posture, residual.data(), noise.data(), settings.contact, settings.direction);
}

template <class T>
std::vector<double> first_of(const T& values, int count) {
    return {values.begin(), values.begin() + count};
}

void bind_description(nb::module_& module) {
    using Description = DetectorDescription;
    const auto joints = [](const Description& self, auto member) {
        std::vector<std::string> names;
        for (const auto& joint : self.robot.joints) names.push_back(joint.*member);
        return names;
    };
    nb::class_<Description>(module, "DetectorDescription", "What a detector's file says.")
        .def_prop_ro("robot", [](const Description& self) { return self.robot.name; })
        .def_prop_ro("tip_name", [](const Description& self) { return self.robot.tip_name; })
        .def_prop_ro("tip_origin", [](const Description& self) { return self.robot.tip_origin; })
        .def_prop_ro("contact_link", [](const Description& self) { return self.settings.contact.link; })
        .def_prop_ro("contact_point", &Description::contact_point)
        .def_prop_ro("joints",
                     [joints](const Description& self) { return joints(self, &RobotDescription::Joint::name); })
        .def_prop_ro("links",
                     [joints](const Description& self) { return joints(self, &RobotDescription::Joint::link); })
        .def_prop_ro("prismatic",
                     [](const Description& self) {
                         std::vector<bool> found;
                         for (const auto& joint : self.robot.joints) found.push_back(joint.spec.prismatic);
                         return found;
                     })
        .def_prop_ro("constant",
                     [](const Description& self) {
                         return first_of(self.settings.alarm.thresholds.constant, int(self.robot.joints.size()));
                     })
        .def_prop_ro("settings", [](const Description& self) { return self.settings; })
        .def_prop_ro("fitted", [](const Description& self) { return self.fitted.has_value(); })
        .def("detector", &Description::detector, nb::arg("latched") = false);
    module.def(
        "read_detector",
        [](const std::string& text) -> std::pair<std::optional<Description>, std::string> {
            std::istringstream in(text);
            std::string error;
            auto found = read_detector(in, error);
            return {std::move(found), error};
        },
        nb::arg("text"), "What a detector's file says, or none and why.");
}

}  // namespace

void bind_detection(nb::module_& module) {
    nb::enum_<ResidualKind>(module, "ResidualKind")
        .value("direct", ResidualKind::direct)
        .value("observer", ResidualKind::observer);
    nb::enum_<TorqueSource>(module, "TorqueSource")
        .value("current", TorqueSource::current)
        .value("torque", TorqueSource::torque);
    nb::enum_<DetectorState>(module, "DetectorState")
        .value("no_data", DetectorState::no_data)
        .value("arming", DetectorState::arming)
        .value("monitoring", DetectorState::monitoring)
        .value("alarm", DetectorState::alarm);
    nb::enum_<SampleFault>(module, "SampleFault")
        .value("none", SampleFault::none)
        .value("filling", SampleFault::filling)
        .value("not_finite", SampleFault::not_finite)
        .value("repeated", SampleFault::repeated)
        .value("out_of_order", SampleFault::out_of_order)
        .value("gap", SampleFault::gap)
        .value("outside_limits", SampleFault::outside_limits)
        .value("impossible_jump", SampleFault::impossible_jump)
        .value("impossible_signal", SampleFault::impossible_signal)
        .value("frozen", SampleFault::frozen);
    bind_detector_settings(module);
    nb::class_<ContactEstimate>(module, "ContactEstimate", "What a residual says of a contact.")
        .def_ro("link", &ContactEstimate::link)
        .def_ro("possible", &ContactEstimate::possible)
        .def_ro("force_along", &ContactEstimate::force_along)
        .def_ro("force_along_sd", &ContactEstimate::force_along_sd)
        .def_ro("force", &ContactEstimate::force)
        .def_ro("force_sd", &ContactEstimate::force_sd)
        .def_ro("leftover", &ContactEstimate::leftover)
        .def_ro("misfit", &ContactEstimate::misfit);
    nb::class_<EventSpan>(module, "EventSpan", "How long an event lasts, and how large its residuals get.")
        .def_ro("begin", &EventSpan::begin)
        .def_ro("end", &EventSpan::end)
        .def_ro("largest", &EventSpan::largest)
        .def_ro("largest_share", &EventSpan::largest_share)
        .def_ro("largest_time", &EventSpan::largest_time)
        .def_ro("largest_joint", &EventSpan::largest_joint);
    nb::class_<DetectorEvent>(module, "DetectorEvent", "An alarm.")
        .def_ro("t", &DetectorEvent::t)
        .def_ro("over", &DetectorEvent::over)
        .def_ro("over_fast", &DetectorEvent::over_fast)
        .def_ro("residual", &DetectorEvent::residual)
        .def_ro("threshold", &DetectorEvent::threshold)
        .def_ro("q", &DetectorEvent::q)
        .def_ro("span", &DetectorEvent::span)
        .def_ro("hidden", &DetectorEvent::hidden)
        .def_ro("contact", &DetectorEvent::contact)
        .def_ro("payload_changed", &DetectorEvent::payload_changed)
        .def_ro("payload_change", &DetectorEvent::payload_change);
    nb::class_<DetectorOutput>(module, "DetectorOutput", "Of one tick.")
        .def_ro("state", &DetectorOutput::state)
        .def_ro("fault", &DetectorOutput::fault)
        .def_ro("stop", &DetectorOutput::stop)
        .def_ro("late", &DetectorOutput::late)
        .def_ro("masked_while_arming", &DetectorOutput::masked_while_arming)
        .def_ro("payload_changed", &DetectorOutput::payload_changed)
        .def_ro("t", &DetectorOutput::t)
        .def_ro("over", &DetectorOutput::over)
        .def_ro("over_fast", &DetectorOutput::over_fast)
        .def_ro("residual", &DetectorOutput::residual)
        .def_ro("fast", &DetectorOutput::fast)
        .def_ro("threshold", &DetectorOutput::threshold)
        .def_ro("qd", &DetectorOutput::qd)
        .def_ro("qdd", &DetectorOutput::qdd);
    nb::class_<Detector>(module, "LoopDetector", "The detector of a control loop.")
        .def(nb::init<const Chain&, const std::vector<LinkInertia>&, const std::vector<JointTorqueParameters>&,
                      const std::vector<JointTorqueErrors>&, const DetectorSettings&,
                      const std::optional<FittedDynamics>&>(),
             nb::arg("chain"), nb::arg("links"), nb::arg("joints"), nb::arg("errors"), nb::arg("settings"),
             nb::arg("fitted") = nb::none())
        .def("run", &run, nb::arg("t"), nb::arg("q"), nb::arg("signal"), nb::arg("qd").none(), nb::arg("rearm"),
             "Residuals, band-pass channel and thresholds (N, n), state, fault and flags (N,), events.")
        .def(
            "update",
            [](Detector& self, double t, Vector q, Vector signal, Vector qd) {
                DetectorSample sample;
                sample.t = t;
                for (int j = 0; j < self.joints(); ++j) {
                    sample.q[j] = q(j);
                    sample.signal[j] = signal(j);
                    sample.qd[j] = qd(j);
                }
                return self.update(sample);
            },
            nb::arg("t"), nb::arg("q"), nb::arg("signal"), nb::arg("qd"), "Judges a sample.")
        .def("overdue", &Detector::overdue, nb::arg("now"))
        .def("acknowledge", &Detector::acknowledge)
        .def("reset", &Detector::reset)
        .def("set_payload", &Detector::set_payload, nb::arg("payload"))
        .def("payload_change", [](const Detector& self) { return self.payload().change(); })
        .def_prop_ro("events", &Detector::events)
        .def("event", &Detector::event);
    bind_description(module);
    module.attr("sample_faults") = sample_faults;
    module.attr("detector_states") = detector_states;
    module.def("run_alarm_logic", &run_alarm_logic, nb::arg("settings"), nb::arg("t"), nb::arg("residual"),
               nb::arg("qd"), nb::arg("qdd"), nb::arg("anew"), nb::arg("rearm"),
               "Band-pass channel and thresholds (N, n), state and masked (N,), rows of events, joints, spans.");
    module.def("estimate_contact", &contact_of, nb::arg("chain"), nb::arg("settings"), nb::arg("q"),
               nb::arg("residual"), nb::arg("hidden"),
               "What a residual says of a contact: the settings give its noise, the contact point and the direction.");
    module.def("dead_zone", &dead_zone, nb::arg("joint"), nb::arg("current"), "Torque hidden at standstill [Nm].");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
