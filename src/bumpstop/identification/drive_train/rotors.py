"""Rotor inertia of the joints from torques or currents, where the inertia of the links is known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.drive_train.joint_values import JointValues, judged
from bumpstop.identification.segments.torque_samples import TorqueSamples, joints_at_rest
from bumpstop.identification.statistics.robust_fit import robust_fit
from bumpstop.model import inverse_dynamics, with_rotors
from bumpstop.model.dynamics import STANDARD_GRAVITY

if TYPE_CHECKING:
    from bumpstop.identification.payload.payload import Payload
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

_CUTOFF_HZ = 8.0
# Speed over which Coulomb friction turns, as a share of the root mean square speed; and the least [rad/s or m/s].
_SIGN_SHARE, _MIN_SIGN_SPEED = 0.02, 1e-3
_ENOUGH_ROWS = 20_000


def identify_rotors(
    recordings: Sequence[Recording],
    robot: Robot,
    *,
    payloads: Sequence[Payload | None] = (),
    cutoff_hz: float | None = None,
    gravity: tuple[float, float, float] = STANDARD_GRAVITY,
) -> JointValues:
    """Fit the rotors to what recorded torques or currents leave beside the torque of the links.

    Of torques: torque - Newton-Euler of the links = B qdd + Coulomb + viscous friction + offset, joint by joint, under
    Huber's loss with errors that hold where residuals are correlated in time. Of currents: the inertia of
    :func:`bumpstop.identification.identify_joint_model`. Both take the inertia of the links as given: what a wrong one
    leaves is taken for the rotor's.

    Args:
        recordings: with joint torques, or else with motor currents; one or more.
        robot: with plausible inertia; rotors it may have are not used.
        payloads: what each recording carried; default: nothing.
        cutoff_hz: of the zero-phase filter that motion and torque pass; default: 8 Hz, of currents by held-out error.
        gravity: acceleration of free fall in the base frame [m/s2].

    Returns:
        Reflected inertia of the rotors [kg m2 or kg].

    Raises:
        InputError: an inertia that is not known or implausible, or recordings without torques and currents.
    """
    if robot.inertia_objection:
        raise InputError("robot", robot.inertia_objection, "rotors are told from links whose inertia is known")
    logs = list(recordings)
    if all(log.tau is not None for log in logs):
        return _of_torques(logs, robot, payloads, cutoff_hz or _CUTOFF_HZ, gravity)
    return _of_currents(logs, robot, payloads, cutoff_hz, gravity)


def _of_torques(
    logs: list[Recording],
    robot: Robot,
    payloads: Sequence[Payload | None],
    cutoff_hz: float,
    gravity: tuple[float, float, float],
) -> JointValues:
    static = joints_at_rest(logs, robot)
    rows = TorqueSamples.of(
        logs, robot, cutoff_hz, payloads, limit=_ENOUGH_ROWS, filters_hz=(cutoff_hz,), gravity=gravity
    )
    motion = rows.reach.motion
    links = inverse_dynamics(with_rotors(robot, 0.0), motion.q, motion.qd, motion.qdd, gravity=gravity)
    wanted = rows.torque_below(cutoff_hz) - rows.reach.filtered(links + rows.reach.carried, cutoff_hz)
    speed = np.maximum(_SIGN_SHARE * np.sqrt(np.mean(motion.qd**2, axis=0)), _MIN_SIGN_SPEED)
    shapes = np.stack([motion.qdd, np.tanh(motion.qd / speed), motion.qd, np.ones_like(motion.qd)], axis=2)
    columns = rows.reach.filtered(shapes, cutoff_hz)
    values, errors = np.full(robot.dof, np.nan), np.full(robot.dof, np.inf)
    reasons = [""] * robot.dof
    for j, joint in enumerate(robot.joints):
        if joint.name in static:
            reasons[j] = "it hardly moves"
            continue
        used = rows.used[:, j]
        values[j], errors[j] = _fitted(columns[used, j], wanted[used, j])
    return judged(values, errors, reasons)


def _fitted(columns: FloatArray, wanted: FloatArray) -> tuple[float, float]:
    """The first of the parameters, and its standard error."""
    start, *_ = np.linalg.lstsq(columns, wanted, rcond=None)
    bound: FloatArray = np.full(columns.shape[1], np.inf)
    fit = robust_fit(lambda x: (columns @ x, columns), wanted, np.asarray(start), -bound, bound)
    return float(fit.values[0]), float(fit.standard_errors[0])


def _of_currents(
    logs: list[Recording],
    robot: Robot,
    payloads: Sequence[Payload | None],
    cutoff_hz: float | None,
    gravity: tuple[float, float, float],
) -> JointValues:
    from bumpstop.identification.drive.joint_model_fit import identify_joint_model
    from bumpstop.identification.payload.payload import with_payload

    bare = with_rotors(robot, 0.0)
    loads = list(payloads) or [None] * len(logs)
    arms = [bare if load is None else with_payload(bare, load.mass, load.center) for load in loads]
    model = identify_joint_model(logs, arms, cutoff_hz=cutoff_hz, gravity=gravity).model
    values, errors = np.full(robot.dof, np.nan), np.full(robot.dof, np.inf)
    reasons = [""] * robot.dof
    for j, joint in enumerate(model.joints):
        found = joint.parameters.get("inertia")
        if found is None or found.standard_error is None:
            reasons[j] = "its current does not show it"
        else:
            values[j], errors[j] = found.value, found.standard_error
    return judged(values, errors, reasons)
