"""How far an arm reaches, and the search over its poses that tells it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.model.joint import Joint

_POSES, _BEST, _ROUNDS, _TRIALS = 4000, 6, 40, 48


def reach(joints: Sequence[Joint], tip: Callable[[FloatArray], FloatArray], *, slides: bool = True) -> float:
    """Farthest the tip gets from the axis of joint 1 within the limits; see :attr:`bumpstop.model.Robot.reach`.

    Random poses, then ever smaller random steps from the best of them. The generator's seed is fixed.

    Args:
        joints: of the arm.
        tip: gives where it is in poses (N, dof), base frame (N, 3) [m].
        slides: joints that slide move, too; else they stay at 0, or where it is beyond their limits at the nearer one.
    """

    def distance_at(q: FloatArray) -> FloatArray:
        return distance_from_axis(joints[0], tip(q))

    lower, upper = pose_range(joints)
    if not slides:
        turns = np.array([joint.kind == "revolute" for joint in joints])
        held = np.clip(0.0, lower, upper)
        lower, upper = np.where(turns, lower, held), np.where(turns, upper, held)
    return greatest(distance_at, lower, upper)


def pose_range(joints: Sequence[Joint]) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest positions (dof,) that make all poses: the limits, of joints that turn one turn at most."""
    turns = np.array([joint.kind == "revolute" for joint in joints])
    lower, upper = np.array([joint.lower for joint in joints]), np.array([joint.upper for joint in joints])
    lower = np.where(turns, np.maximum(lower, -math.pi), lower)
    return lower, np.where(turns, np.minimum(upper, lower + 2 * math.pi), upper)


def greatest(value_at: Callable[[FloatArray], FloatArray], lower: FloatArray, upper: FloatArray) -> float:
    """Greatest value that poses between two have, by a search; infinite where one of them is.

    Args:
        value_at: of poses (N, dof), (N,).
        lower: positions (dof,) [rad or m].
        upper: likewise.
    """
    if not np.isfinite(upper - lower).all():
        return math.inf
    dof, rng = lower.size, np.random.default_rng(1)
    q = rng.uniform(lower, upper, size=(_POSES, dof))
    best = q[np.argsort(value_at(q))[-_BEST:]]
    for step in np.geomspace(0.3, 1e-4, _ROUNDS):
        tried = best[:, None] + step * (upper - lower) * rng.normal(size=(_BEST, _TRIALS, dof))
        tried = np.concatenate([best[:, None], np.clip(tried, lower, upper)], axis=1)
        values = value_at(tried.reshape(-1, dof)).reshape(_BEST, -1)
        best = tried[np.arange(_BEST), values.argmax(axis=1)]
    return float(value_at(best).max())


def distance_from_axis(first: Joint, points: FloatArray) -> FloatArray:
    """Of points (N, 3) from the axis of the first joint, or from its place where it slides (N,) [m]."""
    place = points - np.asarray(first.origin)
    if first.kind == "revolute":
        axis = np.asarray(first.rotation) @ np.asarray(first.axis)
        place -= np.outer(place @ axis, axis)
    return np.asarray(np.linalg.norm(place, axis=1))
