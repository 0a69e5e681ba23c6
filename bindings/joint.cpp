// Joint torque from motor current.
#include "bumpstop/joint/joint_torque.hpp"
#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

// A column for each joint, brought forward row by row. `state` (3, n) is direction and both counts, and is updated.
NewArray<double>::Array joint_torques(const std::vector<JointTorqueParameters>& joints, Matrix current, Matrix qd,
                                      std::optional<Matrix> qdd,
                                      nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu> state) {
    const std::size_t rows = current.shape(0), columns = joints.size();
    NewArray<double> out({rows, columns});
    {
        nb::gil_scoped_release unlocked;
        for (std::size_t j = 0; j < columns; ++j) {
            const JointTorqueLaw<double> law(joints[j]);
            JointTorqueState<double> joint{state(0, j), state(1, j), state(2, j)};
            for (std::size_t i = 0; i < rows; ++i)
                out.data[i * columns + j] = joint_torque(law, current(i, j), qd(i, j), qdd ? (*qdd)(i, j) : 0.0, joint);
            state(0, j) = joint.direction;
            state(1, j) = joint.outside_current;
            state(2, j) = joint.outside_speed;
        }
    }
    return out.release();
}

}  // namespace

void bind_joint(nb::module_& module) {
    nb::enum_<CurrentMap>(module, "CurrentMap")
        .value("odd", CurrentMap::odd)
        .value("load_dependent", CurrentMap::load_dependent);
    nb::enum_<FrictionLaw>(module, "FrictionLaw")
        .value("power", FrictionLaw::power)
        .value("stribeck", FrictionLaw::stribeck);
    nb::class_<JointTorqueParameters>(module, "JointTorqueParameters", "One joint, in the units of the header.")
        .def(nb::init<>())
        .def_rw("map", &JointTorqueParameters::map)
        .def_rw("friction", &JointTorqueParameters::friction)
        .def_rw("A", &JointTorqueParameters::A)
        .def_rw("B", &JointTorqueParameters::B)
        .def_rw("D", &JointTorqueParameters::D)
        .def_rw("F", &JointTorqueParameters::F)
        .def_rw("coulomb", &JointTorqueParameters::coulomb)
        .def_rw("viscous", &JointTorqueParameters::viscous)
        .def_rw("stribeck", &JointTorqueParameters::stribeck)
        .def_rw("stribeck_speed", &JointTorqueParameters::stribeck_speed)
        .def_rw("load", &JointTorqueParameters::load)
        .def_rw("hysteresis", &JointTorqueParameters::hysteresis)
        .def_rw("inertia", &JointTorqueParameters::inertia)
        .def_rw("rest_speed", &JointTorqueParameters::rest_speed)
        .def_rw("current_low", &JointTorqueParameters::current_low)
        .def_rw("current_high", &JointTorqueParameters::current_high)
        .def_rw("speed_high", &JointTorqueParameters::speed_high);
    module.def("joint_torques", &joint_torques, nb::arg("joints"), nb::arg("current"), nb::arg("qd"),
               nb::arg("qdd").none(), nb::arg("state"), "Torques (N, n); `state` (3, n) is brought forward.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
