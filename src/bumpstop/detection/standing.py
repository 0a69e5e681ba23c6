"""What friction hides of a contact while joints stand still."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array, as_number, as_rows
from bumpstop.detection.loop.drive_matching import MatchedDrives
from bumpstop.detection.loop.unknown_gains import unknown_gains
from bumpstop.errors import InputError
from bumpstop.model.dynamics import gravity_torque
from bumpstop.model.reach import greatest, pose_range

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from bumpstop.detection.settings import DetectorSettings
    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot

    Weight = Callable[[FloatArray], FloatArray]

REST_SPEED = 0.01
"""Below it a joint rests where no joint model says so [rad/s or m/s]."""
_HALF_S = 0.05  # of the time over which the speed of a row is taken


def hidden_torques(
    robot: Robot,
    model: JointTorqueModel | DynamicsModel | None,
    settings: DetectorSettings | None = None,
    q: npt.ArrayLike | None = None,
) -> FloatArray:
    """(dof,) torque that friction can hide of a standing joint, each way [Nm or N].

    Of a joint model friction and hysteresis at rest, of fitted dynamics friction without speed. Where it grows with the
    load it is that under the greatest weight that the joint holds in the poses. What is stated stands in place of
    either. Zero without a model, NaN of joints whose torque a model does not know.

    Args:
        robot: the arm.
        model: of currents; or a model of dynamics; or None.
        settings: what is stated, gravity and payload; default: nothing stated, no payload.
        q: poses that the arm stands in, (dof,) or (N, dof) [rad or m]; default: all between the limits of its joints.

    Raises:
        InputError: stiction that cannot be used, or a model of other joints.
    """
    stated = None if settings is None else settings.stiction
    if stated is not None:
        return checked_stiction(stated, robot.dof, or_unknown=True)
    if model is None:
        return np.zeros(robot.dof)
    gravity = model.gravity
    dynamics = fitted_model(model)
    if dynamics is not None:
        found = dynamics.friction_at_rest(
            _greatest(robot, dynamics.loaded, _weight(robot, dynamics.weight, gravity, settings), q)
        )
        found[unknown_gains(robot, model)] = math.nan
        return found
    if settings is not None and settings.gravity is not None:
        gravity = settings.gravity
    drives = MatchedDrives(robot, model, [False] * robot.dof)  # type: ignore[arg-type]

    def own(rows: FloatArray) -> FloatArray:
        return gravity_torque(robot, rows, gravity=gravity)

    return drives.dead_zone(_greatest(robot, drives.load_dependent, _weight(robot, own, gravity, settings), q))


def _weight(
    robot: Robot, own: Weight, gravity: tuple[float, float, float], settings: DetectorSettings | None
) -> Weight:
    """Torques (N, dof) that poses (N, dof) hold against gravity, those of a declared payload with them."""
    if settings is None or not settings.payload_kg:
        return own
    center, mass = settings.payload_center, settings.payload_kg
    at = (None, (0.0, 0.0, 0.0)) if center is None else (robot.joints[-1].link, center)

    def both(rows: FloatArray) -> FloatArray:
        carried: FloatArray = robot.jacobian(rows, *at)[:, :3].transpose(0, 2, 1) @ (-mass * np.asarray(gravity))
        return own(rows) + carried

    return both


def _greatest(robot: Robot, joints: Sequence[int], weight: Weight, q: npt.ArrayLike | None) -> FloatArray:
    """(dof,) greatest absolute torque that some joints hold in poses; zero of the others, NaN where it has no end."""
    found = np.zeros(robot.dof)
    if len(joints) == 0:
        return found
    if q is not None:
        torque = np.abs(weight(as_rows(q, "q", robot.dof)[0]))
        found[list(joints)] = torque.max(axis=0)[list(joints)]
        return found
    lower, upper = pose_range(robot.joints)
    for j in joints:
        found[j] = greatest(lambda rows, j=j: np.abs(weight(rows)[:, j]), lower, upper)  # type: ignore[misc]
    return np.where(np.isfinite(found), found, math.nan)


def hidden_text(hidden: FloatArray) -> str:
    """Torques (n,) that friction can hide, in words; NaN is unknown."""
    return ", ".join("unknown" if np.isnan(value) else f"{value:.3g}" for value in hidden)


def fitted_model(model: JointTorqueModel | DynamicsModel | None) -> DynamicsModel | None:
    """The model where it is one of fitted dynamics; fits are imported by nobody who has none."""
    from bumpstop.joint import JointTorqueModel

    return None if model is None or isinstance(model, JointTorqueModel) else model


def checked_stiction(stiction: float | npt.ArrayLike, dof: int, *, or_unknown: bool = False) -> FloatArray:
    """(dof,) stiction of one number or one for each joint.

    Args:
        stiction: zero or more [Nm or N].
        dof: joints of the robot.
        or_unknown: NaN is taken, of joints of which it is not known.

    Raises:
        InputError: another number of them, or one that is negative or not finite.
    """
    if np.ndim(stiction) == 0:
        values = np.full(dof, as_number(stiction, "stiction"))
    else:
        values = as_float_array(stiction, "stiction", (dof,), finite=not or_unknown)
    unusable = (values < 0) | np.isinf(values)
    if unusable.any():
        j = int(np.argmax(unusable))
        raise InputError(f"stiction of joint {j + 1}", f"is {values[j]:g}", "wanted zero or more")
    return values


def standing_share(t: npt.ArrayLike, q: npt.ArrayLike, rest_speed: float | npt.ArrayLike = REST_SPEED) -> FloatArray:
    """(N, dof) how far joints stand: 1 up to their rest_speed, 0 from twice that on.

    The speed of a row is that over a tenth of a second around it, which the noise of positions hardly changes.

    Args:
        t: (N,) times, not falling [s].
        q: (N, dof) positions [rad or m].
        rest_speed: one or (dof,) [rad/s or m/s].
    """
    times = as_float_array(t, "t", (None,))
    rows = as_float_array(q, "q", (times.size, None))
    before = np.searchsorted(times, times - _HALF_S)
    after = np.searchsorted(times, times + _HALF_S, side="right") - 1
    # Of samples farther apart than that the neighbours.
    here = np.arange(times.size)
    before, after = np.minimum(before, np.maximum(here - 1, 0)), np.maximum(after, np.minimum(here + 1, here[-1]))
    span = np.maximum(times[after] - times[before], 1e-12)
    speed = np.abs(rows[after] - rows[before]) / span[:, None]
    found: FloatArray = np.clip(2 - speed / np.asarray(rest_speed), 0.0, 1.0)
    return found
