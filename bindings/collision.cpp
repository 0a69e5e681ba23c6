// Arm and motion of a collision, stopping curves, and what is made of them.
#include <atomic>

#include "bumpstop/collision/contact/separation_criterion.hpp"
#include "bumpstop/collision/distribution/monte_carlo.hpp"
#include "bumpstop/collision/distribution/survival_criterion.hpp"
#include "bumpstop/collision/distribution/tail_without_interpolation.hpp"
#include "interrupt.hpp"
#include "law.hpp"
#include "setup.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using L = NativeLanes;

const char* end_name(PathEnd end) {
    switch (end) {
        case PathEnd::joint_limit:
            return "joint_limit";
        case PathEnd::singularity:
            return "singularity";
        case PathEnd::certain_detection:
            return "certain_detection";
        default:
            return "horizon";
    }
}

Setup make_setup(const Chain& chain, int tip_link, Vector tip_point, int task_rows, const std::vector<int>& free_joints,
                 double damping, double step, int substeps, Vector acceleration, Vector velocity, Vector lower,
                 Vector upper, int contact_link, Vector contact_point, std::optional<Vector> normal, int steps,
                 int period, int latency, bool from_rest, bool reverse) {
    Setup setup;
    setup.chain = chain;
    MotionSettings& motion = setup.motion;
    motion.tip = link_point(chain, tip_link, vector3(tip_point));
    motion.task_rows = task_rows;
    motion.free_count = int(free_joints.size());
    std::copy(free_joints.begin(), free_joints.end(), motion.free_joint.begin());
    motion.damping = damping;
    motion.step = step;
    motion.substeps = substeps;
    for (int j = 0; j < chain.dof; ++j) {
        motion.acceleration_limit[j] = acceleration(j);
        motion.velocity_limit[j] = velocity(j);
        motion.lower[j] = lower(j);
        motion.upper[j] = upper(j);
    }
    setup.contact.point = link_point(chain, contact_link, vector3(contact_point));
    setup.contact.along_motion = !normal.has_value();
    if (normal) setup.contact.normal = vector3(*normal);
    setup.timing = {steps, period, latency, from_rest};
    setup.reaction = reverse ? ReactionKind::reverse : ReactionKind::stop;
    return setup;
}

// A stopping curve with the pose it was made for.
struct Curve {
    Setup setup;
    std::vector<double> q;
    StoppingCurve curve;

    ContactPaths contact_paths(const ContactPropagator& by) const {
        return bumpstop::contact_paths<L>(setup.chain, setup.motion, setup.contact, setup.timing, setup.reaction, curve,
                                          by, curve.path.ticks, q.data());
    }
    std::optional<ContactPropagator> propagator(double stiffness, double body_mass) const {
        if (!(body_mass > 0)) return std::nullopt;
        return ContactPropagator(ContactSystem(ElasticArm{}, {stiffness, 0, body_mass, 0}), setup.motion.step);
    }
};

nb::dict start_of(const Setup& setup, Vector q, Vector velocity) {
    ArmState<double> state;
    for (int j = 0; j < setup.chain.dof; ++j) state.q[j] = q(j);
    state.refresh_angles(setup.chain);
    Posture<double> posture;
    forward_kinematics(setup.chain, state.q, state.angle, posture);
    const auto rates =
        resolved_rates(setup.chain, setup.motion, posture, Point3<double>{velocity(0), velocity(1), velocity(2)});
    NewArray<double> qd({std::size_t(setup.chain.dof)}), drift({3});
    const Point3<double> p = posture.position(setup.contact.point);
    for (int f = 0; f < setup.motion.free_count; ++f) {
        const int j = setup.motion.free_joint[f];
        qd.data[j] = rates.free[f];
        if (j > setup.contact.point.link) continue;
        const Point3<double> column = linear_column(setup.chain, posture, p, j);
        drift.data[0] += column.x * rates.free[f];
        drift.data[1] += column.y * rates.free[f];
        drift.data[2] += column.z * rates.free[f];
    }
    nb::dict out;
    out["qd"] = qd.release();
    out["point_velocity"] = drift.release();
    out["singular"] = bool(rates.conditioning.singular);
    out["velocity_limited"] = bool(rates.velocity_limited);
    return out;
}

