// Stopping curves of lines, and what is made of them.
#include "bumpstop/collision/collision.hpp"

#include "bumpstop/collision/distribution/tail_without_interpolation.hpp"
#include "common.hpp"
#include "interrupt.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using L = NativeLanes;

// A stopping curve with the setup it was made for.
struct LineStoppingCurve : StoppingCurve {
    LineStoppingCurve(StoppingCurve curve, const CollisionSetup& from) : StoppingCurve(std::move(curve)), setup(from) {}
    CollisionSetup setup;
};

// How a line begins.
struct Start {
    Start(const CollisionSetup& setup, Vector q, Vector velocity) : line(begin(setup, q, velocity)) {
        qd.assign(std::size_t(setup.chain.dof), 0.0);
        for (int f = 0; f < setup.motion.free_count; ++f)
            qd[std::size_t(setup.motion.free_joint[f])] = line.rates.free[f];
    }
    static LineStart<double> begin(const CollisionSetup& setup, Vector q, Vector velocity) {
        LinePath path;
        return begin_line<double>(setup, q.data(), {velocity(0), velocity(1), velocity(2)}, &path, 1);
    }

    LineStart<double> line;
    std::vector<double> qd;
};

LineStoppingCurve trace(const CollisionSetup& setup, Vector q, Vector velocity, const GaussianThresholds* detector,
                        const Contact& contact) {
    return unlocked([&] {
        const LineRequest line{q.data(), {velocity(0), velocity(1), velocity(2)}};
        return LineStoppingCurve(stopping_curve<L>(setup, line, detector, contact), setup);
    });
}

nb::list reaction_paths(const LineStoppingCurve& self, const std::vector<int>& ticks,
                        const std::vector<double>& return_to) {
    const auto distances = unlocked([&] { return reaction_distances<L>(self.setup, self.path, ticks, return_to); });
    nb::list out;
    for (const std::vector<double>& distance : distances) out.append(array_of(distance, {distance.size()}));
    return out;
}

View<double> by_run(const MonteCarloRuns& runs, const std::vector<double>& values) {
    const std::size_t dof = std::size_t(runs.dof);
    return view(values.data(), {values.size() / dof, dof});
}

void bind_curves(nb::module_& module) {
    nb::class_<StoppingCurve>(module, "StoppingCurve", "The motion of the contact point and where reactions take it.")
        .def_prop_ro("ticks", [](const StoppingCurve& self) { return self.path.ticks; })
        .def_prop_ro("distance", [](const StoppingCurve& self) { return view(self.path.s); })
        .def_prop_ro("max_distance", [](const StoppingCurve& self) { return view(self.max_distance); })
        .def_prop_ro(
            "torque_per_newton",
            [](const StoppingCurve& self) {
                return view(self.path.torque_per_N.data(), {std::size_t(self.path.ticks), std::size_t(self.path.dof)});
            })
        .def_prop_ro("start", [](const StoppingCurve& self) { return view(self.path.start.data(), {3}); })
        .def_prop_ro("normal", [](const StoppingCurve& self) { return view(self.path.normal.data(), {3}); });
    nb::class_<LineStoppingCurve, StoppingCurve>(module, "LineStoppingCurve", "Of a motion along a line.")
        .def_prop_ro("reaction_state",
                     [](const LineStoppingCurve& self) {
                         const std::size_t free = std::size_t(self.path.free_count);
                         const std::vector<double>& state = self.path.reaction_state;
                         return view(state.data(), {state.size() / (2 * free), 2, free});
                     })
        .def_prop_ro("approach_speed", [](const LineStoppingCurve& self) { return self.path.approach_speed; })
        .def_prop_ro("end", [](const LineStoppingCurve& self) { return name_of(self.path.end); })
        .def_prop_ro("end_joint", [](const LineStoppingCurve& self) { return self.path.end_joint; })
        .def_prop_ro("cut_step", [](const LineStoppingCurve& self) { return self.path.cut_step; })
        .def_prop_ro("braking", [](const LineStoppingCurve& self) { return view(self.path.braking); })
        .def_prop_ro("velocity_limited", [](const LineStoppingCurve& self) { return self.path.velocity_limited; })
        .def(
            "elastic_arm",
            [](const LineStoppingCurve& self, double distance) {
                return elastic_arm_on_line(self.setup, self.path, distance);
            },
            nb::arg("distance"), "An arm that gives way, in the pose in which it has come so far [m].")
        .def("reaction_paths", &reaction_paths, nb::arg("ticks"), nb::arg("return_to"),
             nb::sig("def reaction_paths(self, ticks: Sequence[int], return_to: Sequence[float]) -> "
                     "list[NDArray[numpy.float64]]"))
        .def(
            "integrate",
            [](const LineStoppingCurve& self, const GaussianThresholds& detector, const Contact& contact,
               int refinement) {
                return unlocked([&] { return integrate<L>(self.setup, self, detector, {contact, refinement}); });
            },
            nb::arg("detector"), nb::arg("contact"), nb::arg("refinement"))
        .def(
            "tail_without_interpolation",
            [](const LineStoppingCurve& self, const GaussianThresholds& detector, const Contact& contact,
               double force) {
                return unlocked(
                    [&] { return tail_without_interpolation<L>(self.setup, self, detector, contact, force); });
            },
            nb::arg("detector"), nb::arg("contact"), nb::arg("force"),
            "P(peak force > force) of detected collisions, with all its digits however small.")
        .def(
            "monte_carlo",
            [](const LineStoppingCurve& self, const GaussianThresholds& detector, const Contact& contact,
               const MonteCarloSettings& settings, const ResidualRecord* record) {
                return unlocked([&] { return monte_carlo<L>(self.setup, self, detector, contact, settings, record); });
            },
            nb::arg("detector"), nb::arg("contact"), nb::arg("settings"), nb::arg("residuals").none());
}

