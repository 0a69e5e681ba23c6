// Peak forces foretold from the pose.
#include "bumpstop/study/foretold_force.hpp"

#include "interrupt.hpp"
#include "setup.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using L = NativeLanes;

ForetoldScenario make_scenario(const Setup& setup, const ThresholdDetector& detector, double stiffness,
                               const std::string& offset_kind, double offset_size, double quantile) {
    const double step = setup.motion.step;
    const OffsetDistribution offset = offset_distribution(offset_kind, offset_size);
    ForetoldScenario scenario;
    scenario.arm = {setup.chain, setup.motion, setup.contact, setup.timing.from_rest};
    scenario.detector = detector;
    scenario.reverse = setup.reaction == ReactionKind::reverse;
    scenario.period = setup.timing.period * step;
    scenario.latency = setup.timing.latency * step;
    scenario.duration = setup.timing.steps * step;
    scenario.stiffness = stiffness;
    scenario.offset_kind = offset.kind;
    scenario.offset_size = offset.size;
    scenario.quantile = quantile;
    return scenario;
}

nb::dict foretell(const ForetoldScenario& scenario, Matrix q, Matrix velocity) {
    const std::size_t n = q.shape(0);
    NewArray<double> expected({n}), bound({n}), unnoticed({n}), gain({n}), stopping({n}), approach({n});
    NewArray<std::int64_t> trigger({n});
    NewArray<bool> trusted({n});
    if (n > 0) {
        const Unlocked unlocked;
        constexpr double infinite = std::numeric_limits<double>::infinity();
        const auto force = [](double x) { return x < unbounded_force || std::isnan(x) ? x : infinite; };
        foretell_forces<L>(scenario, int(n), q.data(), velocity.data(), [&](int i, const Foretold<double>& found) {
            expected.data[i] = force(found.expected);
            bound.data[i] = force(found.bound);
            unnoticed.data[i] = force(found.unnoticed);
            gain.data[i] = found.gain;
            stopping.data[i] = found.stopping;
            approach.data[i] = found.approach;
            trigger.data[i] = std::int64_t(found.trigger);
            trusted.data[i] = found.trusted > 0.5;
        });
    }
    nb::dict out;
    out["expected"] = expected.release();
    out["bound"] = bound.release();
    out["unnoticed"] = unnoticed.release();
    out["trigger"] = trigger.release();
    out["gain"] = gain.release();
    out["stopping"] = stopping.release();
    out["trusted"] = trusted.release();
    out["approach"] = approach.release();
    return out;
}

nb::tuple braking(const ForetoldScenario& scenario, Vector q, Vector velocity, double time) {
    double pose[max_joints];
    for (int j = 0; j < scenario.arm.chain.dof; ++j) pose[j] = q(j);
    const Point3<double> v{velocity(0), velocity(1), velocity(2)};
    const auto start = detail::start_of_case<double>(scenario, pose, v);
    ArmAhead<double, detail::many_steps> path;
    path.follow(scenario.arm, start.at, start.normal, start.velocity, time + scenario.latency);
    const BrakingAhead<double> found = braking_ahead(path, time, scenario.latency, scenario.reverse);
    return nb::make_tuple(found.travel, found.most, found.bent);
}

nb::tuple notice_ramp(const ThresholdDetector& detector, Vector torque, double per_tick, double rarest, bool cautious) {
    double own[max_joints];
    for (int w = 0; w < detector.watched; ++w)
        own[w] = cautious ? std::fabs(torque(detector.joint[w])) : torque(detector.joint[w]);
    const auto felt = [&](double force, int w) { return force * own[w]; };
    const auto feel = [&](double force, double* residual) {
        for (int w = 0; w < detector.watched; ++w) residual[w] = force * own[w];
    };
    const auto found =
        notice(detector, felt, feel, own, per_tick, normal_upper_quantile(std::min(rarest, 0.5)), cautious);
    return nb::make_tuple(found.mean(), found.worst(rarest),
                          array_of({found.silence, found.silence + noticing_points}, {std::size_t(noticing_points)}));
}

}  // namespace

void bind_foretold_force(nb::module_& module) {
    nb::class_<ForetoldScenario>(module, "ForetoldScenario", "All but pose and velocity of cases that are foretold.")
        .def(
            "__init__",
            [](ForetoldScenario* self, const Setup& setup, const ThresholdDetector& detector, double stiffness,
               const std::string& offset_kind, double offset_size, double quantile) {
                new (self)
                    ForetoldScenario(make_scenario(setup, detector, stiffness, offset_kind, offset_size, quantile));
            },
            nb::kw_only(), nb::arg("setup"), nb::arg("detector"), nb::arg("stiffness"), nb::arg("offset_kind"),
            nb::arg("offset_size"), nb::arg("quantile"))
        .def("foretell", &foretell, nb::arg("q"), nb::arg("velocity"),
             "Expected force, bound and the rest (N,), from poses (N, dof) and velocities (N, 3).")
        .def("braking", &braking, nb::arg("q"), nb::arg("velocity"), nb::arg("time"),
             "Expected travel, greatest travel [m] and bend of the reaction to a tick.");
    module.def("notice_ramp", &notice_ramp, nb::arg("detector"), nb::arg("torque"), nb::arg("per_tick"),
               nb::arg("rarest"), nb::arg("cautious"),
               "Mean force at detection, the force rarely passed, and the silence at 33 forces.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
