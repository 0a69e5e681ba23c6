// Dynamics of chains with inertia, and singular values of their Jacobians.
#include "bumpstop/model/dynamics.hpp"

#include "bumpstop/model/singular_values.hpp"
#include "model/dynamics.hpp"
#include "model/registers.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using L = NativeLanes;

LinkInertia make_link(double mass, Vector center, Matrix tensor, double rotor) {
    LinkInertia link{mass, {center(0), center(1), center(2)}, {}, rotor};
    for (std::size_t k = 0; k < 3; ++k)
        for (std::size_t l = 0; l < 3; ++l) link.tensor[3 * k + l] = tensor(k, l);
    return link;
}

Point3<L> load_vectors(Matrix vectors, std::size_t first, int column = 0) {
    L v[6];
    load_rows(vectors, first, v);
    return {v[column], v[column + 1], v[column + 2]};
}

NewArray<double>::Array inverse_dynamics_of(const Dynamics& arm, Matrix q, Matrix qd, Matrix qdd, Vector gravity) {
    NewArray<double> out({q.shape(0), std::size_t(arm.chain.dof)});
    {
        nb::gil_scoped_release unlocked;
        const Vector3 g{gravity(0), gravity(1), gravity(2)};
        for_registers(arm.chain, q, [&](std::size_t first, int count, const L* position, const JointAngles<L>& angle) {
            L rate[max_joints], acceleration[max_joints], tau[max_joints];
            load_rows(qd, first, rate);
            load_rows(qdd, first, acceleration);
            inverse_dynamics(arm.chain, arm.inertias, {position, angle, rate, acceleration}, g, tau);
            store_rows(tau, arm.chain.dof, first, count, out.data.get());
        });
    }
    return out.release();
}

NewArray<double>::Array external_torques(const Dynamics& arm, Matrix q, Matrix wrench, int link, Vector point) {
    NewArray<double> out({q.shape(0), std::size_t(arm.chain.dof)});
    {
        nb::gil_scoped_release unlocked;
        const LinkPoint place = link_point(arm.chain, link, {point(0), point(1), point(2)});
        for_postures(arm.chain, q, [&](std::size_t first, int count, const Posture<L>& posture) {
            L tau[max_joints];
            const Wrench<L> outer{place, load_vectors(wrench, first), load_vectors(wrench, first, 3)};
            external_torque(arm.chain, posture, outer, tau);
            store_rows(tau, arm.chain.dof, first, count, out.data.get());
        });
    }
    return out.release();
}

NewArray<double>::Array gravity_torques(const Dynamics& arm, Matrix q, Vector gravity) {
    NewArray<double> out({q.shape(0), std::size_t(arm.chain.dof)});
    {
        nb::gil_scoped_release unlocked;
        const Vector3 g{gravity(0), gravity(1), gravity(2)};
        for_registers(arm.chain, q, [&](std::size_t first, int count, const L* position, const JointAngles<L>& angle) {
            L tau[max_joints];
            gravity_torque(arm.chain, arm.inertias, position, angle, g, tau);
            store_rows(tau, arm.chain.dof, first, count, out.data.get());
        });
    }
    return out.release();
}

NewArray<double>::Array coriolis_torques(const Dynamics& arm, Matrix q, Matrix qd) {
    NewArray<double> out({q.shape(0), std::size_t(arm.chain.dof)});
    {
        nb::gil_scoped_release unlocked;
        for_registers(arm.chain, q, [&](std::size_t first, int count, const L* position, const JointAngles<L>& angle) {
            L rate[max_joints], tau[max_joints];
            load_rows(qd, first, rate);
            coriolis_torque(arm.chain, arm.inertias, position, angle, rate, tau);
            store_rows(tau, arm.chain.dof, first, count, out.data.get());
        });
    }
    return out.release();
}

NewArray<double>::Array mass_matrices(const Dynamics& arm, Matrix q) {
    const std::size_t dof = std::size_t(arm.chain.dof);
    NewArray<double> out({q.shape(0), dof, dof});
    {
        nb::gil_scoped_release unlocked;
        for_registers(arm.chain, q, [&](std::size_t first, int count, const L* position, const JointAngles<L>& angle) {
            L m[max_joints][max_joints];
            mass_matrix(arm.chain, arm.inertias, position, angle, m);
            for (int lane = 0; lane < count; ++lane)
                for (std::size_t i = 0; i < dof; ++i)
                    for (std::size_t j = 0; j < dof; ++j)
                        out.data[((first + lane) * dof + i) * dof + j] = m[i][j][lane];
        });
    }
    return out.release();
}

