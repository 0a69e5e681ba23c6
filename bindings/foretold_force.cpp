// Peak forces foretold from the pose.
#include "bumpstop/study/foretold_force.hpp"

#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using L = NativeLanes;

Vector3 vector3(Vector v) { return {v(0), v(1), v(2)}; }

WatchedJoints watched_joints(Vector threshold, Vector sd, Vector mean, bool remembers) {
    WatchedJoints watched;
    watched.remembers = remembers;
    for (std::size_t j = 0; j < threshold.shape(0); ++j) {
        if (!std::isfinite(threshold(j))) continue;
        const int w = watched.count++;
        watched.joint[w] = int(j);
        watched.threshold[w] = threshold(j);
        watched.sd[w] = sd(j);
        watched.mean[w] = mean(j);
    }
    return watched;
}

ForetoldScenario make_scenario(const Chain& chain, int tip_link, Vector tip_point, int task_rows,
                               const std::vector<int>& free_joints, double damping, double step, int substeps,
                               Vector acceleration, Vector velocity, Vector lower, Vector upper, int contact_link,
                               Vector contact_point, std::optional<Vector> normal, int steps, int period, int latency,
                               bool from_rest, bool reverse, Vector threshold, Vector sd, Vector mean, bool remembers,
                               double observer_memory, double stiffness, const std::string& offset_kind,
                               double offset_size, double quantile) {
    ForetoldScenario scenario;
    ArmOnLine& arm = scenario.arm;
    arm.chain = chain;
    arm.motion.tip = link_point(chain, tip_link, vector3(tip_point));
    arm.motion.task_rows = task_rows;
    arm.motion.free_count = int(free_joints.size());
    std::copy(free_joints.begin(), free_joints.end(), arm.motion.free_joint.begin());
    arm.motion.damping = damping;
    arm.motion.step = step;
    arm.motion.substeps = substeps;
    for (int j = 0; j < chain.dof; ++j) {
        arm.motion.acceleration_limit[j] = acceleration(j);
        arm.motion.velocity_limit[j] = velocity(j);
        arm.motion.lower[j] = lower(j);
        arm.motion.upper[j] = upper(j);
    }
    arm.contact = link_point(chain, contact_link, vector3(contact_point));
    arm.along_motion = !normal.has_value();
    if (normal) arm.normal = vector3(*normal);
    arm.from_rest = from_rest;
    scenario.watched = watched_joints(threshold, sd, mean, remembers);
    scenario.reverse = reverse;
    scenario.period = period * step;
    scenario.latency = latency * step;
    scenario.duration = steps * step;
    scenario.stiffness = stiffness;
    scenario.offset_kind = offset_kind == "half_normal" ? OffsetKind::half_normal
                           : offset_kind == "uniform"   ? OffsetKind::uniform
                                                        : OffsetKind::fixed;
    scenario.offset_size = offset_size;
    scenario.observer_memory = observer_memory;
    scenario.quantile = quantile;
    return scenario;
}

nb::dict foretell(const ForetoldScenario& scenario, Matrix q, Matrix velocity) {
    const std::size_t n = q.shape(0);
    NewArray<double> expected({n}), bound({n}), unnoticed({n}), gain({n}), stopping({n}), approach({n});
    NewArray<std::int64_t> trigger({n});
    NewArray<bool> trusted({n});
    if (n > 0) {
        nb::gil_scoped_release unlocked;
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

nb::tuple notice_ramp(Vector torque, double per_tick, Vector threshold, Vector sd, Vector mean, double rarest,
                      bool cautious) {
    const WatchedJoints watched = watched_joints(threshold, sd, mean, false);
    double own[max_joints];
    for (int w = 0; w < watched.count; ++w) own[w] = cautious ? std::fabs(torque(w)) : torque(w);
    const auto felt = [&](double force, int w) { return force * own[w]; };
    const auto feel = [&](double force, double* residual) {
        for (int w = 0; w < watched.count; ++w) residual[w] = force * own[w];
    };
    const auto found =
        notice(watched, felt, feel, own, per_tick, normal_upper_quantile(std::min(rarest, 0.5)), cautious);
    return nb::make_tuple(found.mean(), found.worst(rarest),
                          array_of({found.silence, found.silence + noticing_points}, {std::size_t(noticing_points)}));
}

}  // namespace

void bind_foretold_force(nb::module_& module) {
    nb::class_<ForetoldScenario>(module, "ForetoldScenario", "All but pose and velocity of cases that are foretold.")
        .def(
            "__init__",
            [](ForetoldScenario* self, const Chain& chain, int tip_link, Vector tip_point, int task_rows,
               const std::vector<int>& free_joints, double damping, double step, int substeps, Vector acceleration,
               Vector velocity, Vector lower, Vector upper, int contact_link, Vector contact_point,
               std::optional<Vector> normal, int steps, int period, int latency, bool from_rest, bool reverse,
               Vector threshold, Vector sd, Vector mean, bool remembers, double observer_memory, double stiffness,
               const std::string& offset_kind, double offset_size, double quantile) {
                new (self) ForetoldScenario(make_scenario(
                    chain, tip_link, tip_point, task_rows, free_joints, damping, step, substeps, acceleration, velocity,
                    lower, upper, contact_link, contact_point, normal, steps, period, latency, from_rest, reverse,
                    threshold, sd, mean, remembers, observer_memory, stiffness, offset_kind, offset_size, quantile));
            },
            nb::kw_only(), nb::arg("chain"), nb::arg("tip_link"), nb::arg("tip_point"), nb::arg("task_rows"),
            nb::arg("free_joints"), nb::arg("damping"), nb::arg("step"), nb::arg("substeps"), nb::arg("acceleration"),
            nb::arg("velocity"), nb::arg("lower"), nb::arg("upper"), nb::arg("contact_link"), nb::arg("contact_point"),
            nb::arg("normal").none(), nb::arg("steps"), nb::arg("period"), nb::arg("latency"), nb::arg("from_rest"),
            nb::arg("reverse"), nb::arg("threshold"), nb::arg("sd"), nb::arg("mean"), nb::arg("remembers"),
            nb::arg("observer_memory"), nb::arg("stiffness"), nb::arg("offset_kind"), nb::arg("offset_size"),
            nb::arg("quantile"))
        .def("foretell", &foretell, nb::arg("q"), nb::arg("velocity"),
             "Expected force, bound and the rest (N,), from poses (N, dof) and velocities (N, 3).")
        .def("braking", &braking, nb::arg("q"), nb::arg("velocity"), nb::arg("time"),
             "Expected travel, greatest travel [m] and bend of the reaction to a tick.");
    module.def("notice_ramp", &notice_ramp, nb::arg("torque"), nb::arg("per_tick"), nb::arg("threshold"), nb::arg("sd"),
               nb::arg("mean"), nb::arg("rarest"), nb::arg("cautious"),
               "Mean force at detection, the force rarely passed, and the silence at 33 forces.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
