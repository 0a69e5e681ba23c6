// Motions given as joint trajectories.
#include "bumpstop/collision/trajectory.hpp"

#include <atomic>

#include "common.hpp"
#include "interrupt.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using L = NativeLanes;

Point3<double> point3(const double* v) { return {v[0], v[1], v[2]}; }

ArmTrajectory make_trajectory(const Chain& chain, Vector time, Tensor coefficient, int contact_link,
                              Vector contact_point, double step, int substeps, Vector acceleration, int period,
                              int latency, bool reverse) {
    JointSpline spline;
    spline.dof = chain.dof;
    spline.time.assign(time.data(), time.data() + time.shape(0));
    spline.coefficient.assign(coefficient.data(), coefficient.data() + coefficient.size());
    TrajectorySettings settings;
    settings.point = link_point(chain, contact_link, {contact_point(0), contact_point(1), contact_point(2)});
    settings.motion.step = step;
    settings.motion.substeps = substeps;
    for (int j = 0; j < chain.dof; ++j) settings.motion.acceleration_limit[j] = acceleration(j);
    settings.period = period;
    settings.latency = latency;
    settings.reaction = reverse ? ReactionKind::reverse : ReactionKind::stop;
    const Unlocked unlocked;
    return ArmTrajectory(chain, std::move(spline), settings);
}

nb::dict curve(const ArmTrajectory& self, double begin, Vector normal) {
    const StoppingCurve curve = self.curve(begin, point3(normal.data()), nullptr, 0);
    const LinePath& path = curve.path;
    nb::dict out;
    out["start"] = array_of({path.start[0], path.start[1], path.start[2]}, {3});
    out["distance"] = array_of(path.s, {path.s.size()});
    out["farthest"] = array_of(curve.farthest, {curve.farthest.size()});
    out["torque_per_newton"] = array_of(path.torque_per_N, {std::size_t(path.ticks), std::size_t(path.dof)});
    return out;
}

// The exact laws of single contact times; detections of all of them in a row, `contact` says whose each is.
std::optional<ContactPropagator> propagator(const ArmTrajectory& self, double stiffness, double body_mass) {
    if (!(body_mass > 0)) return std::nullopt;
    return ContactPropagator(ContactSystem(ElasticArm{}, {stiffness, 0, body_mass, 0}), self.step());
}

nb::dict laws(const ArmTrajectory& self, const GaussianThresholds& detector, double stiffness, Vector begin,
              Matrix normal, double body_mass) {
    const std::size_t n = begin.shape(0), dof = std::size_t(self.dof());
    NewArray<double> false_alarm({n}), undetected({n}), no_contact({n}), several({n}), harmless({n}), greatest({n});
    NewArray<double> undetected_peak({n}), undetected_duration({n});
    NewArray<double> trigger({n, dof});
    std::vector<ContactLaw::Detection> detection;
    std::vector<std::size_t> owner;
    {
        const Unlocked unlocked;
        const PreContactAlarms before(detector, self.timing(), self.step(), self.ticks());
        const std::optional<ContactPropagator> by = propagator(self, stiffness, body_mass);
        for (std::size_t i = 0; i < n; ++i) {
            const ContactLaw law = contact_law<L>(self, begin(i), point3(normal.data() + 3 * i), detector, stiffness,
                                                  before, by ? &*by : nullptr);
            undetected_peak.data[i] = law.undetected_peak;
            undetected_duration.data[i] = law.undetected_duration;
            false_alarm.data[i] = law.false_alarm;
            undetected.data[i] = law.undetected;
            no_contact.data[i] = law.no_contact;
            several.data[i] = law.several;
            harmless.data[i] = law.harmless;
            greatest.data[i] = law.greatest;
            std::copy(law.trigger, law.trigger + dof, &trigger.data[i * dof]);
            detection.insert(detection.end(), law.detection.begin(), law.detection.end());
            owner.resize(detection.size(), i);
        }
    }
    const std::size_t m = detection.size();
    NewArray<std::int64_t> contact({m}), tick({m});
    NewArray<double> probability({m}), farthest({m}), distance({m}), peak({m}), duration({m}), force({m});
    for (std::size_t i = 0; i < m; ++i) {
        contact.data[i] = std::int64_t(owner[i]);
        tick.data[i] = detection[i].tick;
        probability.data[i] = detection[i].probability;
        farthest.data[i] = detection[i].farthest;
        distance.data[i] = detection[i].distance;
        peak.data[i] = detection[i].peak;
        duration.data[i] = detection[i].duration;
        force.data[i] = detection[i].force;
    }
    nb::dict out;
    out["false_alarm"] = false_alarm.release();
    out["undetected"] = undetected.release();
    out["no_contact"] = no_contact.release();
    out["several"] = several.release();
    out["harmless"] = harmless.release();
    out["greatest"] = greatest.release();
    out["trigger"] = trigger.release();
    out["contact"] = contact.release();
    out["tick"] = tick.release();
    out["probability"] = probability.release();
    out["farthest"] = farthest.release();
    out["distance"] = distance.release();
    out["peak"] = peak.release();
    out["duration"] = duration.release();
    out["force"] = force.release();
    out["undetected_peak"] = undetected_peak.release();
    out["undetected_duration"] = undetected_duration.release();
    return out;
}

