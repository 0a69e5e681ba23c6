// What a collision is made of: arm, motion, contact point, reaction, detector and body.
#include "bumpstop/collision/collision_setup.hpp"
#include "bumpstop/collision/contact/contact.hpp"
#include "bumpstop/detection/gaussian_thresholds.hpp"
#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

void bind_setup(nb::module_& module) {
    nb::enum_<ReactionKind>(module, "ReactionKind")
        .value("stop", ReactionKind::stop)
        .value("reverse", ReactionKind::reverse);
    nb::enum_<OffsetKind>(module, "OffsetKind")
        .value("half_normal", OffsetKind::half_normal)
        .value("uniform", OffsetKind::uniform)
        .value("fixed", OffsetKind::fixed);
    nb::class_<MotionSettings>(module, "MotionSettings",
                               "The straight motion of the tool and the limits of the joints.")
        .def_rw("tip", &MotionSettings::tip)
        .def_rw("task_rows", &MotionSettings::task_rows)
        .def_prop_rw(
            "free_joints",
            [](const MotionSettings& self) {
                return std::vector<int>(self.free_joint.begin(), self.free_joint.begin() + self.free_count);
            },
            [](MotionSettings& self, const std::vector<int>& joints) {
                self.free_count = int(joints.size());
                std::copy(joints.begin(), joints.end(), self.free_joint.begin());
            })
        .def_rw("damping", &MotionSettings::damping)
        .def_rw("step", &MotionSettings::step)
        .def_rw("substeps", &MotionSettings::substeps)
        .def_prop_rw("acceleration_limit", &by_joint<MotionSettings, &MotionSettings::acceleration_limit>,
                     &set_by_joint<MotionSettings, &MotionSettings::acceleration_limit>)
        .def_prop_rw("velocity_limit", &by_joint<MotionSettings, &MotionSettings::velocity_limit>,
                     &set_by_joint<MotionSettings, &MotionSettings::velocity_limit>)
        .def_prop_rw("lower", &by_joint<MotionSettings, &MotionSettings::lower>,
                     &set_by_joint<MotionSettings, &MotionSettings::lower>)
        .def_prop_rw("upper", &by_joint<MotionSettings, &MotionSettings::upper>,
                     &set_by_joint<MotionSettings, &MotionSettings::upper>)
        .def_rw("deceleration", &MotionSettings::deceleration);
    nb::class_<ContactGeometry>(module, "ContactGeometry", "Where and in which direction the arm hits.")
        .def_rw("point", &ContactGeometry::point)
        .def_rw("along_motion", &ContactGeometry::along_motion)
        .def_rw("normal", &ContactGeometry::normal);
    nb::class_<Timing>(module, "Timing", "How long the motion is and how often the detector looks.")
        .def_rw("steps", &Timing::steps)
        .def_rw("period", &Timing::period)
        .def_rw("latency", &Timing::latency)
        .def_rw("from_rest", &Timing::from_rest);
    nb::class_<CollisionSetup>(module, "CollisionSetup", "Arm, motion, contact point and reaction.")
        .def(
            "__init__",
            [](CollisionSetup* self, const Chain& chain) {
                new (self) CollisionSetup();
                self->chain = chain;
            },
            nb::arg("chain"))
        .def_rw("motion", &CollisionSetup::motion)
        .def_rw("contact", &CollisionSetup::contact)
        .def_rw("timing", &CollisionSetup::timing)
        .def_rw("arm", &CollisionSetup::arm)
        .def_rw("reaction", &CollisionSetup::reaction);
    nb::class_<OffsetDistribution>(module, "OffsetDistribution", "How far the body is when the motion begins.")
        .def_rw("kind", &OffsetDistribution::kind)
        .def_rw("size", &OffsetDistribution::size);
    nb::class_<ContactBody>(module, "ContactBody", "A spring with damping against the ground or against a mass.")
        .def(nb::init<>())
        .def_rw("stiffness", &ContactBody::stiffness)
        .def_rw("damping", &ContactBody::damping)
        .def_rw("mass", &ContactBody::mass)
        .def_rw("ground_stiffness", &ContactBody::ground_stiffness);
    nb::class_<Contact>(module, "Contact", "What the arm meets, and where.")
        .def(nb::init<>())
        .def_rw("body", &Contact::body)
        .def_rw("offset", &Contact::offset);
    nb::class_<GaussianThresholds>(module, "GaussianThresholds", "Thresholds and Gaussian noise per joint.")
        .def(
            "__init__",
            [](GaussianThresholds* self, Vector threshold, Vector sd, Vector mean) {
                new (self) GaussianThresholds();
                for (std::size_t j = 0; j < threshold.shape(0); ++j) self->add_joint(threshold(j), sd(j), mean(j));
            },
            nb::arg("threshold"), nb::arg("sd"), nb::arg("mean"))
        .def_rw("arming_delay", &GaussianThresholds::arming_delay)
        .def_rw("correlation", &GaussianThresholds::correlation)
        .def_rw("filter", &GaussianThresholds::filter)
        .def(
            "alarm_probability",
            [](const GaussianThresholds& self, Vector torque) {
                const auto chance = any_alarm<double>(self, [&](int w) { return torque(self.joint[w]); });
                return nb::make_tuple(chance.alarm, chance.no_alarm);
            },
            nb::arg("torque"), "Probability that a tick with these noiseless residuals alarms, and its complement.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
