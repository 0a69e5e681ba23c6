"""Whether several recordings say the same of a joint: one that carried something undeclared does not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.identification.drive.drive_model import motor_current

if TYPE_CHECKING:
    from bumpstop.identification.segments.drive_samples import DriveSamples
    from bumpstop.joint.model import JointTorqueModel

# Recordings disagree on a joint when an offset and a gain of their own take such a share away of what is left of its
# current, and that is such a share of the current's variance.
_SHARE, _WORTH = 0.3, 0.005


def inconsistent_joints(model: JointTorqueModel, rows: DriveSamples) -> list[str]:
    """Names of the joints that the recordings of a fit want different gains of.

    Args:
        model: fitted to ``rows``, of the same joints.
        rows: of one or more recordings; of one, nothing is in dispute.
    """
    numbers = sorted(set(rows.recordings))
    if len(numbers) < 2:
        return []
    place = np.repeat(rows.recordings, [part.stop - part.start for part in rows.segments])
    found = []
    for j, joint in enumerate(model.joints):
        if joint.parameters["B"] is None:
            continue
        both = np.column_stack([rows.current[:, j], motor_current(joint, rows.joint(j, joint.rest_speed))])
        measured, predicted = rows.filtered(both).T
        left, torque = measured - predicted, rows.torque[:, j]
        together = _left_of(left, torque)
        apart = sum(_left_of(left[place == number], torque[place == number]) for number in numbers)
        spread = float(((measured - measured.mean()) ** 2).sum())
        if together - apart > max(_SHARE * together, _WORTH * spread):
            found.append(joint.name)
    return found


def _left_of(x: FloatArray, torque: FloatArray) -> float:
    """Sum of squares (N,) that an offset and a multiple of the torque leave."""
    columns = np.column_stack([np.ones_like(torque), torque])
    values = np.linalg.lstsq(columns, x, rcond=None)[0]
    return float(((x - columns @ values) ** 2).sum())
