"""The arm of a collision: rigid, or giving way in its gears and servos."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop import _native
from bumpstop.collision.scenario.arm_table import QUANTITY
from bumpstop.errors import InputError
from bumpstop.model import DriveTrain, Robot, load_drive_train

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario import Scenario


def drive_train_of(scenario: Scenario, robot: Robot) -> DriveTrain:
    """Rotors, gears and servos: the robot's own, then those of ``arm.file``, then the scenario's keys.

    Raises:
        InputError: a list of another length than the robot has joints, or a file that cannot be used.
    """
    table = scenario.arm
    found = robot.drive_train if table.file is None else load_drive_train(scenario.folder / table.file, robot)
    for key, quantity in QUANTITY.items():
        values = getattr(table, key)
        if values is None:
            continue
        if isinstance(values, list) and len(values) != robot.dof:
            raise InputError(
                f"arm.{key}",
                f"has {len(values)} values",
                f"{robot.name} has {robot.dof} joints: one for each, or one number for all",
            )
        unit = 2 * math.pi if key == "servo_bandwidth_hz" else 1.0
        found = found.with_values(quantity, np.multiply(values, unit), "unverified", "the scenario")
    return found


def check_inertia(robot: Robot) -> None:
    """Refuse an elastic arm whose inertia is not known, or implausible.

    Raises:
        InputError: a link has no inertia, or the inertia looks like placeholders.
    """
    if robot.inertia_objection:
        raise InputError(
            "arm.model",
            f"'elastic' needs a plausible inertia. {robot.inertia_objection.rstrip('.')}",
            "valid: 'rigid', or a robot with its real inertia",
        )


def compliance_of(drive_train: DriveTrain, robot: Robot) -> _native.ArmCompliance:
    """The same for the compiled module."""
    arm = _native.ArmCompliance(robot.dynamics)
    arm.rotor_inertia = drive_train.rotor_inertia
    arm.gear_stiffness = drive_train.gear_stiffness
    arm.gear_damping = drive_train.gear_damping
    arm.servo_bandwidth = drive_train.servo_bandwidth
    arm.servo_position_gain = drive_train.servo_position_gain
    arm.acceleration_feedforward = drive_train.acceleration_feedforward
    return arm
