"""Joints of a contact-free recording whose channel is dead, clipped or wrong: no threshold makes up for that."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.drive.current_scores import compare_currents
from bumpstop.identification.drive.joint_model_verdict import tell_unpredicted as tell_unpredicted_currents
from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
from bumpstop.identification.dynamics.dynamics_verdict import tell_unpredicted as tell_unpredicted_torques
from bumpstop.identification.payload.payload import Payload, with_payload
from bumpstop.identification.segments.recorded_columns import doubtful_columns

if TYPE_CHECKING:
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# A residual whose variance is so many times that of the recorded torque: what the links' inertia predicts adds to it.
_ADDS = 1.5


def unexplained(
    recording: Recording,
    robot: Robot,
    model: JointTorqueModel | DynamicsModel | None,
    residual: FloatArray,
    *,
    payload: Payload | None = None,
    gravity: tuple[float, float, float] | None = None,
) -> list[str]:
    """Sentences on joints whose channel is doubtful, or whose current or torque the model says nothing of.

    A validation on this recording would be not usable for the same reasons. Without a model, where friction is part of
    the residual, it is told where the residual varies more than the recorded torque.

    Args:
        recording: in which nothing is touched.
        robot: with inertia, unless dynamics are fitted.
        model: of currents, of dynamics, or None: recorded torque and the robot's own inertia.
        residual: (N, n) of a detector over this recording [Nm or N].
        payload: what the arm carries that is no part of it.
        gravity: acceleration of free fall in the base frame [m/s2]; default: the model's.
    """
    faults: list[str] = []
    quantity = "tau" if model is None or (isinstance(model, DynamicsModel) and model.gains is None) else "current"
    told = doubtful_columns([recording], robot, quantity)
    try:
        if isinstance(model, DynamicsModel):
            scores = model.compare_rows(model.rows(recording, [payload])).scores()
            tell_unpredicted_torques(scores, quantity, model.cutoff_hz, faults, [])
        elif model is not None:
            arm = robot if payload is None else with_payload(robot, payload.mass, payload.center)
            tell_unpredicted_currents(compare_currents(model, recording, arm, gravity=gravity), faults, [])
        elif recording.tau is not None:
            adds = residual.var(axis=0) > _ADDS * recording.tau.var(axis=0)
            faults += [
                f"the residual of {robot.joints[j].name} varies more than its recorded torque: is its sign right?"
                for j in np.flatnonzero(adds & (np.ptp(recording.tau, axis=0) > 0))
            ]
    except InputError:
        pass  # too short to be compared; what a detector needs is less
    return list(dict.fromkeys([*told, *faults]))