// One collision for each contact time. Runs are numbered from 0; a run's noise depends on its number alone.
nb::dict sample_contacts(const ArmTrajectory& self, const GaussianThresholds& detector, double stiffness, Vector begin,
                         Matrix normal, std::uint64_t seed, int threads, std::optional<Matrix> residuals,
                         std::int64_t block_rows, double body_mass) {
    const std::size_t n = begin.shape(0), dof = std::size_t(self.dof());
    NewArray<double> noise({n, dof}), residual({n, dof}), farthest({n}), distance({n}), greatest({n});
    NewArray<double> peak({n}), duration({n}), force({n});
    NewArray<std::int32_t> tick({n});
    NewArray<std::uint32_t> triggers({n});
    {
        const Unlocked unlocked;
        constexpr std::size_t block = 256;
        std::atomic<std::size_t> next{0};
        ResidualRecord record;
        if (residuals) record = {residuals->data(), std::int64_t(residuals->shape(0)), int(dof), block_rows};
        const std::optional<ContactPropagator> by = propagator(self, stiffness, body_mass);
        auto one = [&](std::size_t i) {
            const Point3<double> way = point3(normal.data() + 3 * i);
            // Of measured residuals no tick is certain to alarm by what a Gaussian of their spread would do.
            const GaussianThresholds* certain = residuals && !(body_mass > 0) ? nullptr : &detector;
            const StoppingCurve curve = self.curve(begin(i), way, certain, stiffness, by ? &*by : nullptr);
            double offset;
            MonteCarloRuns out{&offset, &tick.data[i], &triggers.data[i], &noise.data[i * dof],
                               &residual.data[i * dof]};
            out.peak_force = &peak.data[i];
            out.duration = &duration.data[i];
            out.force_at_detection = &force.data[i];
            const bool free = body_mass > 0;
            // When the body is noticed does not depend on the reactions; of these one is needed.
            ContactPaths paths;
            if (free) paths = self.contact_paths(curve, begin(i), way, self.ticks());
            MonteCarlo<double>(curve, self.timing(), self.settings().motion, detector, stiffness,
                               {OffsetKind::fixed, 0.0}, seed, residuals ? &record : nullptr, free ? &paths : nullptr,
                               free ? &*by : nullptr)
                .run(std::int64_t(i), 1, out);
            const int k = tick.data[i];
            farthest.data[i] = k < 0 ? 0 : curve.farthest[std::size_t(k)];
            const int period = self.timing().period;
            int first = 0;
            while (first < curve.path.ticks && !(curve.path.at_tick(first, period) > 0)) ++first;
            distance.data[i] = k < 0 ? -1 : compression_at(curve.path, k, period, first);
            greatest.data[i] = std::max(0.0, *std::max_element(curve.path.s.begin(), curve.path.s.end()));
            if (!free || k < 0) return;
            paths = self.contact_paths(curve, begin(i), way, k);
            const ContactReactions<double> reactions(paths, *by);
            const int since = k - first;
            const auto outcome = ContactCollision<double>(reactions, &first, 0.0).detected(&since);
            peak.data[i] = outcome.peak;
            duration.data[i] = outcome.duration;
        };
        work_in_threads(threads, [&] {
            for (std::size_t first = block * next++; first < n; first = block * next++) {
                for (std::size_t i = first; i < std::min(n, first + block); ++i) one(i);
            }
        });
    }
    nb::dict out;
    out["tick"] = tick.release();
    out["triggers"] = triggers.release();
    out["noise"] = noise.release();
    out["residual"] = residual.release();
    out["farthest"] = farthest.release();
    out["distance"] = distance.release();
    out["greatest"] = greatest.release();
    if (body_mass > 0) {
        out["peak"] = peak.release();
        out["duration"] = duration.release();
        out["force"] = force.release();
    }
    return out;
}

}  // namespace

