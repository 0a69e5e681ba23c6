"""Inertial parameters of what is fixed to the tip, and the torque they make."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.identification.dynamics.regressor import link_regressor

if TYPE_CHECKING:
    from bumpstop.identification.payload.payload import Payload
    from bumpstop.identification.segments.motion import UniformMotion
    from bumpstop.model import Robot


def payload_torque(robot: Robot, payload: Payload, motion: UniformMotion) -> FloatArray:
    """Torque (N, n) that a payload at the tip adds to a motion [Nm or N]."""
    center = np.asarray(payload.center)
    first = payload.mass * np.array([1.0, *center])
    parameters = tip_to_link(robot) @ np.concatenate([first, point_moments(first)])
    torque: FloatArray = (
        link_regressor(robot, motion.q, motion.qd, motion.qdd, motion.gravity, robot.dof - 1) @ parameters
    )
    return torque


def tip_to_link(robot: Robot) -> FloatArray:
    """Matrix (10, 10) from inertial parameters in the frame of the tip to those in the frame of the last link."""
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = np.asarray(robot.tip_rotation), robot.tip_origin
    return np.stack([parameters_of(X @ pseudo_inertia(unit) @ X.T) for unit in np.eye(10)], axis=1)


def pseudo_inertia(parameters: FloatArray) -> FloatArray:
    """Second moments of mass of a body as a 4 x 4 matrix (Wensing, Kim and Slotine 2018), positive definite for a body.

    Args:
        parameters: (10,) m, mx, my, mz, Ixx, Iyy, Izz, Ixy, Ixz, Iyz about the origin.
    """
    m, x, y, z, xx, yy, zz, xy, xz, yz = parameters
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    matrix = np.empty((4, 4))
    matrix[:3, :3] = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    matrix[:3, 3] = matrix[3, :3] = x, y, z
    matrix[3, 3] = m
    return matrix


def parameters_of(matrix: FloatArray) -> FloatArray:
    """The parameters (10,) of a pseudo-inertia (4, 4)."""
    spread = matrix[:3, :3]
    tensor = np.trace(spread) * np.eye(3) - spread
    return np.array([matrix[3, 3], *matrix[:3, 3], *np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]])


def point_moments(first: FloatArray) -> FloatArray:
    """Second moments (6,) of a point with this mass and these first moments (4,)."""
    mass, moment = first[0], first[1:]
    if not mass > 0:
        return np.zeros(6)
    tensor = (moment @ moment * np.eye(3) - np.outer(moment, moment)) / mass
    return np.array([*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]])
