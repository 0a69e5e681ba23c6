"""What friction hides of a contact while joints stand still."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array, as_number
from bumpstop.detection.loop.drive_matching import MatchedDrives
from bumpstop.errors import InputError

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot

REST_SPEED = 0.01
"""Below it a joint rests where no joint model says so [rad/s or m/s]."""
_HALF_S = 0.05  # of the time over which the speed of a row is taken


def hidden_torques(
    robot: Robot,
    model: JointTorqueModel | DynamicsModel | None,
    stiction: float | npt.ArrayLike | None = None,
) -> FloatArray:
    """(dof,) torque that friction can hide of a standing joint, each way [Nm or N].

    Of a joint model the friction at its rest_speed and its hysteresis; of fitted dynamics their Coulomb friction. What
    is stated stands in place of either. Zero without a model, NaN of joints that a joint model knows no drive of.

    Args:
        robot: the arm.
        model: of currents; or a model of dynamics; or None.
        stiction: stated, one or (dof,), zero or more [Nm or N].

    Raises:
        InputError: stiction that cannot be used, or a model of other joints.
    """
    from bumpstop.joint import JointTorqueModel

    if stiction is not None:
        return checked_stiction(stiction, robot.dof)
    if model is None:
        return np.zeros(robot.dof)
    if isinstance(model, JointTorqueModel):
        return MatchedDrives(robot, model, [False] * robot.dof).dead_zone()
    return model.coulomb


def hidden_text(hidden: FloatArray) -> str:
    """Torques (n,) that friction can hide, in words; NaN is unknown."""
    return ", ".join("unknown" if np.isnan(value) else f"{value:.3g}" for value in hidden)


def fitted_model(model: JointTorqueModel | DynamicsModel | None) -> DynamicsModel | None:
    """The model where it is one of fitted dynamics; fits are imported by nobody who has none."""
    from bumpstop.joint import JointTorqueModel

    return None if model is None or isinstance(model, JointTorqueModel) else model


def checked_stiction(stiction: float | npt.ArrayLike, dof: int) -> FloatArray:
    """(dof,) stiction of one number or one for each joint.

    Raises:
        InputError: another number of them, or one that is negative or not finite.
    """
    if np.ndim(stiction) == 0:
        values = np.full(dof, as_number(stiction, "stiction"))
    else:
        values = as_float_array(stiction, "stiction", (dof,))
    if (values < 0).any():
        j = int(np.argmax(values < 0))
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