void bind_trajectory(nb::module_& module) {
    nb::class_<ArmTrajectory>(module, "Trajectory", "A joint trajectory and the reactions to every tick of it.")
        .def(
            "__init__",
            [](ArmTrajectory* self, const Chain& chain, Vector time, Tensor coefficient, int contact_link,
               Vector contact_point, double step, int substeps, Vector acceleration, int period, int latency,
               bool reverse) {
                new (self) ArmTrajectory(make_trajectory(chain, time, coefficient, contact_link, contact_point, step,
                                                         substeps, acceleration, period, latency, reverse));
            },
            nb::kw_only(), nb::arg("chain"), nb::arg("time"), nb::arg("coefficient"), nb::arg("contact_link"),
            nb::arg("contact_point"), nb::arg("step"), nb::arg("substeps"), nb::arg("acceleration"), nb::arg("period"),
            nb::arg("latency"), nb::arg("reverse"))
        .def_prop_ro("steps", &ArmTrajectory::steps)
        .def_prop_ro("ticks", &ArmTrajectory::ticks)
        .def_prop_ro("excess", &ArmTrajectory::excess)
        .def(
            "reaction",
            [](const ArmTrajectory& self, int tick) {
                const std::vector<double>& u = self.reaction(tick).u;
                return array_of(u, {u.size()});
            },
            nb::arg("tick"), "Path parameter [s] after every step until the reaction's final speed is reached.")
        .def(
            "reaction_distances",
            [](const ArmTrajectory& self, int tick, double begin, Vector normal) {
                const std::vector<double> s = self.reaction_distances(tick, begin, point3(normal.data()));
                return array_of(s, {s.size()});
            },
            nb::arg("tick"), nb::arg("begin"), nb::arg("normal"))
        .def(
            "contact_spans",
            [](const ArmTrajectory& self, const std::vector<int>& tick, Vector begin) {
                NewArray<double> out({tick.size()});
                for (std::size_t i = 0; i < tick.size(); ++i) out.data[i] = self.contact_span(tick[i], begin(i));
                return out.release();
            },
            nb::arg("tick"), nb::arg("begin"), "Time [s] from touch until a reversing arm has let go.")
        .def("curve", &curve, nb::arg("begin"), nb::arg("normal"))
        .def("laws", &laws, nb::arg("detector"), nb::arg("stiffness"), nb::arg("begin"), nb::arg("normal"),
             nb::arg("body_mass"))
        .def("sample", &sample_contacts, nb::arg("detector"), nb::arg("stiffness"), nb::arg("begin"), nb::arg("normal"),
             nb::arg("seed"), nb::arg("threads"), nb::arg("residuals").none(), nb::arg("block_rows"),
             nb::arg("body_mass"))
        .def(
            "phases",
            [](const ArmTrajectory& self, const std::vector<int>& tick, Vector begin, Matrix normal, double first) {
                NewArray<double> out({tick.size(), 2});
                for (std::size_t i = 0; i < tick.size(); ++i) {
                    const auto deepest = self.phases(tick[i], begin(i), point3(normal.data() + 3 * i), first);
                    std::copy(deepest.begin(), deepest.end(), &out.data[2 * i]);
                }
                return out.release();
            },
            nb::arg("tick"), nb::arg("begin"), nb::arg("normal"), nb::arg("first"),
            "Greatest distances [m] in the first seconds of contact, and after them, (N, 2).");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
