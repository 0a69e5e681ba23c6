// Motions given as joint trajectories.
#include "bumpstop/collision/trajectory/onset_monte_carlo.hpp"
#include "common.hpp"
#include "interrupt.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using Detection = OnsetDistribution::Detection;

// Distributions of contacts as columns: of onsets, and of the detections of all of them in a row.
class OnsetDistributions {
  public:
    OnsetDistributions(std::vector<OnsetDistribution> onsets, int dof) : onset_(std::move(onsets)), dof_(dof) {}

    template <auto Member>
    NewArray<double>::Array of_onsets() const {
        NewArray<double> out({onset_.size()});
        for (std::size_t i = 0; i < onset_.size(); ++i) out.data[i] = onset_[i].*Member;
        return out.release();
    }
    NewArray<double>::Array trigger() const {
        const std::size_t dof = std::size_t(dof_);
        NewArray<double> out({onset_.size(), dof});
        for (std::size_t i = 0; i < onset_.size(); ++i) std::copy_n(onset_[i].trigger.begin(), dof, &out.data[i * dof]);
        return out.release();
    }
    template <auto Member, class Scalar = double>
    typename NewArray<Scalar>::Array of_detections() const {
        return columns<Scalar>([](std::size_t, const Detection& detection) { return Scalar(detection.*Member); });
    }
    // Which onset each detection belongs to.
    NewArray<std::int64_t>::Array owner() const {
        return columns<std::int64_t>([](std::size_t i, const Detection&) { return std::int64_t(i); });
    }

  private:
    template <class Scalar, class Of>
    typename NewArray<Scalar>::Array columns(Of of) const {
        std::size_t count = 0, next = 0;
        for (const OnsetDistribution& one : onset_) count += one.detection.size();
        NewArray<Scalar> out({count});
        for (std::size_t i = 0; i < onset_.size(); ++i)
            for (const Detection& detection : onset_[i].detection) out.data[next++] = of(i, detection);
        return out.release();
    }

    std::vector<OnsetDistribution> onset_;
    int dof_;
};

Onsets onsets_of(Vector time, Matrix normal) { return {time.shape(0), time.data(), normal.data()}; }

void bind_onsets(nb::module_& module) {
    constexpr auto owned = nb::rv_policy::automatic;
    using One = OnsetDistribution;
    using All = OnsetDistributions;
    nb::class_<All>(module, "OnsetDistributions", "Distributions of contacts, and the detections of all in a row.")
        .def_prop_ro("false_alarm", &All::of_onsets<&One::false_alarm>, owned)
        .def_prop_ro("undetected", &All::of_onsets<&One::undetected>, owned)
        .def_prop_ro("no_contact", &All::of_onsets<&One::no_contact>, owned)
        .def_prop_ro("multi_joint", &All::of_onsets<&One::multi_joint>, owned)
        .def_prop_ro("zero_force", &All::of_onsets<&One::zero_force>, owned)
        .def_prop_ro("undetected_distance", &All::of_onsets<&One::undetected_distance>, owned)
        .def_prop_ro("undetected_peak", &All::of_onsets<&One::undetected_peak>, owned)
        .def_prop_ro("undetected_lasting", &All::of_onsets<&One::undetected_lasting>, owned)
        .def_prop_ro("undetected_duration", &All::of_onsets<&One::undetected_duration>, owned)
        .def_prop_ro("trigger", &All::trigger, owned)
        .def_prop_ro("onset", &All::owner, owned, "Of detections: the number of its onset.")
        .def_prop_ro("tick", &All::of_detections<&Detection::tick, std::int64_t>, owned)
        .def_prop_ro("probability", &All::of_detections<&Detection::probability>, owned)
        .def_prop_ro("max_distance", &All::of_detections<&Detection::max_distance>, owned)
        .def_prop_ro("distance", &All::of_detections<&Detection::distance>, owned)
        .def_prop_ro("peak", &All::of_detections<&Detection::peak>, owned)
        .def_prop_ro("lasting", &All::of_detections<&Detection::lasting>, owned)
        .def_prop_ro("duration", &All::of_detections<&Detection::duration>, owned)
        .def_prop_ro("force", &All::of_detections<&Detection::force>, owned);
    nb::class_<OnsetRuns, MonteCarloRuns>(module, "OnsetRuns", "Single collisions of a trajectory.")
        .def_prop_ro("max_distance", [](const OnsetRuns& self) { return view(self.max_distance); })
        .def_prop_ro("distance", [](const OnsetRuns& self) { return view(self.distance); })
        .def_prop_ro("undetected_distance", [](const OnsetRuns& self) { return view(self.undetected_distance); });
}

}  // namespace

