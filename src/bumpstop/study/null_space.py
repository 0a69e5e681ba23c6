"""Detectability of a redundant arm: the same pose of the tool with other joint positions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionProblem

_STEP = 0.05  # along the self-motion [rad or m]
_MAX_STEPS = 40
_CORRECTIONS = 2
# The tool may be off its pose by this much [m, rad].
_POSE = 1e-6


@dataclass(frozen=True, eq=False)
class Suggestion:
    """Joint positions with the smallest undetectable force that a self-motion of the arm reaches.

    Attributes:
        q: (N, dof) [rad or m]; the given ones where none is better.
        undetectable: there (N,) [N].
        gain: undetectable force as given, over that (N,), at least 1.
    """

    q: FloatArray
    undetectable: FloatArray
    gain: FloatArray


def check_redundant(problem: CollisionProblem) -> None:
    """Refuse an arm that has no joint to spare, or more than one."""
    free = problem.robot.dof - len(problem.held)
    if free != 7:
        raise InputError(
            "--null-space",
            f"{problem.robot.name} has {free} free joints",
            "wanted 7: one more than a pose of the tool needs",
        )


def improve_detectability(problem: CollisionProblem, q: FloatArray, direction: FloatArray) -> Suggestion:
    """Follow the self-motion both ways within the joint limits, and keep the best place.

    The tool keeps position and orientation. Contact is at the tip, and the force along ``direction``.

    Args:
        problem: says thresholds and held joints.
        q: (N, dof) [rad or m].
        direction: unit vectors, base frame (N, 3).

    Raises:
        InputError: the arm has no joint to spare.
    """
    check_redundant(problem)
    robot = problem.robot
    free = [j for j in range(robot.dof) if j not in problem.held]
    best_q, best = q.copy(), _undetectable(problem, q, direction)
    given = best.copy()
    goal = robot.pose(q)
    for way in (1.0, -1.0):
        here, last = q.copy(), None
        alive = np.ones(len(q), dtype=bool)
        for _ in range(_MAX_STEPS):
            null = _null(robot.jacobian(here)[:, :, free])
            turn = np.sign((null * last).sum(axis=1)) if last is not None else way * np.sign(null[:, 0] + 1e-300)
            last = null * np.where(turn == 0, 1.0, turn)[:, None]
            trial = here.copy()
            trial[:, free] += _STEP * last
            for _ in range(_CORRECTIONS):
                jacobian = robot.jacobian(trial)[:, :, free]
                trial[:, free] += np.einsum(
                    "nij,nj->ni", np.linalg.pinv(jacobian, rcond=1e-3), _error(robot.pose(trial), goal)
                )
            kept = np.abs(_error(robot.pose(trial), goal)).max(axis=1) < _POSE
            alive &= kept & ~robot.beyond_limits(trial).any(axis=1)
            if not alive.any():
                break
            here = np.where(alive[:, None], trial, here)
            force = _undetectable(problem, here, direction)
            better = alive & (force < best)
            best[better], best_q[better] = force[better], here[better]
    with np.errstate(invalid="ignore", divide="ignore"):
        gain = np.where(best < given, given / best, 1.0)
    return Suggestion(best_q, best, gain)


def _undetectable(problem: CollisionProblem, q: FloatArray, direction: FloatArray) -> FloatArray:
    torque = np.einsum("nij,ni->nj", problem.robot.jacobian(q)[:, :3], direction)
    with np.errstate(divide="ignore"):
        return np.asarray((problem.thresholds / np.abs(torque)).min(axis=1))


def _null(jacobian: FloatArray) -> FloatArray:
    """Unit vectors (N, 7) of the joint rates that leave the tool where it is."""
    return np.asarray(np.linalg.svd(jacobian)[2][:, -1])


def _error(pose: FloatArray, goal: FloatArray) -> FloatArray:
    """What brings the tool back, as a small displacement and rotation in the base frame (N, 6)."""
    turn = goal[:, :3, :3] @ pose[:, :3, :3].transpose(0, 2, 1)
    rotation = 0.5 * np.stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], axis=1
    )
    return np.concatenate([goal[:, :3, 3] - pose[:, :3, 3], rotation], axis=1)
