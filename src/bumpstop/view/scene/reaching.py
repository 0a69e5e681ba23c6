"""Poses that reach for a place: inverse kinematics for the hand that a person drags."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.model import Robot

# A radian of orientation counts as so many metres of position, and a radian away from the pose before as so many.
_METRES_PER_RADIAN, _REST_PER_RADIAN = 0.3, 1e-3
_MAX_EVALUATIONS = 60


def reach_for(robot: Robot, q: FloatArray, X_BT: FloatArray, *, turned: bool = True) -> FloatArray:
    """The pose near another whose tip comes nearest a place, within the joints' limits.

    scipy's bounded trust-region least squares on our Jacobian: it needs no solver of quadratic programs, and limits are
    kept as bounds.

    Args:
        robot: the arm.
        q: pose to start from (dof,) [rad or m].
        X_BT: pose of the tip in the base frame to reach for (4, 4).
        turned: its orientation counts, too.

    Returns:
        Joint positions (dof,) [rad or m].
    """
    from scipy.optimize import least_squares

    rest = _REST_PER_RADIAN * np.eye(robot.dof)

    def error(x: FloatArray) -> FloatArray:
        X = robot.pose(x)
        turn = _METRES_PER_RADIAN * _rotation_vector(X[:3, :3] @ X_BT[:3, :3].T) if turned else np.zeros(0)
        return np.concatenate([X[:3, 3] - X_BT[:3, 3], turn, rest @ (x - q)])

    def slope(x: FloatArray) -> FloatArray:
        J = robot.jacobian(x)
        return np.concatenate([J[:3], _METRES_PER_RADIAN * J[3:], rest] if turned else [J[:3], rest])

    # Bounds must leave room for the start.
    room = 1e-9 + 1e-9 * np.abs(q)
    low, high = np.minimum(robot.lower, q - room), np.maximum(robot.upper, q + room)
    found = least_squares(error, q, slope, bounds=(low, high), max_nfev=_MAX_EVALUATIONS, xtol=1e-10)
    return np.asarray(np.clip(found.x, robot.lower, robot.upper))


def _rotation_vector(R: FloatArray) -> FloatArray:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(R).as_rotvec())