void bind_monte_carlo(nb::module_& module) {
    nb::class_<MonteCarloSettings>(module, "MonteCarloSettings", "Which runs, and what is kept of them.")
        .def(nb::init<>())
        .def_rw("seed", &MonteCarloSettings::seed)
        .def_rw("first", &MonteCarloSettings::first)
        .def_rw("count", &MonteCarloSettings::count)
        .def_rw("threads", &MonteCarloSettings::threads)
        .def_rw("noise", &MonteCarloSettings::noise);
    nb::class_<MonteCarloRuns>(module, "MonteCarloRuns", "Single collisions, an entry or a row each.")
        .def_prop_ro("offset", [](const MonteCarloRuns& self) { return view(self.offset); })
        .def_prop_ro("tick", [](const MonteCarloRuns& self) { return view(self.tick); })
        .def_prop_ro("triggers", [](const MonteCarloRuns& self) { return view(self.triggers); })
        .def_prop_ro("noise", [](const MonteCarloRuns& self) { return by_run(self, self.noise); })
        .def_prop_ro("residual", [](const MonteCarloRuns& self) { return by_run(self, self.residual); })
        .def_prop_ro("peak_force", [](const MonteCarloRuns& self) { return view(self.peak_force); })
        .def_prop_ro("lasting_force", [](const MonteCarloRuns& self) { return view(self.lasting_force); })
        .def_prop_ro("duration", [](const MonteCarloRuns& self) { return view(self.duration); })
        .def_prop_ro("force_at_detection", [](const MonteCarloRuns& self) { return view(self.force_at_detection); });
    nb::class_<ResidualRecord>(module, "ResidualRecord", "Measured residuals, resampled in blocks of rows.")
        .def(
            "__init__",
            [](ResidualRecord* self, Matrix rows, std::int64_t block) {
                new (self) ResidualRecord{{rows.data(), rows.data() + rows.size()}, std::int64_t(rows.shape(0)), block};
            },
            nb::arg("rows"), nb::arg("block"))
        .def(
            "rows_of_run",
            [](const ResidualRecord& self, std::uint64_t seed, std::int64_t run, std::int64_t ticks) {
                NewArray<std::int64_t> out({std::size_t(ticks)});
                for (std::int64_t k = 0; k < ticks; ++k) out.data[k] = self.row_of(seed, run, k);
                return out.release();
            },
            nb::arg("seed"), nb::arg("run"), nb::arg("ticks"), "The rows that play the ticks of a run.");
    module.def(
        "sample_offsets",
        [](const OffsetDistribution& offset, std::uint64_t seed, std::int64_t first, std::size_t count) {
            NewArray<double> out({count});
            for (std::size_t i = 0; i < count; ++i)
                out.data[i] = draw_offset<double>(offset, seed, first + std::int64_t(i));
            return out.release();
        },
        nb::arg("offset"), nb::arg("seed"), nb::arg("first"), nb::arg("count"), "The offsets that runs draw [m].");
}

}  // namespace

void bind_collision(nb::module_& module) {
    bind_curves(module);
    bind_monte_carlo(module);
    nb::class_<Start>(module, "LineStart", "How a line begins at full speed.")
        .def_prop_ro("qd", [](const Start& self) { return view(self.qd); })
        .def_prop_ro("point_velocity", [](const Start& self) { return view(&self.line.point_velocity.x, {3}); })
        .def_prop_ro("singular", [](const Start& self) { return bool(self.line.rates.conditioning.singular); })
        .def_prop_ro("velocity_limited", [](const Start& self) { return bool(self.line.rates.velocity_limited); });
    module.def(
        "line_start", [](const CollisionSetup& setup, Vector q, Vector velocity) { return Start(setup, q, velocity); },
        nb::arg("setup"), nb::arg("q"), nb::arg("velocity"));
    module.def("stopping_curve", &trace, nb::arg("setup"), nb::arg("q"), nb::arg("velocity"),
               nb::arg("detector").none(), nb::arg("contact"),
               "The stopping curve from a pose; with a detector, as far as its distribution needs it.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
