"""A wrench is along the tip's axes, whatever axes its file has it along."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bumpstop import InputError, Robot
from bumpstop.arrays import FloatArray
from bumpstop.recording import Recording
from model.random_chains import turn, unit
from recording.cases import written

UR5E = Robot.load("ur5e")
T = 0.01 * np.arange(100)
Q = 0.3 + np.sin(T[:, None] * np.arange(1, 7))
TILT = turn(unit([0.2, 1.0, -0.5]), 0.7).real
# What a sensor at the tip says.
TIP = np.column_stack([10 + T, -5 * T, np.cos(T), 0.1 * T, np.sin(T), 0.3 - T])
COLUMNS: dict[str, Any] = {
    "time": {"column": "timestamp"},
    "position": {"columns": [f"actual_q_{j}" for j in range(6)]},
    "wrench": {"columns": [f"actual_TCP_force_{j}" for j in range(6)]},
}


def rtde(folder: Path, wrench: FloatArray) -> Path:
    names = ["timestamp", *(f"{stem}_{j}" for stem in ("actual_q", "actual_TCP_force") for j in range(6))]
    rows = np.column_stack([T, Q, wrench])
    return written(folder, [",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())])


def in_base(robot: Robot) -> FloatArray:
    """The tip's wrench, along the axes of the robot's base."""
    return np.concatenate([np.einsum("nij,nj->ni", robot.pose(Q)[:, :3, :3], part) for part in np.split(TIP, 2, 1)], 1)


def turned(robot: Robot, axes: FloatArray) -> Robot:
    """The robot, with its first joint's frame turned against the base."""
    first, *others = robot.joints
    together = axes @ np.array(first.rotation)
    return replace(robot, joints=(replace(first, rotation=tuple(map(tuple, together.tolist()))), *others))


def test_a_ur_s_force_is_along_the_controller_s_base(tmp_path: Path) -> None:
    """As RTDE gives it. It knows nothing of where the robot's base frame is: ROS turns that by half a turn."""
    path = rtde(tmp_path, in_base(UR5E))
    for robot in (UR5E, turned(UR5E, np.diag([-1.0, -1.0, 1.0])), turned(UR5E, TILT)):
        np.testing.assert_allclose(Recording.load(path, robot=robot).wrench, TIP, atol=1e-12)


def test_a_column_file_says_the_frame(tmp_path: Path) -> None:
    robot = turned(UR5E, TILT)
    files = {"tip": TIP, "base": in_base(robot), "first_joint": in_base(UR5E)}
    for frame, wrench in files.items():
        columns = COLUMNS | {"wrench": COLUMNS["wrench"] | {"frame": frame}}
        found = Recording.load(rtde(tmp_path, wrench), columns=columns, robot=robot)
        np.testing.assert_allclose(found.wrench, TIP, atol=1e-12)
    as_before = Recording.load(rtde(tmp_path, TIP), columns=COLUMNS, robot=robot)
    np.testing.assert_array_equal(as_before.wrench, TIP)


def test_without_the_robot_a_wrench_that_would_have_to_be_turned_is_left_out(tmp_path: Path) -> None:
    """Written to a file of ours it would be taken for one along the tip's axes."""
    found = Recording.load(rtde(tmp_path, in_base(UR5E)))
    assert found.wrench is None
    assert "along axes that stand still and is left out" in found.report.notes[-1]
    assert Recording.load(rtde(tmp_path, TIP), columns=COLUMNS).wrench is not None


def test_frames_that_mean_nothing(tmp_path: Path) -> None:
    path = rtde(tmp_path, TIP)
    for quantity, frame, problem in (("wrench", "world", "'world' cannot be used"), ("position", "tip", "no such key")):
        columns = COLUMNS | {quantity: COLUMNS[quantity] | {"frame": frame}}
        with pytest.raises(InputError, match=rf"columns\.{quantity}\.frame: .*{problem}"):
            Recording.load(path, columns=columns)
