"""Torques that are those of another unit, by what the robot's joints can give and what its weight asks of them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.model import Robot, gravity_torque, unit_of
from bumpstop.model.drive_train.assumed import holding_torque

_ENOUGH = 2_000  # rows that show a unit
_TIMES_LIMIT = 3.0  # a tenth of the rows beyond so many times the limit are no torques of that joint
_TIMES_HOLDING = 10.0  # where no limit is known: times what holds the arm stretched out; makers' limits are below 2.5
_THOUSAND = 1e-3
_LITTLE = 0.003  # of what gravity asks; what is left of it in torques without gravity is more
_HOLDS = 0.1  # of the torques that hold the arm stretched out: less says nothing of how it stands


def torque_faults(q: FloatArray, tau: FloatArray, robot: Robot) -> list[str]:
    """Torques that no joint gives, or that could not hold the arm by far.

    A wrist at rest has small torques: what is too small is judged by the whole arm.

    Args:
        q: (N, n) positions [rad or m].
        tau: (N, n) torques of the same rows [Nm or N].
        robot: whose limits and weight count.

    Returns:
        One sentence without its end, or none.
    """
    # Without power, as behind brakes, there is no torque to judge.
    powered = tau.any(axis=1)
    if robot.inertia_objection or not powered.any():
        return []
    q, tau = q[powered], tau[powered]
    every = max(1, q.shape[0] // _ENOUGH)
    q, tau = q[::every], tau[::every]
    turning = np.array([joint.kind == "revolute" for joint in robot.joints])
    # Sums over the joints: whichever of them carries the arm, as where it hangs from a wall.
    weight = float(np.median(np.linalg.norm(gravity_torque(robot, q)[:, turning], axis=1)))
    given = float(np.median(np.linalg.norm(tau[:, turning], axis=1)))
    # Thousandths of torques are those of another unit only where they still carry the arm.
    thousandth = "Nm" if _THOUSAND * given > _HOLDS * weight else ""
    return _beyond_limits(np.abs(tau), robot, thousandth) or _without_weight(weight, given, turning, robot)


def _beyond_limits(size: FloatArray, robot: Robot, in_thousandths: str) -> list[str]:
    limit, holding = robot.drive_train.torque_limit, holding_torque(robot)
    bound = np.where(np.isfinite(limit), _TIMES_LIMIT * limit, _TIMES_HOLDING * holding)
    often = np.quantile(size, 0.9, axis=0)
    if not (often > bound).any():
        return []
    j = int(np.argmax(often / bound))
    unit = unit_of(robot.joints[j])
    known = f"its limit is {limit[j]:.4g} {unit}"
    if not np.isfinite(limit[j]):
        known = f"{holding[j]:.3g} {unit} would hold the arm stretched out"
    hint = 'are they mNm (torque unit = "mNm")?' if (_THOUSAND * often < bound).all() and unit == in_thousandths else ""
    return [
        f"the torques of joint {j + 1} are {often[j]:.0f} {unit} or more in a tenth of the rows, and {known}: "
        f"{hint or 'are unit and columns right?'}"
    ]


def _without_weight(weight: float, given: float, turning: npt.NDArray[np.bool_], robot: Robot) -> list[str]:
    if not turning.any():
        return []
    if weight < _HOLDS * float(np.linalg.norm(holding_torque(robot)[turning])) or given > _LITTLE * weight:
        return []
    return [
        f"the torques of all joints together are {given:.2g} Nm, and the weight of the arm alone asks for "
        f'{weight:.3g} Nm: are they kNm (torque unit = "kNm"), or without the weight?'
    ]
