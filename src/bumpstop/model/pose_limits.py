"""Poses that a person writes, against the limits of the joints."""

from __future__ import annotations

import math

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.model.robot import Robot


def check_pose(robot: Robot, q: FloatArray, field: str, *, in_degrees: bool) -> None:
    """Refuse a pose with a joint outside its limits.

    Args:
        robot: whose pose it is.
        q: joint positions (dof,) [rad or m].
        field: where the pose was written.
        in_degrees: angles were, so that the message speaks of degrees.

    Raises:
        InputError: names the joint, its position and its limits.
    """
    for j in np.flatnonzero(robot.beyond_limits(q)):
        joint = robot.joints[j]
        shown = [float(q[j]), joint.lower, joint.upper]
        unit = "rad" if joint.kind == "revolute" else "m"
        if in_degrees and joint.kind == "revolute":
            shown, unit = [math.degrees(x) for x in shown], "deg"
        at, low, high = shown
        raise InputError(field, f"joint {j + 1} at {at:g} is outside its limits", f"valid: {low:g} to {high:g} {unit}")
