"""Joints whose torque a model does not know in Nm: what of thresholds a force may count."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bumpstop.detection.loop.drive_matching import MatchedDrives
from bumpstop.model import unit_of

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot


def unknown_gains(robot: Robot, model: JointTorqueModel | DynamicsModel | None) -> list[int]:
    """Numbers from 0 of the joints whose gain is not known, so that their residual is no torque in Nm.

    Args:
        robot: the arm.
        model: of currents, where joints that it has not count, too; or of dynamics; or None.
    """
    from bumpstop.joint import JointTorqueModel

    if model is None or isinstance(model, JointTorqueModel):
        return MatchedDrives(robot, model, [False] * robot.dof).unknown
    return sorted(model.unscaled)


def force_thresholds(
    robot: Robot, model: JointTorqueModel | DynamicsModel | None, thresholds: FloatArray
) -> tuple[FloatArray, tuple[str, ...]]:
    """Thresholds (dof,) as forces count them: infinite of joints of unknown gain; and a note that names these.

    A contact shows in the residual of such a joint by nobody knows how much.

    Args:
        robot: the arm.
        model: that the residuals are of, as for :func:`unknown_gains`.
        thresholds: (dof,) [Nm or N].
    """
    unknown = unknown_gains(robot, model)
    counted = thresholds.copy()
    counted[unknown] = math.inf
    if not unknown:
        return counted, ()
    joints = [robot.joints[j] for j in unknown]
    names, unit = ", ".join(joint.name for joint in joints), unit_of(*joints)
    return counted, (
        f"{names}: of unknown gain: residuals and thresholds are no {unit}, and forces do not count them.",
    )
