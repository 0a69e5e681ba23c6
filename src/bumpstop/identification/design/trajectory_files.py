"""Planned motions as files for a controller: CSV at an even rate, and ROS JointTrajectory."""

from __future__ import annotations

import io
import json
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bumpstop.identification.design.timed_path import TimedPath


def trajectory_csv(path: TimedPath, rate_hz: float) -> str:
    """Rows ``t, q_1..q_n, qd_1..qd_n`` at an even rate [s, rad, rad/s], the columns of a recording.

    For controllers that are fed a position every so often.
    """
    even = path.sampled(rate_hz)
    n = even.q.shape[1]
    names = ["t", *(f"q_{j + 1}" for j in range(n)), *(f"qd_{j + 1}" for j in range(n))]
    text = io.StringIO()
    np.savetxt(
        text, np.column_stack([even.t, even.q, even.qd]), fmt="%.9g", delimiter=",", header=",".join(names), comments=""
    )
    return text.getvalue()


def joint_trajectory(path: TimedPath, joint_names: list[str]) -> str:
    """A ``trajectory_msgs/JointTrajectory`` as JSON, which is YAML too: as few points as the motion needs.

    Every point has positions, velocities and accelerations, so that a joint trajectory controller joins them with
    polynomials of fifth degree, which is what the plan means. Without accelerations it would take cubics: the same
    points at the same times, ramps with constant acceleration.
    """
    points = []
    for k, time in enumerate(path.t):
        nanoseconds = round(float(time) * 1e9)
        points.append(
            json.dumps(
                {
                    "positions": [round(float(x), 9) + 0.0 for x in path.q[k]],
                    "velocities": [round(float(x), 9) + 0.0 for x in path.qd[k]],
                    "accelerations": [round(float(x), 9) + 0.0 for x in path.qdd[k]],
                    "time_from_start": {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9},
                }
            )
        )
    return f'{{"joint_names": {json.dumps(joint_names)},\n"points": [\n' + ",\n".join(points) + "\n]}\n"
