"""Undetectable forces: those that raise no residual of a pose over its threshold."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bumpstop import _native
from bumpstop.arrays import FloatArray, as_float_array, as_number, as_rows
from bumpstop.detection.standing import REST_SPEED, checked_stiction, standing_share
from bumpstop.errors import InputError
from bumpstop.model import Robot

PerJoint = float | npt.ArrayLike
# Of the limit: a pose at the edge does not warn at every row.
_WARNING_ENDS = 0.95


@dataclass(frozen=True, eq=False)
class UndetectableForces:
    """Forces that stay undetected at N poses, in any direction; without the leading N for a single pose.

    Attributes:
        largest: (N,) largest undetectable force [N]; infinite where some direction is not detectable at all.
        largest_detectable: (N,) the same among forces without a component along such a direction [N].
        largest_vector: (N, 3) the force that ``largest_detectable`` is the size of, in B, as the arm exerts it [N].
        rank: (N,) directions that are detectable, 0 to 3.
        axes: (N, 3, 3) rows are orthogonal unit vectors in B, the best detectable first; those from ``rank`` on span
            the null
            space: forces along them turn no monitored joint.
        singular_values: (N, 3) of the linear Jacobian's columns of the monitored joints, largest first [m or 1].
    """

    largest: FloatArray
    largest_detectable: FloatArray
    largest_vector: FloatArray
    rank: npt.NDArray[np.int64]
    axes: FloatArray
    singular_values: FloatArray

    @property
    def condition_number(self) -> FloatArray:
        """(N,) largest over smallest singular value; infinite at a singular pose."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = self.singular_values[..., 0] / self.singular_values[..., 2]
        return np.where(self.rank == 3, ratio, np.inf)

    @property
    def null_space(self) -> FloatArray:
        """(3 - rank, 3) unit vectors in B along which no force is detectable; of a single pose.

        Raises:
            InputError: of several poses, whose null spaces may differ in size.
        """
        if np.ndim(self.rank) != 0:
            raise InputError("null_space", "is that of a single pose", "take rows of axes from rank on")
        return self.axes[int(self.rank) :]


def undetectable_forces(
    robot: Robot,
    q: npt.ArrayLike,
    thresholds: PerJoint,
    *,
    link: str | None = None,
    point: npt.ArrayLike = (0.0, 0.0, 0.0),
    noise_mean: PerJoint = 0.0,
    noise_sd: PerJoint = 0.0,
    z: float = 0.0,
) -> UndetectableForces:
    """Largest force at a point of a link that no threshold detects: the farthest vertex of a polytope.

    The forces are ``{ f : -(theta_j + z sigma_j) <= (J_v' f)_j + mu_j <= theta_j + z sigma_j }``, f being what the arm
    exerts on what it touches. With z = 0 a force outside reaches a threshold when the noise is at its mean; with larger
    z one tick misses a force outside with a probability of at most 1 - Phi(z). Pure moments are outside this statement.

    Args:
        robot: with or without inertia.
        q: joint positions, (dof,) or (N, dof) [rad or m].
        thresholds: theta, one or (dof,), positive [Nm or N]; infinite: that joint is not monitored.
        link: name of the link the force acts on; default: the tip.
        point: in that link's frame [m].
        noise_mean: mu of the residual without contact, one or (dof,) [Nm or N]; inside the thresholds.
        noise_sd: sigma, one or (dof,), zero or more [Nm or N].
        z: standard deviations by which the faces are moved out, zero or more.

    Raises:
        InputError: a shape, a threshold that is not positive, or a mean that alarms by itself.
    """
    rows, single = as_rows(q, "q", robot.dof)
    low, high = residual_band(robot.dof, thresholds, noise_mean=noise_mean, noise_sd=noise_sd, z=z)
    jacobian = robot.jacobian(rows, link, point)[:, :3]
    found = _native.undetectable_forces(np.ascontiguousarray(jacobian), low, high)
    largest, detectable, largest_vector, singular, rank, axes = (value[0] if single else value for value in found)
    return UndetectableForces(largest, detectable, largest_vector, rank, axes, singular)


@dataclass(frozen=True)
class UndetectableStretch:
    """A part of a motion in which more than a given force stays undetected.

    Attributes:
        start_s, end_s: first and last of its times [s].
        largest_N: largest undetectable force in it, in any direction [N]; infinite: any.
    """

    start_s: float
    end_s: float
    largest_N: float

    def to_json(self) -> dict[str, float | None]:
        """For programs; null: any force."""
        largest = self.largest_N if math.isfinite(self.largest_N) else None
        return {"start_s": self.start_s, "end_s": self.end_s, "largest_N": largest}


