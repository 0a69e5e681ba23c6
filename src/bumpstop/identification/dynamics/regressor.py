"""The torque of a chain as a linear function of its unknown parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray

if TYPE_CHECKING:
    from bumpstop.model import Robot

INERTIAL = ("m", "mx", "my", "mz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""Parameters of a link: mass [kg], first moments [kg m] and second moments about the origin of its frame [kg m2]."""

# Places of the second moments in a tensor.
_TENSOR = {"Ixx": (0, 0), "Iyy": (1, 1), "Izz": (2, 2), "Ixy": (0, 1), "Ixz": (0, 2), "Iyz": (1, 2)}


def inertial_names(robot: Robot) -> list[str]:
    """Names of the columns of :func:`inertial_regressor`, ``m_1`` to ``Iyz_n``; links are numbered from 1."""
    return [f"{name}_{link + 1}" for link in range(robot.dof) for name in INERTIAL]


def inertial_regressor(
    robot: Robot, q: FloatArray, qd: FloatArray, qdd: FloatArray, gravity: tuple[float, float, float]
) -> FloatArray:
    """Columns Y with tau = Y p for the inertial parameters p of every link.

    Newton-Euler torque is linear in mass, first moments and second moments about the link's origin, so every column is
    what Newton-Euler says of a chain with one parameter at one and all others at zero.

    Args:
        robot: its chain; inertia it may have is not used.
        q: joint positions (N, dof) [rad or m].
        qd: joint velocities (N, dof).
        qdd: joint accelerations (N, dof).
        gravity: acceleration of free fall, base frame [m/s2].

    Returns:
        (N, dof, 10 dof) [Nm or N per unit of the parameter].
    """
    links = [link_regressor(robot, q, qd, qdd, gravity, link) for link in range(robot.dof)]
    return np.concatenate(links, axis=2)


def link_regressor(
    robot: Robot, q: FloatArray, qd: FloatArray, qdd: FloatArray, gravity: tuple[float, float, float], link: int
) -> FloatArray:
    """Columns (N, dof, 10) of one link, numbered from 0; arguments as for :func:`inertial_regressor`."""
    nothing = _native.LinkInertia(0.0, np.zeros(3), np.zeros((3, 3)), 0.0)

    def torque(mass: float, center: FloatArray, tensor: FloatArray) -> FloatArray:
        links = [nothing] * robot.dof
        links[link] = _native.LinkInertia(mass, center, tensor, 0.0)
        return _torque(robot, q, qd, qdd, gravity, links)

    columns = np.empty((q.shape[0], robot.dof, 10))
    of_mass = torque(1.0, np.zeros(3), np.zeros((3, 3)))
    columns[:, :, 0] = of_mass
    for axis in range(3):
        center = np.eye(3)[axis]
        # A unit mass off the origin has second moments there; a negative tensor about its centre takes them away.
        tensor = np.outer(center, center) - np.eye(3)
        columns[:, :, 1 + axis] = torque(1.0, center, tensor) - of_mass
    for place, name in enumerate(INERTIAL[4:], start=4):
        tensor = np.zeros((3, 3))
        row, column = _TENSOR[name]
        tensor[row, column] = tensor[column, row] = 1.0
        columns[:, :, place] = torque(0.0, np.zeros(3), tensor)
    return columns


def inertial_torque(
    robot: Robot,
    q: FloatArray,
    qd: FloatArray,
    qdd: FloatArray,
    gravity: tuple[float, float, float],
    values: FloatArray,
) -> FloatArray:
    """Torque (N, dof) of inertial parameters (10 dof,): :func:`inertial_regressor` times them, without its columns.

    Mass m, first moments h and second moments I of a link are those of a unit mass at h with the moments I about its
    origin, less a mass of 1 - m at the origin. Newton-Euler of the two chains is linear in both.
    """
    dof = robot.dof
    own = values.reshape(dof, 10)
    h = own[:, 1:4]
    moments = own[:, [4, 7, 8, 7, 5, 9, 8, 9, 6]].reshape(dof, 3, 3)
    shifted = (h**2).sum(axis=1)[:, None, None] * np.eye(3) - h[:, :, None] * h[:, None, :]
    bodies = [_native.LinkInertia(1.0, h[i], moments[i] - shifted[i], 0.0) for i in range(dof)]
    surplus = [_native.LinkInertia(1 - own[i, 0], np.zeros(3), np.zeros((3, 3)), 0.0) for i in range(dof)]
    torque: FloatArray = _torque(robot, q, qd, qdd, gravity, bodies) - _torque(robot, q, qd, qdd, gravity, surplus)
    return torque


def _torque(
    robot: Robot,
    q: FloatArray,
    qd: FloatArray,
    qdd: FloatArray,
    gravity: tuple[float, float, float],
    links: list[_native.LinkInertia],
) -> FloatArray:
    kernel = _native.Dynamics(robot.chain, links)
    torque: FloatArray = kernel.inverse_dynamics(q, qd, qdd, np.array(gravity))
    return torque
