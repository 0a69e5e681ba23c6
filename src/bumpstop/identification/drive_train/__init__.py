"""Rotors, servos and gears of an arm from its recordings and from static pushes."""

from bumpstop.identification.drive_train.drive_train_fit import DriveTrainFit, identify_drive_train
from bumpstop.identification.drive_train.gear_stiffness import Pushes, identify_gear_stiffness
from bumpstop.identification.drive_train.joint_values import JointValues
from bumpstop.identification.drive_train.rotors import identify_rotors
from bumpstop.identification.drive_train.servo_fit import ServoFit, identify_servo

__all__ = [
    "DriveTrainFit",
    "JointValues",
    "Pushes",
    "ServoFit",
    "identify_drive_train",
    "identify_gear_stiffness",
    "identify_rotors",
    "identify_servo",
]
