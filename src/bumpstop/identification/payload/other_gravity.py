"""Whether an arm that carries something was mounted another way than a payload's fit took for granted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.identification.payload.payload_fit import identify_payload
from bumpstop.model.inertia import vector3

if TYPE_CHECKING:
    from bumpstop.identification.payload.payload_fit import PayloadFit
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# What another direction may leave of the square of the torque: friction and noise alone are the same in all of them.
_FAR_LESS = 0.25


def other_gravity(found: PayloadFit, recording: Recording, robot: Robot) -> str:
    """A sentence where free fall along another axis of the base frame explains the recording far better; or empty.

    Args:
        found: of ``identify_payload``.
        recording: that it was fitted to.
        robot: that carried it.
    """
    source = found.source
    size = float(np.linalg.norm(source.gravity))
    for axis in np.concatenate([np.eye(3), 0.0 - np.eye(3)]):
        falls = vector3(size * axis)
        if np.allclose(falls, source.gravity, atol=0.1):
            continue
        other = identify_payload(
            recording,
            robot,
            model=source.model,
            dynamics=source.fit or source.dynamics,
            cutoff_hz=source.cutoff_hz,
            gravity=falls,
            inertia_uncertainty=source.inertia_uncertainty,
        )
        mass, error = other.parameters["m"].value, other.standard_errors["m"]
        seen = mass is not None and error is not None and mass > 2 * error
        if seen and (other.rmse**2).sum() < _FAR_LESS * (found.rmse**2).sum():
            return (
                f"free fall along {','.join(f'{x:g}' for x in falls)} explains the recording far better than along "
                f"{','.join(f'{x:g}' for x in source.gravity)}: was the arm mounted so? Give --gravity"
            )
    return ""
