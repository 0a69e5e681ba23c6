"""The pose of a scenario on the page, and its keys when a person moves it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import Scenario
    from bumpstop.view.opened import Opened


def pose_of(opened: Opened, scenario: Scenario) -> FloatArray:
    """The pose of a scenario with a straight line (dof,) [rad or m]."""
    from bumpstop.collision.scenario_values import start_pose

    return start_pose(scenario, opened.robot)


def pose_values(opened: Opened, scenario: Scenario, q: FloatArray) -> tuple[str, list[float]]:
    """The key of a pose as the scenario has it, and its values rounded inwards to what a person reads."""
    degrees = scenario.pose_deg is not None
    turns = np.array([joint.kind == "revolute" for joint in opened.robot.joints])
    factor = np.where(turns & degrees, 180 / np.pi, 1.0)
    places = np.where(turns & degrees, 2, 4)
    values = []
    for value, low, high, scale, digits in zip(q, opened.robot.lower, opened.robot.upper, factor, places, strict=True):
        shown = round(float(value * scale), int(digits))
        # Rounding must not leave the limits.
        if not low <= shown / scale <= high:
            shown = float(np.clip(value, low, high) * scale)
        values.append(shown)
    return ("pose_deg" if degrees else "pose_rad"), values
