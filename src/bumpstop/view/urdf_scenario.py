"""A scenario to start from for the arm of a URDF file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.collision import CollisionProblem, Scenario
from bumpstop.errors import InputError
from bumpstop.model import Robot

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray

# As in the starting scenarios of built-in robots; where the file states no torque limit, a threshold of usual size.
_THRESHOLD_SHARE, _THRESHOLD_OVER_NOISE, _THRESHOLD_NM = 1 / 8, 5.5, 20.0
_ASSUMED = (
    *("pose_rad", "detector.thresholds_Nm", "detector.noise_sd_Nm"),
    *("reaction.joint_acceleration_rad_s2", "reaction.latency_s"),
)
_TRIES = 400
_FREE_TURN = np.pi / 2


def urdf_scenario(path: Path, base: str | None = None, tip: str | None = None) -> tuple[Scenario, Robot]:
    """A scenario in which the tip moves down at 50 mm/s onto a clamped hand.

    The pose is, of random ones with seed 0 that can begin the motion, the one farthest from singular.

    Args:
        path: of the URDF file.
        base: link in whose frame everything is given; default: the root.
        tip: link at the end of the chain; default: the last link of the only chain.

    Returns:
        The scenario, in which all that was made up is ``assumed``, and its robot.

    Raises:
        InputError: the file cannot be read, or no pose was found.
    """
    robot = Robot.from_urdf(path, base, tip)
    limits = np.asarray(robot.drive_train.torque_limit, dtype=np.float64)
    known = np.isfinite(limits) & (limits > 0)
    thresholds = [float(f"{value:.2g}") for value in np.where(known, _THRESHOLD_SHARE * limits, _THRESHOLD_NM)]
    tables: dict[str, Any] = {
        "robot": str(path.resolve()),
        **{key: link for key, link in (("base", base), ("tip", tip)) if link is not None},
        "assumed": list(_ASSUMED),
        "motion": {"velocity_mm_s": [0, 0, -50], "task": "pose" if robot.dof >= 6 else "position"},
        "contact": {"body": "hand_finger", "limits": "ts15066", "area_cm2": 2.0},
        "detector": {
            "thresholds_Nm": thresholds,
            "noise_sd_Nm": [float(f"{value / _THRESHOLD_OVER_NOISE:.2g}") for value in thresholds],
        },
        "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 5.0, "latency_s": 0.02},
    }
    reason: InputError | None = None
    for q in _poses(robot):
        pose = {"pose_rad": [float(f"{value:.4g}") for value in q]}
        try:
            scenario = Scenario.from_dict(tables | pose)
            CollisionProblem.from_scenario(scenario)
        except InputError as error:
            reason = error
            continue
        return scenario, robot
    why = "" if reason is None else f" ({reason})"
    raise InputError("SOURCE", f"no pose of {robot.name} was found from which its tip can move down{why}")


def _poses(robot: Robot) -> FloatArray:
    """Random poses within the limits, the one whose tip moves most easily first."""
    low = np.where(np.isfinite(robot.lower), robot.lower, -_FREE_TURN)
    high = np.where(np.isfinite(robot.upper), robot.upper, _FREE_TURN)
    rows = np.random.default_rng(0).uniform(low, high, (_TRIES, robot.dof))
    least = np.linalg.svd(robot.jacobian(rows)[:, : min(6, robot.dof)], compute_uv=False)[:, -1]
    return np.asarray(rows[np.argsort(-least)][:40])
