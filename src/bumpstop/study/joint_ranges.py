"""Ranges that poses all over a workspace are drawn from."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.collision import CollisionProblem


def joint_ranges(problem: CollisionProblem) -> list[tuple[int, float, float]]:
    """Joints that move, with the limits between which they are drawn; a joint without limits turns once.

    Returns:
        (number from 0, low, high) of each joint that is not held [rad or m].

    Raises:
        InputError: every joint is held, or one slides without limits.
    """
    found = []
    for j, joint in enumerate(problem.robot.joints):
        if j in problem.held:
            continue
        low, high = joint.lower, joint.upper
        if not (math.isfinite(low) and math.isfinite(high)):
            if joint.kind == "prismatic":
                raise InputError("robot", f"joint {j + 1} slides without limits", "wanted limits to draw between")
            low, high = -math.pi, math.pi
        found.append((j, low, high))
    if not found:
        raise InputError("motion.held_joints", "hold every joint", "at least one must move")
    return found