def undetectable_stretches(
    robot: Robot,
    t: npt.ArrayLike,
    q: npt.ArrayLike,
    thresholds: PerJoint,
    limit_N: float,
    *,
    link: str | None = None,
    point: npt.ArrayLike = (0.0, 0.0, 0.0),
    dead_zone: PerJoint = 0.0,
    rest_speed: PerJoint = REST_SPEED,
) -> tuple[UndetectableStretch, ...]:
    """When an arm is where more than a given force can go undetected, as ``UndetectablePoseMonitor`` in C++ warns.

    A stretch begins at the first row beyond the limit, and ends before the first that is 5 % below it or more. While a
    joint stands still, its threshold is reached only beyond what its friction holds.

    Args:
        robot: as of :func:`undetectable_forces`, like all but ``t`` and ``limit_N``.
        t: (N,) times [s].
        q: (N, dof) positions [rad or m].
        thresholds: constant ones [Nm or N].
        limit_N: above 0 [N].
        link: whose contact the force is; default: the tip.
        point: in that link's frame [m].
        dead_zone: torque that friction can hide of a standing joint, one or (dof,) [Nm or N].
        rest_speed: up to which a joint stands, one or (dof,) [rad/s or m/s].

    Raises:
        InputError: as :func:`undetectable_forces`; a limit that is not above 0.
    """
    if not as_number(limit_N, "limit_N") > 0:
        raise InputError("limit_N", f"is {limit_N}", "wanted more than 0")
    times = as_float_array(t, "t", (None,))
    rows = as_float_array(q, "q", (times.size, robot.dof))
    theta, hidden = (
        _per_joint(thresholds, "thresholds", robot.dof, finite=False),
        checked_stiction(dead_zone, robot.dof),
    )
    # Whole steps of a quarter: joints stand or move, and few combinations of them are met.
    share = np.ceil(4 * standing_share(times, rows, rest_speed) * (hidden > 0)) / 4
    kinds, of = np.unique(share, axis=0, return_inverse=True)
    largest = np.empty(times.size)
    for kind, standing in enumerate(kinds):
        here = of.ravel() == kind
        found_here = undetectable_forces(robot, rows[here], theta + standing * hidden, link=link, point=point)
        largest[here] = found_here.largest
    found: list[UndetectableStretch] = []
    begin: int | None = None
    for row, force in enumerate([*largest.tolist(), 0.0]):
        limit = limit_N if begin is None else _WARNING_ENDS * limit_N
        if force > limit:
            begin = row if begin is None else begin
        elif begin is not None:
            found.append(
                UndetectableStretch(float(times[begin]), float(times[row - 1]), float(largest[begin:row].max()))
            )
            begin = None
    return tuple(found)


def undetectable_force_along(
    robot: Robot,
    q: npt.ArrayLike,
    direction: npt.ArrayLike,
    thresholds: PerJoint,
    *,
    link: str | None = None,
    point: npt.ArrayLike = (0.0, 0.0, 0.0),
    noise_mean: PerJoint = 0.0,
    noise_sd: PerJoint = 0.0,
    z: float = 0.0,
) -> FloatArray:
    """Largest force along a direction that no threshold detects: min over j of (theta_j + z sigma_j -+ mu_j) / |a_j|.

    Args:
        robot: as of :func:`undetectable_forces`, like all but ``direction``.
        q: joint positions, (dof,) or (N, dof) [rad or m].
        direction: in which the arm pushes, unit vector in B. (3,), or (N, 3) with a row for each of ``q``.
        thresholds: theta [Nm or N].
        link: the force acts on.
        point: of that link [m].
        noise_mean: mu [Nm or N].
        noise_sd: sigma [Nm or N].
        z: standard deviations by which the faces are moved out.

    Returns:
        () or (N,) [N]; infinite where it loads no monitored joint.

    Raises:
        InputError: a direction that is no unit vector, or arrays of other shapes.
    """
    rows, single = as_rows(q, "q", robot.dof)
    along, _ = as_rows(direction, "direction", 3)
    if len(along) not in (1, len(rows)):
        raise InputError("direction", f"has shape {np.shape(direction)}", f"wanted (3,) or ({len(rows)}, 3)")
    if (np.abs(np.linalg.norm(along, axis=1) - 1) > 1e-9).any():
        raise InputError("direction", "is no unit vector", "wanted length 1")
    low, high = residual_band(robot.dof, thresholds, noise_mean=noise_mean, noise_sd=noise_sd, z=z)
    jacobian = np.ascontiguousarray(robot.jacobian(rows, link, point)[:, :3])
    along = np.ascontiguousarray(np.broadcast_to(along, (len(rows), 3)))
    forces: FloatArray = _native.undetectable_forces_along(jacobian, low, high, along)
    return forces[0] if single else forces