NewArray<double>::Array effective_masses(const Dynamics& arm, Matrix q, Matrix direction, int link, Vector point) {
    NewArray<double> out({q.shape(0)});
    {
        nb::gil_scoped_release unlocked;
        const LinkPoint place = link_point(arm.chain, link, {point(0), point(1), point(2)});
        for_registers(arm.chain, q, [&](std::size_t first, int count, const L* position, const JointAngles<L>& angle) {
            const L mass =
                effective_mass(arm.chain, arm.inertias, position, angle, place, load_vectors(direction, first));
            store_rows(&mass, 1, first, count, out.data.get());
        });
    }
    return out.release();
}

template <int Rows>
NewArray<double>::Array singular_values_of_rows(const Chain& chain, Matrix q, int link, Vector point) {
    NewArray<double> out({q.shape(0), std::size_t(Rows)});
    {
        nb::gil_scoped_release unlocked;
        const LinkPoint place = link_point(chain, link, {point(0), point(1), point(2)});
        for_postures(chain, q, [&](std::size_t first, int count, const Posture<L>& posture) {
            L values[Rows];
            singular_values<Rows>(chain, posture, place, values);
            store_rows(values, Rows, first, count, out.data.get());
        });
    }
    return out.release();
}

template <int Rows>
NewArray<double>::Array manipulability_of_rows(const Chain& chain, Matrix q, int link, Vector point) {
    NewArray<double> out({q.shape(0)});
    {
        nb::gil_scoped_release unlocked;
        const LinkPoint place = link_point(chain, link, {point(0), point(1), point(2)});
        for_postures(chain, q, [&](std::size_t first, int count, const Posture<L>& posture) {
            const L measure = manipulability<Rows>(chain, posture, place);
            store_rows(&measure, 1, first, count, out.data.get());
        });
    }
    return out.release();
}

}  // namespace

void bind_dynamics(nb::module_& module) {
    nb::class_<LinkInertia>(module, "LinkInertia", "Inertia of a link in its own frame, and of its motor.")
        .def(
            "__init__",
            [](LinkInertia* self, double mass, Vector center, Matrix tensor, double rotor) {
                new (self) LinkInertia(make_link(mass, center, tensor, rotor));
            },
            nb::arg("mass"), nb::arg("center"), nb::arg("tensor"), nb::arg("rotor"));
    nb::class_<Dynamics>(module, "Dynamics", "A chain with the inertia of its links.")
        .def(
            "__init__",
            [](Dynamics* self, const Chain& chain, const std::vector<LinkInertia>& links) {
                new (self) Dynamics{chain, Inertias(chain, links)};
            },
            nb::arg("chain"), nb::arg("links"))
        .def("inverse_dynamics", &inverse_dynamics_of, nb::arg("q"), nb::arg("qd"), nb::arg("qdd"), nb::arg("gravity"),
             "Torques (N, dof) of the motors without contact.")
        .def("external_torque", &external_torques, nb::arg("q"), nb::arg("wrench"), nb::arg("link"), nb::arg("point"),
             "Torques (N, dof) of a wrench (N, 6) on the robot at `point` of `link`.")
        .def("gravity_torque", &gravity_torques, nb::arg("q"), nb::arg("gravity"), "Torques (N, dof) at rest.")
        .def("coriolis_torque", &coriolis_torques, nb::arg("q"), nb::arg("qd"),
             "Torques (N, dof) at constant rates without gravity.")
        .def("mass_matrix", &mass_matrices, nb::arg("q"), "Mass matrices (N, dof, dof).")
        .def("effective_mass", &effective_masses, nb::arg("q"), nb::arg("direction"), nb::arg("link"), nb::arg("point"),
             "Effective masses (N,) along `direction` (N, 3); NaN: the mass matrix is singular.");
    const auto singular = [](const Chain& chain, Matrix q, int link, Vector point, bool angular) {
        return angular ? singular_values_of_rows<6>(chain, q, link, point)
                       : singular_values_of_rows<3>(chain, q, link, point);
    };
    const auto measure = [](const Chain& chain, Matrix q, int link, Vector point, bool angular) {
        return angular ? manipulability_of_rows<6>(chain, q, link, point)
                       : manipulability_of_rows<3>(chain, q, link, point);
    };
    module.def("singular_values", singular, nb::arg("chain"), nb::arg("q"), nb::arg("link"), nb::arg("point"),
               nb::arg("angular"), "Singular values (N, 3 or 6) of the Jacobian, largest first.");
    module.def("manipulability", measure, nb::arg("chain"), nb::arg("q"), nb::arg("link"), nb::arg("point"),
               nb::arg("angular"), "Products (N,) of the singular values.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