Curve trace(const Setup& setup, Vector q, Vector velocity, const GaussianThresholds* detector, double stiffness,
            double largest_offset, double body_mass) {
    const Unlocked unlocked;
    Curve result{setup, std::vector<double>(q.data(), q.data() + q.shape(0)), {}};
    LinePath& path = result.curve.path;
    if (detector != nullptr && body_mass > 0) {
        const ContactPropagator by(ContactSystem(ElasticArm{}, {stiffness, 0, body_mass, 0}), setup.motion.step);
        for (double half_oscillations = 3;; half_oscillations *= 4) {
            path = trace_line(setup, result.q.data(), velocity,
                              SeparationCriterion<L>(by, setup.timing, largest_offset, half_oscillations));
            if (path.end != PathEnd::certain_detection || all_separated(path, by, setup.timing, largest_offset)) break;
        }
    } else if (detector != nullptr) {
        path = trace_line(setup, result.q.data(), velocity,
                          SurvivalCriterion<L>(*detector, setup.timing, setup.motion.step, stiffness, largest_offset));
    } else {
        path = trace_line(setup, result.q.data(), velocity, NoCriterion<L>());
    }
    complete_curves<L>(
        setup.chain, setup.motion, setup.contact, setup.timing, setup.reaction, &result.curve, 1,
        [&](int) { return result.q.data(); }, [](int) { return OvertravelTolerance{}; });
    return result;
}

// Distances after every simulation step of the reactions to `ticks`, each until back behind its `return_to`.
nb::list reaction_paths(const Curve& self, const std::vector<int>& ticks, const std::vector<double>& return_to) {
    std::vector<ReactionJob> jobs;
    const int known = int(self.curve.path.reaction_state.size() / (2 * std::size_t(self.setup.motion.free_count)));
    for (std::size_t i = 0; i < ticks.size(); ++i) {
        if (ticks[i] < known) jobs.push_back({&self.curve.path, int(i), ticks[i], {}, {}});
    }
    {
        const Unlocked unlocked;
        simulate_reactions<L>(
            self.setup.chain, self.setup.motion, self.setup.contact, self.setup.timing, self.setup.reaction,
            jobs.data(), int(jobs.size()), ReactionDetail::every_step,
            [&](const ReactionJob&) { return self.q.data(); },
            [&](const ReactionJob& job) { return return_to[std::size_t(job.curve)]; });
    }
    nb::list out;
    std::size_t next = 0;
    for (int tick : ticks) {
        // An arm whose reaction never began is where it brakes at the end of its line.
        std::vector<double> distance;
        if (tick < known) {
            distance = std::move(jobs[next++].distance);
        } else {
            distance.assign(1, self.curve.path.s.back());
            const std::vector<double>& braking = self.curve.path.braking;
            distance.insert(distance.end(), braking.begin(), braking.end());
        }
        const std::size_t n = distance.size();
        out.append(array_of(distance, {n}));
    }
    return out;
}

