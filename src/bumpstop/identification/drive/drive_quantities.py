"""Parameters of a joint torque model by name, with units and standard errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bumpstop.identification.fit import Quantity
from bumpstop.model import unit_of

if TYPE_CHECKING:
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Joint, Robot


def drive_quantities(model: JointTorqueModel, robot: Robot) -> dict[str, Quantity]:
    """Parameters of all joints of a model, ``JOINT.NAME``; ``robot``: whose joints these are."""
    joints = {joint.name: joint for joint in robot.joints}
    return {
        f"{own.name}.{name}": Quantity(
            None if found is None else found.value, _unit(name, joints[own.name], model.unit)
        )
        for own in model.joints
        for name, found in own.parameters.items()
    }


def drive_errors(model: JointTorqueModel) -> dict[str, float | None]:
    """Standard errors of :func:`drive_quantities`."""
    return {
        f"{own.name}.{name}": None if found is None else found.standard_error
        for own in model.joints
        for name, found in own.parameters.items()
    }


def _unit(name: str, joint: Joint, current: str) -> str:
    speed = unit_of(joint, turning="rad/s", sliding="m/s")
    return {
        "A": f"{unit_of(joint)}/{current}2",
        "B": f"{unit_of(joint)}/{current}",
        "D": f"{current} at 1 {speed}",
        "F": "1",
        "coulomb": current,
        "viscous": f"{current}/({speed})",
        "stribeck": current,
        "stribeck_speed": speed,
        "load": "1",
        "hysteresis": unit_of(joint),
        "inertia": unit_of(joint, turning="kg m2", sliding="kg"),
    }[name]
