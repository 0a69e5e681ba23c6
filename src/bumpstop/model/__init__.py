"""Robots, their kinematics and their dynamics."""

from bumpstop.model.description import describe
from bumpstop.model.drive_train.drive_train import DriveTrain
from bumpstop.model.drive_train.drive_train_file import load_drive_train
from bumpstop.model.drive_train.entry import DriveTrainEntry
from bumpstop.model.dynamics import (
    coriolis_torque,
    gravity_torque,
    inverse_dynamics,
    manipulability,
    mass_matrix,
    singular_values,
)
from bumpstop.model.inertia import LinkInertia
from bumpstop.model.joint import Frame, Joint, rotation_from_rpy
from bumpstop.model.mass_definitions import EffectiveMassDefinition, effective_mass, with_rotors, with_some_inertia
from bumpstop.model.robot import Robot, robot_from_dict, robots
from bumpstop.model.units import unit_of
from bumpstop.model.urdf.writer import write_urdf

__all__ = [
    "DriveTrain",
    "DriveTrainEntry",
    "EffectiveMassDefinition",
    "Frame",
    "Joint",
    "LinkInertia",
    "Robot",
    "coriolis_torque",
    "describe",
    "effective_mass",
    "gravity_torque",
    "inverse_dynamics",
    "load_drive_train",
    "manipulability",
    "mass_matrix",
    "robot_from_dict",
    "robots",
    "rotation_from_rpy",
    "singular_values",
    "unit_of",
    "with_rotors",
    "with_some_inertia",
    "write_urdf",
]