def residual_band(
    dof: int, thresholds: PerJoint, *, noise_mean: PerJoint = 0.0, noise_sd: PerJoint = 0.0, z: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Contact torques of each joint that may stay undetected, lowest and highest, each (dof,) [Nm or N].

    Args:
        dof: joints of the robot.
        thresholds: theta, one or (dof,), as of :func:`undetectable_forces`.
        noise_mean: mu.
        noise_sd: sigma.
        z: standard deviations by which they are moved out.
    """
    theta = _per_joint(thresholds, "thresholds", dof, finite=False)
    mean, sd = _per_joint(noise_mean, "noise_mean", dof), _per_joint(noise_sd, "noise_sd", dof)
    if not as_number(z, "z") >= 0:
        raise InputError("z", f"is {z}", "wanted zero or more")
    for value, wrong, field in ((theta, ~(theta > 0), "thresholds"), (sd, ~(sd >= 0), "noise_sd")):
        if wrong.any():
            j = int(np.argmax(wrong))
            wanted = "wanted more than zero" if field == "thresholds" else "wanted zero or more"
            raise InputError(f"{field} of joint {j + 1}", f"is {value[j]}", wanted)
    loud = np.flatnonzero(np.abs(mean) >= theta)
    if loud.size:
        problem = f"{mean[loud[0]]:g} alarms without contact"
        raise InputError(
            f"noise_mean of joint {loud[0] + 1}", problem, f"wanted less than its threshold, {theta[loud[0]]:g}"
        )
    wide = theta + z * sd
    return np.ascontiguousarray(-wide - mean), np.ascontiguousarray(wide - mean)


def required_torque(residual: PerJoint, threshold: PerJoint) -> tuple[FloatArray, FloatArray]:
    """Contact torques that must be passed to be detected upward and downward (Schroeder's table 4.1).

    Args:
        residual: without contact, a number or (n,) [Nm].
        threshold: positive, a number or (n,) [Nm].

    Returns:
        threshold - residual, and -threshold - residual [Nm]; each () or (n,).
    """
    error, theta = np.asarray(residual, dtype=np.float64), np.asarray(threshold, dtype=np.float64)
    return theta - error, -theta - error


def largest_undetected_torque(threshold: PerJoint, torque_rate: PerJoint, period_s: float) -> FloatArray:
    """Largest contact torque that may go undetected when the residual was anywhere between the thresholds before.

    ``2 threshold + |torque_rate| period`` (Schroeder's eqs 4.2 and 4.3): the band from one threshold to the other, and
    what the torque grows between two samples.

    Args:
        threshold: of each joint, a number or (n,) [Nm].
        torque_rate: growth of the contact torque, a number or (n,) [Nm/s].
        period_s: between samples [s].

    Returns:
        () or (n,) [Nm].
    """
    theta, rate = np.asarray(threshold, dtype=np.float64), np.asarray(torque_rate, dtype=np.float64)
    return 2 * theta + np.abs(rate) * as_number(period_s, "period_s")


def largest_undetected_force(torque: PerJoint, torque_per_newton: PerJoint) -> FloatArray:
    """Force along a direction that gives each joint a torque (Schroeder's eq 4.4), infinite where it gives none.

    Args:
        torque: largest undetected, of each joint, a number or (n,) [Nm].
        torque_per_newton: of a force of one newton in the direction, of each joint, a number or (n,) [Nm/N].

    Returns:
        () or (n,) [N].
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        force = np.abs(np.asarray(torque, dtype=np.float64)) / np.abs(np.asarray(torque_per_newton, dtype=np.float64))
    return np.where(np.asarray(torque_per_newton) == 0, np.inf, force)


def _per_joint(value: PerJoint, field: str, dof: int, *, finite: bool = True) -> FloatArray:
    if np.ndim(value) == 0:
        return np.full(dof, as_number(value, field, finite=finite))
    return as_float_array(value, field, (dof,), finite=finite)
