"""What a recording holds, by names that bear its units."""

from __future__ import annotations

from bumpstop.arrays import FloatArray
from bumpstop.model import Robot, unit_of
from bumpstop.recording.recording import Recording


def by_quantity(recording: Recording, robot: Robot | None) -> dict[str, FloatArray | None]:
    """Positions, speeds, currents and torques (N, dof) by ``"q, rad"`` and the like; None: not recorded.

    Args:
        recording: of this robot.
        robot: whose joints turn or slide; None: they are taken to turn.
    """
    joints = () if robot is None else robot.joints
    position = unit_of(*joints, turning="rad", sliding="m")
    speed = unit_of(*joints, turning="rad/s", sliding="m/s")
    return {
        f"q, {position}": recording.q,
        f"q_ref, {position}": recording.q_ref,
        f"qd, {speed}": recording.qd,
        "current, A": recording.current,
        f"tau, {unit_of(*joints)}": recording.tau,
    }
