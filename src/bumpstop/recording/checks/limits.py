"""How close a recording comes to the limits of its robot."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bumpstop.model import Robot
from bumpstop.recording.recording import Recording


def limits_touched(recording: Recording, robot: Robot) -> dict[str, npt.NDArray[np.int64]]:
    """Rows at or beyond a limit.

    Args:
        recording: of this robot.
        robot: whose limits count.

    Returns:
        ``"position"`` and, where speeds were recorded, ``"velocity"``: number of rows for each joint, (dof,).
    """
    touched = {"position": ((recording.q <= robot.lower) | (recording.q >= robot.upper)).sum(axis=0)}
    if recording.qd is not None:
        touched["velocity"] = (np.abs(recording.qd) >= robot.velocity).sum(axis=0)
    return touched