nb::dict sample_runs(const Curve& curve, const GaussianThresholds& detector, double stiffness,
                     const std::string& offset_kind, double offset_size, std::uint64_t seed, std::int64_t first_run,
                     std::int64_t runs, bool with_noise, int threads, std::optional<Matrix> residuals,
                     std::int64_t block_rows, double body_mass) {
    const std::size_t n = std::size_t(runs), dof = std::size_t(curve.setup.chain.dof);
    NewArray<double> offset({n}), noise({with_noise ? n : 0, dof}), residual({with_noise ? n : 0, dof});
    NewArray<std::int32_t> tick({n});
    NewArray<std::uint32_t> triggers({n});
    const std::size_t free_runs = body_mass > 0 ? n : 0;
    NewArray<double> peak_force({free_runs}), duration({free_runs}), force_at_detection({free_runs});
    {
        const Unlocked unlocked;
        const std::optional<ContactPropagator> by = curve.propagator(stiffness, body_mass);
        const ContactPaths paths = by ? curve.contact_paths(*by) : ContactPaths{};
        ResidualRecord record;
        if (residuals) record = {residuals->data(), std::int64_t(residuals->shape(0)), int(dof), block_rows};
        const MonteCarlo<L> sampler(curve.curve, curve.setup.timing, curve.setup.motion, detector, stiffness,
                                    offset_distribution(offset_kind, offset_size), seed, residuals ? &record : nullptr,
                                    by ? &paths : nullptr, by ? &*by : nullptr);
        // Whole blocks of runs go to threads: a run's numbers depend on its own number alone.
        constexpr std::int64_t block = 1 << 16;
        std::atomic<std::int64_t> next{0};
        work_in_threads(threads, [&] {
            for (std::int64_t begin = block * next++; begin < runs; begin = block * next++) {
                MonteCarloRuns out{offset.data.get() + begin, tick.data.get() + begin, triggers.data.get() + begin};
                if (with_noise) {
                    out.noise = noise.data.get() + begin * std::int64_t(dof);
                    out.residual = residual.data.get() + begin * std::int64_t(dof);
                }
                if (body_mass > 0) {
                    out.peak_force = peak_force.data.get() + begin;
                    out.duration = duration.data.get() + begin;
                    out.force_at_detection = force_at_detection.data.get() + begin;
                }
                sampler.run(first_run + begin, std::min(block, runs - begin), out);
            }
        });
    }
    nb::dict out;
    out["offset"] = offset.release();
    out["tick"] = tick.release();
    out["triggers"] = triggers.release();
    out["noise"] = noise.release();
    out["residual"] = residual.release();
    if (body_mass > 0) {
        out["peak_force"] = peak_force.release();
        out["duration"] = duration.release();
        out["force_at_detection"] = force_at_detection.release();
    }
    return out;
}

}  // namespace

