"""Whether a fitted model is of the arm that it is used with."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bumpstop.errors import InputError
from bumpstop.joint import JointTorqueModel
from bumpstop.text_files import other_robot

if TYPE_CHECKING:
    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.model import Robot


def check_arm_of_fit(model: DynamicsModel | JointTorqueModel, arm: Robot, field: str) -> None:
    """Refuse another arm than the one that a model was fitted to: arms of one maker often share the names of joints.

    Raises:
        InputError: about ``field``: the arm has another number of joints, another name, or other names of joints.
    """
    valid = "wanted the arm of the fit, or a fit of this arm"
    if isinstance(model, JointTorqueModel):
        of, own = model.robot, [joint.name for joint in model.joints]
    else:
        of, own = model.robot.name, [joint.name for joint in model.robot.joints]
    if arm.dof != len(own):
        raise InputError(field, f"{arm.name} has {arm.dof} joints, the model's {of} has {len(own)}", valid)
    if other_robot(arm.name, of):
        raise InputError(field, f"is {arm.name!r}, and the model was fitted to {of!r}", valid)
    for mine, its in zip(arm.joints, own, strict=True):
        if mine.name != its:
            problem = f"{arm.name} has a joint {mine.name!r} where the model's {of} has {its!r}"
            raise InputError(field, problem, valid)
