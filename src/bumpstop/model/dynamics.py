"""Dynamics of a robot: what its motors must give, how heavy it is to a push, how well a point can be moved.

Everything takes joint positions ``q`` of shape (dof,) or (N, dof), and gives one result or N. Rates and accelerations
have the shape of ``q``. Vectors are in the base frame B; a point is in the frame of its link. A prismatic joint has m
for rad and N for Nm.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bumpstop import _native
from bumpstop.arrays import as_float_array, as_rows
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bumpstop.arrays import FloatArray
    from bumpstop.model.robot import Robot

    Vector = Sequence[float] | npt.ArrayLike

JacobianRows = Literal["linear", "all"]
STANDARD_GRAVITY = (0.0, 0.0, -9.80665)  # acceleration of free fall, frame of an upright base [m/s2]
FREE_FALL = (9.7, 9.9)  # its size on this planet, at any height that robots stand at [m/s2]


def check_free_fall(gravity: Sequence[float], field: str) -> None:
    """Refuse an acceleration of free fall (3,) that no robot on this planet feels: 1 for a direction, 980 for cm/s2.

    Raises:
        InputError: about ``field``: its size is not that of ``FREE_FALL``.
    """
    size, (low, high) = math.hypot(*gravity), FREE_FALL
    if not low <= size <= high:
        valid = f"wanted X,Y,Z of {low:g} to {high:g} in all, as 0,0,9.80665 on a ceiling or -9.80665,0,0 on a wall"
        raise InputError(field, f"is {size:.4g} m/s2 in all", valid)


def inverse_dynamics(
    robot: Robot,
    q: npt.ArrayLike,
    qd: npt.ArrayLike,
    qdd: npt.ArrayLike,
    *,
    gravity: Vector = STANDARD_GRAVITY,
    wrench: npt.ArrayLike | None = None,
    link: str | None = None,
    point: Vector = (0.0, 0.0, 0.0),
) -> FloatArray:
    """Torques of the motors for a motion: tau = M(q) qdd + C(q, qd) qd + g(q) - J' wrench.

    Recursive Newton-Euler. A rotor adds its inertia times its joint's acceleration; that the links before carry it
    around as well is neglected.

    Args:
        robot: with inertia.
        q: joint positions, (dof,) or (N, dof) [rad].
        qd: joint rates, shape of ``q`` [rad/s].
        qdd: joint accelerations, shape of ``q`` [rad/s2].
        gravity: acceleration of free fall in B [m/s2].
        wrench: what the environment exerts on the robot: force [N], then moment about the point [Nm], in B. (6,), or
            (N, 6) with a row for each of ``q``. None: nothing.
        link: name of the link it acts on; default: the tip.
        point: where it acts, in the link's frame [m].

    Returns:
        (dof,) or (N, dof) [Nm], positive along the joints.
    """
    rows, single = as_rows(q, "q", robot.dof)
    number, offset = robot.frame(link, point)
    tau = robot.dynamics.inverse_dynamics(
        rows, _like(rows, single, qd, "qd"), _like(rows, single, qdd, "qdd"), as_float_array(gravity, "gravity", (3,))
    )
    if wrench is not None:
        outer = _for_each(wrench, "wrench", 6, len(rows), single)
        tau -= robot.dynamics.external_torque(rows, outer, number, np.ascontiguousarray(offset))
    return one_or_all(tau, single)


def gravity_torque(robot: Robot, q: npt.ArrayLike, *, gravity: Vector = STANDARD_GRAVITY) -> FloatArray:
    """Torques that hold the robot still: g(q).

    Args:
        robot: with inertia.
        q: joint positions, (dof,) or (N, dof) [rad].
        gravity: acceleration of free fall in B [m/s2].

    Returns:
        (dof,) or (N, dof) [Nm].
    """
    rows, single = as_rows(q, "q", robot.dof)
    return one_or_all(robot.dynamics.gravity_torque(rows, as_float_array(gravity, "gravity", (3,))), single)


def coriolis_torque(robot: Robot, q: npt.ArrayLike, qd: npt.ArrayLike) -> FloatArray:
    """Torques that keep the joint rates constant, without gravity: C(q, qd) qd.

    Args:
        robot: with inertia.
        q: joint positions, (dof,) or (N, dof) [rad].
        qd: joint rates, shape of ``q`` [rad/s].

    Returns:
        (dof,) or (N, dof) [Nm].
    """
    rows, single = as_rows(q, "q", robot.dof)
    return one_or_all(robot.dynamics.coriolis_torque(rows, _like(rows, single, qd, "qd")), single)


def mass_matrix(robot: Robot, q: npt.ArrayLike) -> FloatArray:
    """Mass matrix M(q) of the joints, with the rotors on its diagonal.

    Args:
        robot: with inertia.
        q: joint positions, (dof,) or (N, dof) [rad].

    Returns:
        (dof, dof) or (N, dof, dof), symmetric [kg m2; kg m between a revolute and a prismatic joint; kg].
    """
    rows, single = as_rows(q, "q", robot.dof)
    return one_or_all(robot.dynamics.mass_matrix(rows), single)


def singular_values(
    robot: Robot,
    q: npt.ArrayLike,
    link: str | None = None,
    point: Vector = (0.0, 0.0, 0.0),
    *,
    rows: JacobianRows = "linear",
) -> FloatArray:
    """Singular values of the Jacobian of a point, largest first.

    Args:
        robot: with or without inertia.
        q: joint positions, (dof,) or (N, dof) [rad].
        link: name of a link; default: the tip.
        point: in the link's frame [m].
        rows: ``"linear"``: of the linear rows [m/rad]. ``"all"``: of all six, where m/rad and rad/rad are mixed.

    Returns:
        (3,), (6,), (N, 3) or (N, 6); where fewer joints than rows move the link, the rest are 0.
    """
    return _of_jacobian(_native.singular_values, robot, q, link, point, rows)


def manipulability(
    robot: Robot,
    q: npt.ArrayLike,
    link: str | None = None,
    point: Vector = (0.0, 0.0, 0.0),
    *,
    rows: JacobianRows = "linear",
) -> FloatArray:
    """Manipulability sqrt(det(J J')) of a point (Yoshikawa 1985): the product of the singular values.

    Args:
        robot: with or without inertia.
        q: joint positions, (dof,) or (N, dof) [rad].
        link: name of a link; default: the tip.
        point: in the link's frame [m].
        rows: ``"linear"``: of the linear rows [m3/rad3]. ``"all"``: of all six [m3/rad3].

    Returns:
        () or (N,); 0 at a singularity.
    """
    return _of_jacobian(_native.manipulability, robot, q, link, point, rows)


def _of_jacobian(
    function: Any, robot: Robot, q: npt.ArrayLike, link: str | None, point: Vector, rows: JacobianRows
) -> FloatArray:
    if rows not in ("linear", "all"):
        raise InputError("rows", f"{rows!r} are no rows of a Jacobian", "valid: linear, all")
    positions, single = as_rows(q, "q", robot.dof)
    number, offset = robot.frame(link, point)
    return one_or_all(function(robot.chain, positions, number, np.ascontiguousarray(offset), rows == "all"), single)


def _like(rows: FloatArray, single: bool, value: npt.ArrayLike, field: str) -> FloatArray:
    """Rates or accelerations, which have the shape of q."""
    return as_float_array(value, field, rows.shape[1:])[None] if single else as_float_array(value, field, rows.shape)


def _for_each(value: npt.ArrayLike, field: str, width: int, count: int, single: bool) -> FloatArray:
    """A vector for each row of q: as many, or one for all."""
    rows, one = as_rows(value, field, width)
    if one:
        return np.ascontiguousarray(np.broadcast_to(rows, (count, width)))
    if single or len(rows) != count:
        wanted = f"({width},)" if single else f"({width},) or ({count}, {width})"
        raise InputError(field, f"has shape {rows.shape}", f"wanted {wanted}")
    return rows


def unit_directions(direction: npt.ArrayLike, count: int, single: bool) -> FloatArray:
    """Unit vectors, one for each row of q (count, 3).

    Raises:
        InputError: another shape or length.
    """
    along = _for_each(direction, "direction", 3, count, single)
    lengths = np.linalg.norm(along, axis=1)
    if (np.abs(lengths - 1) > 1e-9).any():
        wrong = int(np.argmax(np.abs(lengths - 1) > 1e-9))
        where = f"direction[{wrong}]" if np.ndim(direction) == 2 else "direction"
        raise InputError(where, f"has length {lengths[wrong]:.6g}", "wanted a unit vector")
    return along


def one_or_all(result: FloatArray, single: bool) -> FloatArray:
    """The only row where a single pose was asked for."""
    one: FloatArray = result[0] if single else result
    return one