void bind_collision(nb::module_& module) {
    // A property's array owns its memory; nanobind would tie it to the object.
    constexpr auto owned = nb::rv_policy::automatic;
    nb::class_<Setup>(module, "Setup", "Arm, motion, contact point and reaction.")
        .def(
            "__init__",
            [](Setup* self, const Chain& chain, int tip_link, Vector tip_point, int task_rows,
               const std::vector<int>& free_joints, double damping, double step, int substeps, Vector acceleration,
               Vector velocity, Vector lower, Vector upper, int contact_link, Vector contact_point,
               std::optional<Vector> normal, int steps, int period, int latency, bool from_rest, bool reverse) {
                new (self) Setup(make_setup(chain, tip_link, tip_point, task_rows, free_joints, damping, step, substeps,
                                            acceleration, velocity, lower, upper, contact_link, contact_point, normal,
                                            steps, period, latency, from_rest, reverse));
            },
            nb::kw_only(), nb::arg("chain"), nb::arg("tip_link"), nb::arg("tip_point"), nb::arg("task_rows"),
            nb::arg("free_joints"), nb::arg("damping"), nb::arg("step"), nb::arg("substeps"), nb::arg("acceleration"),
            nb::arg("velocity"), nb::arg("lower"), nb::arg("upper"), nb::arg("contact_link"), nb::arg("contact_point"),
            nb::arg("normal").none(), nb::arg("steps"), nb::arg("period"), nb::arg("latency"), nb::arg("from_rest"),
            nb::arg("reverse"))
        .def("start", &start_of, nb::arg("q"), nb::arg("velocity"),
             "Joint rates and contact point velocity at the start of the motion, and what is wrong with them.")
        .def("trace", &trace, nb::arg("q"), nb::arg("velocity"), nb::arg("detector").none(), nb::arg("stiffness"),
             nb::arg("largest_offset"), nb::arg("body_mass") = 0.0,
             "The stopping curve from a pose; with a detector, as far as its law needs it.");
    nb::class_<Curve>(module, "Curve", "A stopping curve.")
        .def_prop_ro("ticks", [](const Curve& self) { return self.curve.path.ticks; })
        .def_prop_ro(
            "distance", [](const Curve& self) { return array_of(self.curve.path.s, {self.curve.path.s.size()}); },
            owned)
        .def_prop_ro(
            "torque_per_newton",
            [](const Curve& self) {
                const LinePath& path = self.curve.path;
                return array_of(path.torque_per_N, {std::size_t(path.ticks), std::size_t(path.dof)});
            },
            owned)
        .def_prop_ro(
            "farthest", [](const Curve& self) { return array_of(self.curve.farthest, {self.curve.farthest.size()}); },
            owned)
        .def_prop_ro(
            "reaction_state",
            [](const Curve& self) {
                const std::size_t free = std::size_t(self.setup.motion.free_count);
                const std::size_t n = self.curve.path.reaction_state.size() / (2 * free);
                return array_of(self.curve.path.reaction_state, {n, 2, free});
            },
            owned)
        .def_prop_ro(
            "start",
            [](const Curve& self) {
                const Vector3& p = self.curve.path.start;
                return array_of({p[0], p[1], p[2]}, {3});
            },
            owned)
        .def_prop_ro(
            "normal",
            [](const Curve& self) {
                const Vector3& n = self.curve.path.normal;
                return array_of({n[0], n[1], n[2]}, {3});
            },
            owned)
        .def_prop_ro("approach_speed", [](const Curve& self) { return self.curve.path.approach_speed; })
        .def_prop_ro("end", [](const Curve& self) { return end_name(self.curve.path.end); })
        .def_prop_ro("end_joint", [](const Curve& self) { return self.curve.path.end_joint; })
        .def_prop_ro("cut_step", [](const Curve& self) { return self.curve.path.cut_step; })
        .def_prop_ro(
            "braking",
            [](const Curve& self) { return array_of(self.curve.path.braking, {self.curve.path.braking.size()}); },
            owned)
        .def_prop_ro("velocity_limited", [](const Curve& self) { return self.curve.path.velocity_limited; })
        .def("reaction_paths", &reaction_paths, nb::arg("ticks"), nb::arg("return_to"))
        .def(
            "exact_law",
            [](const Curve& self, const GaussianThresholds& detector, double stiffness, const std::string& offset_kind,
               double offset_size, int refinement, double body_mass) {
                const Unlocked unlocked;
                QuadratureSettings settings{stiffness, offset_distribution(offset_kind, offset_size), refinement};
                const std::optional<ContactPropagator> by = self.propagator(stiffness, body_mass);
                const ContactPaths paths = by ? self.contact_paths(*by) : ContactPaths{};
                if (by) {
                    settings.paths = &paths;
                    settings.propagator = &*by;
                }
                return Law{integrate<L>(self.curve, self.setup.timing, self.setup.motion, detector, settings),
                           self.setup.chain.dof};
            },
            nb::arg("detector"), nb::arg("stiffness"), nb::arg("offset_kind"), nb::arg("offset_size"),
            nb::arg("refinement"), nb::arg("body_mass") = 0.0,
            "With a body mass [kg] the contact is free; without one the body is clamped.")
        .def(
            "tail_directly",
            [](const Curve& self, const GaussianThresholds& detector, double stiffness, const std::string& offset_kind,
               double offset_size, double force) {
                const Unlocked unlocked;
                const QuadratureSettings settings{stiffness, offset_distribution(offset_kind, offset_size)};
                return tail_without_interpolation<L>(self.curve, self.setup.timing, self.setup.motion, detector,
                                                     settings, force);
            },
            nb::arg("detector"), nb::arg("stiffness"), nb::arg("offset_kind"), nb::arg("offset_size"), nb::arg("force"),
            "P(peak force > force) of detected collisions, with all its digits however small.")
        .def("sample", &sample_runs, nb::arg("detector"), nb::arg("stiffness"), nb::arg("offset_kind"),
             nb::arg("offset_size"), nb::arg("seed"), nb::arg("first_run"), nb::arg("runs"), nb::arg("with_noise"),
             nb::arg("threads"), nb::arg("residuals").none() = nb::none(), nb::arg("block_rows") = 1,
             nb::arg("body_mass") = 0.0);
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
