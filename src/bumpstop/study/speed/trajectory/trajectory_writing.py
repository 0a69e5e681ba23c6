"""Re-timed trajectories as files: CSV, and a ROS JointTrajectory in JSON."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from bumpstop.output_files import write_bytes

if TYPE_CHECKING:
    from pathlib import Path

    from bumpstop.model import Robot
    from bumpstop.study.speed.trajectory.retiming import Retimed


def write_csv(path: Path, retimed: Retimed) -> None:
    """Columns t, q_1.., qd_1.., as a scenario's motion.file takes them; every digit that matters."""
    dof = retimed.position.shape[1]
    names = ["t", *(f"{kind}_{j + 1}" for kind in ("q", "qd") for j in range(dof))]
    lines = [",".join(names)]
    for t, q, qd in zip(retimed.time, retimed.position, retimed.velocity, strict=True):
        lines.append(",".join(repr(float(value)) for value in (t, *q, *qd)))
    write_bytes(path, ("\n".join(lines) + "\n").encode())


def write_ros(path: Path, retimed: Retimed, robot: Robot) -> None:
    """A trajectory_msgs/JointTrajectory with velocities and accelerations, as JSON, which YAML readers take."""
    points: list[dict[str, Any]] = []
    for t, q, qd, qdd in zip(retimed.time, retimed.position, retimed.velocity, retimed.acceleration, strict=True):
        billionths = round(float(t) * 1e9)
        points.append(
            {
                "positions": q.tolist(),
                "velocities": qd.tolist(),
                "accelerations": qdd.tolist(),
                "time_from_start": {"sec": billionths // 10**9, "nanosec": billionths % 10**9},
            }
        )
    message = {"joint_names": [joint.name for joint in robot.joints], "points": points}
    write_bytes(path, json.dumps(message, allow_nan=False).encode())