void bind_trajectory(nb::module_& module) {
    bind_onsets(module);
    nb::class_<ArmTrajectory>(module, "Trajectory", "A joint trajectory and the reactions to every tick of it.")
        .def(
            "__init__",
            [](ArmTrajectory* self, const CollisionSetup& setup, Vector time, Tensor coefficient) {
                JointSpline spline{setup.chain.dof,
                                   {time.data(), time.data() + time.shape(0)},
                                   {coefficient.data(), coefficient.data() + coefficient.size()}};
                const Unlocked here;
                new (self) ArmTrajectory(setup, std::move(spline));
            },
            nb::arg("setup"), nb::arg("time"), nb::arg("coefficient"),
            "Pieces end at `time`; cubics by [piece][power 3, 2, 1, 0 of the time since it began][joint].")
        .def_prop_ro("steps", &ArmTrajectory::steps)
        .def_prop_ro("ticks", &ArmTrajectory::ticks)
        .def_prop_ro("acceleration_overload", &ArmTrajectory::acceleration_overload)
        .def(
            "reaction", [](const ArmTrajectory& self, int tick) { return view(self.reaction(tick).u); },
            nb::arg("tick"), nb::rv_policy::reference_internal,
            "Path parameter [s] after every step until the reaction's final speed is reached.")
        .def(
            "reaction_distances",
            [](const ArmTrajectory& self, int tick, double onset, const Vector3& normal) {
                const auto s = self.reaction_distances(tick, onset, {normal[0], normal[1], normal[2]});
                return array_of(s, {s.size()});
            },
            nb::arg("tick"), nb::arg("onset"), nb::arg("normal"))
        .def(
            "contact_durations",
            [](const ArmTrajectory& self, const std::vector<int>& tick, Vector onset) {
                NewArray<double> out({tick.size()});
                for (std::size_t i = 0; i < tick.size(); ++i) out.data[i] = self.contact_duration(tick[i], onset(i));
                return out.release();
            },
            nb::arg("tick"), nb::arg("onset"), "Time [s] from touch until a reversing arm has let go.")
        .def(
            "curve",
            [](const ArmTrajectory& self, double onset, const Vector3& normal) {
                return self.curve(onset, {normal[0], normal[1], normal[2]}, nullptr, {});
            },
            nb::arg("onset"), nb::arg("normal"))
        .def(
            "integrate",
            [](const ArmTrajectory& self, const GaussianThresholds& detector, const Contact& contact, Vector onset,
               Matrix normal, int threads) {
                return unlocked([&] {
                    return OnsetDistributions(
                        integrate_onsets<NativeLanes>(self, onsets_of(onset, normal), detector, contact, threads),
                        self.dof());
                });
            },
            nb::arg("detector"), nb::arg("contact"), nb::arg("onset"), nb::arg("normal"), nb::arg("threads"))
        .def(
            "monte_carlo",
            [](const ArmTrajectory& self, const GaussianThresholds& detector, const Contact& contact, Vector onset,
               Matrix normal, const MonteCarloSettings& settings, const ResidualRecord* record) {
                return unlocked([&] {
                    const Onsets onsets = onsets_of(onset, normal);
                    return monte_carlo_onsets({self, onsets, detector, contact, settings, record});
                });
            },
            nb::arg("detector"), nb::arg("contact"), nb::arg("onset"), nb::arg("normal"), nb::arg("settings"),
            nb::arg("residuals").none())
        .def(
            "phases",
            [](const ArmTrajectory& self, const std::vector<int>& tick, Vector onset, Matrix normal, double first) {
                const Onsets onsets = onsets_of(onset, normal);
                NewArray<double> out({tick.size(), 2});
                for (std::size_t i = 0; i < tick.size(); ++i) {
                    const auto phase_max = self.phases(tick[i], onsets.time[i], onsets.normal_of(i), first);
                    std::copy(phase_max.begin(), phase_max.end(), &out.data[2 * i]);
                }
                return out.release();
            },
            nb::arg("tick"), nb::arg("onset"), nb::arg("normal"), nb::arg("first"),
            "Greatest distances [m] in the first seconds of contact, and after them, (N, 2).");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
