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


def pose_values(opened: Opened, scenario: Scenario, q: FloatArray, *, dragged: bool = False) -> tuple[str, list[float]]:
    """The key of a pose as the scenario has it, and its values, which do not leave the limits by rounding.

    Args:
        opened: whose robot it is.
        scenario: on screen.
        q: pose (dof,) [rad or m].
        dragged: a hand is there by eye: its values are rounded to what a person reads. Others keep twelve digits: 0.01
            degrees may turn a verdict.
    """
    degrees = scenario.pose_deg is not None
    turns = np.array([joint.kind == "revolute" for joint in opened.robot.joints])
    factor = np.where(turns & degrees, 180 / np.pi, 1.0)
    places = np.where(turns & degrees, 2, 4)
    values = []
    for value, low, high, scale, digits in zip(q, opened.robot.lower, opened.robot.upper, factor, places, strict=True):
        shown = round(float(value * scale), int(digits)) if dragged else float(f"{value * scale:.12g}")
        # Rounding must not leave the limits.
        if not low <= shown / scale <= high:
            shown = float(np.clip(value, low, high) * scale)
        values.append(shown)
    return ("pose_deg" if degrees else "pose_rad"), values
