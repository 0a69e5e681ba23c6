"""How far an arm reaches, by a search over its poses."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray

if TYPE_CHECKING:
    from bumpstop.model.robot import Robot

_POSES, _BEST, _ROUNDS, _TRIALS = 4000, 6, 40, 48


def reach(robot: Robot) -> float:
    """Farthest the tip gets from the axis of joint 1 within the limits; see :attr:`bumpstop.model.Robot.reach`.

    Random poses, then ever smaller random steps from the best of them. The generator's seed is fixed.
    """
    turns = np.array([joint.kind == "revolute" for joint in robot.joints])
    lower = np.where(turns, np.maximum(robot.lower, -math.pi), robot.lower)
    upper = np.where(turns, np.minimum(robot.upper, lower + 2 * math.pi), robot.upper)
    if not np.isfinite(upper - lower).all():
        return math.inf
    rng = np.random.default_rng(1)
    q = rng.uniform(lower, upper, size=(_POSES, robot.dof))
    best = q[np.argsort(distance_from_axis(robot, q))[-_BEST:]]
    for step in np.geomspace(0.3, 1e-4, _ROUNDS):
        tried = best[:, None] + step * (upper - lower) * rng.normal(size=(_BEST, _TRIALS, robot.dof))
        tried = np.concatenate([best[:, None], np.clip(tried, lower, upper)], axis=1)
        distance = distance_from_axis(robot, tried.reshape(-1, robot.dof)).reshape(_BEST, -1)
        best = tried[np.arange(_BEST), distance.argmax(axis=1)]
    return float(distance_from_axis(robot, best).max())


def distance_from_axis(robot: Robot, q: FloatArray) -> FloatArray:
    """Of the tip from the axis of joint 1, or from its place where it slides (N,) [m]."""
    first = robot.joints[0]
    place = robot.pose(q)[:, :3, 3] - np.asarray(first.origin)
    if first.kind == "revolute":
        axis = np.asarray(first.rotation) @ np.asarray(first.axis)
        place -= np.outer(place @ axis, axis)
    return np.asarray(np.linalg.norm(place, axis=1))
