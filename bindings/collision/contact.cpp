// Arms that give way, and single collisions of them.
#include "bumpstop/collision/contact/contact_course.hpp"
#include "bumpstop/collision/contact/elastic_arm.hpp"
#include "bumpstop/collision/distribution/cell_mixture.hpp"
#include "common.hpp"
#include "interrupt.hpp"
#include "model/dynamics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using L = NativeLanes;

NewArray<double>::Array matrix_of(const ElasticArm& arm, const ContactBody& body, bool in_contact) {
    const ContactSystem system(arm, body);
    const detail::PaddedMatrix matrix = system.matrix(in_contact);
    const std::size_t n = std::size_t(system.states());
    NewArray<double> out({n, n});
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t j = 0; j < n; ++j) out.data[i * n + j] = matrix(int(i), int(j));
    return out.release();
}

}  // namespace

void bind_contact(nb::module_& module) {
    nb::class_<ArmCompliance>(module, "ArmCompliance", "Links, rotors, gears and servos of an arm.")
        .def(
            "__init__",
            [](ArmCompliance* self, const Dynamics& dynamics) {
                new (self) ArmCompliance();
                self->inertias = dynamics.inertias;
            },
            nb::arg("dynamics"))
        .def_prop_rw("rotor_inertia", &by_joint<ArmCompliance, &ArmCompliance::rotor_inertia>,
                     &set_by_joint<ArmCompliance, &ArmCompliance::rotor_inertia>)
        .def_prop_rw("gear_stiffness", &by_joint<ArmCompliance, &ArmCompliance::gear_stiffness>,
                     &set_by_joint<ArmCompliance, &ArmCompliance::gear_stiffness>)
        .def_prop_rw("gear_damping", &by_joint<ArmCompliance, &ArmCompliance::gear_damping>,
                     &set_by_joint<ArmCompliance, &ArmCompliance::gear_damping>)
        .def_prop_rw("servo_bandwidth", &by_joint<ArmCompliance, &ArmCompliance::servo_bandwidth>,
                     &set_by_joint<ArmCompliance, &ArmCompliance::servo_bandwidth>)
        .def_prop_rw("servo_position_gain", &by_joint<ArmCompliance, &ArmCompliance::servo_position_gain>,
                     &set_by_joint<ArmCompliance, &ArmCompliance::servo_position_gain>)
        .def_prop_rw("acceleration_feedforward", &by_joint<ArmCompliance, &ArmCompliance::acceleration_feedforward>,
                     &set_by_joint<ArmCompliance, &ArmCompliance::acceleration_feedforward>);
    nb::class_<ElasticArm>(module, "ElasticArm", "An arm with elastic gears in a pose; without joints it is rigid.")
        .def(nb::init<>())
        .def(
            "__init__",
            [](ElasticArm* self, const Chain& chain, const ArmCompliance& given, Vector q, Vector torque_per_newton,
               Vector rate_per_speed) {
                new (self)
                    ElasticArm(elastic_arm(chain, given, q.data(), torque_per_newton.data(), rate_per_speed.data()));
            },
            nb::arg("chain"), nb::arg("given"), nb::arg("q"), nb::arg("torque_per_newton"), nb::arg("rate_per_speed"))
        .def("matrix", &matrix_of, nb::arg("body"), nb::arg("in_contact"),
             "The first-order system of arm and body (N, N): links, rotors, body, and their scaled rates.");
    nb::class_<ContactCourse>(module, "ContactCourse", "One collision in time.")
        .def_prop_ro("force", [](const ContactCourse& self) { return view(self.force); })
        .def_prop_ro(
            "residual",
            [](const ContactCourse& self) {
                const std::size_t steps = self.force.size();
                return view(self.residual.data(), {steps, self.residual.size() / std::max<std::size_t>(steps, 1)});
            })
        .def_ro("peak", &ContactCourse::peak)
        .def_ro("duration", &ContactCourse::duration);
    module.def(
        "contact_course",
        [](const ElasticArm& arm, const ContactBody& body, double step, Vector path, double offset,
           std::size_t reaction) {
            return unlocked([&] {
                const ContactPropagator by(ContactSystem(arm, body), step);
                return contact_course(by, {path.data(), path.shape(0)}, offset, reaction);
            });
        },
        nb::arg("arm"), nb::arg("body"), nb::arg("step"), nb::arg("path"), nb::arg("offset"), nb::arg("reaction"),
        "A collision along a path: distances after every step [m], the body standing at an offset [m]; after a step it "
        "is a reaction.");
    nb::enum_<ContactQuantity>(module, "ContactQuantity")
        .value("peak_force", ContactQuantity::peak_force)
        .value("duration", ContactQuantity::duration)
        .value("force_at_detection", ContactQuantity::force_at_detection);
    nb::class_<CellMixture>(module, "CellMixture", "A distribution put together from many small pieces.")
        .def(
            "__init__",
            [](CellMixture* self, Vector low, Vector high, Vector mass, Vector node, Vector node_mass) {
                new (self) CellMixture();
                for (std::size_t i = 0; i < mass.shape(0); ++i) self->add_cell(low(i), high(i), mass(i));
                for (std::size_t i = 0; i < node.shape(0); ++i) self->add_node(node(i), node_mass(i));
            },
            nb::arg("low"), nb::arg("high"), nb::arg("mass"), nb::arg("node"), nb::arg("node_mass"))
        .def_prop_ro("total", &CellMixture::total)
        .def_prop_ro("infinite", &CellMixture::infinite)
        .def_prop_ro("mean", [](const CellMixture& self) { return self.moments().mean; })
        .def_prop_ro("sd", [](const CellMixture& self) { return self.moments().sd; })
        .def("above", &CellMixture::above<L>, nb::arg("x"), "P(value > x).")
        .def("upper_quantile", &CellMixture::upper_quantile<L>, nb::arg("allowed"),
             "The smallest x with P(value > x) <= allowed.");
    module.attr("transient_phase_s") = transient_phase;
    nb::class_<PhaseShares>(module, "PhaseShares", "What newtons count for in the transient phase, and after it.")
        .def(
            "__init__",
            [](PhaseShares* self, double transient, double lasting) {
                new (self) PhaseShares{transient, lasting};
            },
            nb::arg("transient"), nb::arg("lasting"));
    module.def(
        "contact_mixture",
        [](const CollisionDistribution& distribution, ContactQuantity quantity, std::optional<double> never,
           std::optional<PhaseShares> phases) {
            return unlocked([&] { return contact_mixture<L>(distribution, quantity, never, phases); });
        },
        nb::arg("distribution"), nb::arg("quantity"), nb::arg("never").none() = nb::none(),
        nb::arg("phases").none() = nb::none(), "A quantity of collisions in which something gives way.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
