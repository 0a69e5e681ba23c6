"""Scenarios of a UR10e that stops by a table of stopping distances."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import bumpstop as bs

DEG = np.pi / 180
STRETCHED = [0, 0, 0, 0, 0, 0]  # the arm lies: its tip is near its reach


def one_joint(folder: Path, joint: int, rate: float, table: str, pose: list[float], **reaction: Any) -> bs.Scenario:
    """A UR10e of which a single joint turns at a constant rate."""
    q = np.array(pose) * DEG
    rows = []
    for t in np.arange(0, 0.41, 0.02):
        q_t = q.copy()
        q_t[joint - 1] += rate * t
        rows.append(",".join(f"{x:.12f}" for x in (t, *q_t)))
    (folder / "turn.csv").write_text("t," + ",".join(f"q_{j}" for j in range(1, 7)) + "\n" + "\n".join(rows) + "\n")
    (folder / "table.csv").write_text(table)
    data: dict[str, Any] = {
        "robot": "ur10e",
        "motion": {"kind": "trajectory", "file": "turn.csv"},
        "contact": {"stiffness_N_m": 50000},
        "detector": {"thresholds_Nm": [40, 40, 30, 12, 12, 12], "noise_sd_Nm": 1.0},
        "reaction": {
            "kind": "stop",
            "joint_acceleration_rad_s2": 10,
            "deceleration": "table",
            "stopping_table": "table.csv",
        }
        | reaction,
    }
    return bs.Scenario.from_dict(data, folder)


def extension(pose: list[float]) -> float:
    robot = bs.Robot.load("ur10e")
    x, y, _ = robot.pose(np.array(pose) * DEG)[:3, 3]
    return float(np.hypot(x, y) / robot.reach)


def line(folder: Path, table: str, **reaction: Any) -> bs.Scenario:
    (folder / "table.csv").write_text(table)
    data: dict[str, Any] = {
        "robot": "ur10e",
        "pose_deg": [10, -80, 110, -120, -90, 20],
        "motion": {"velocity_mm_s": [80, 40, -60], "duration_s": 0.3},
        "contact": {"stiffness_N_m": 50000},
        "detector": {"thresholds_Nm": [40, 40, 30, 12, 12, 12], "noise_sd_Nm": [7, 7, 5, 2, 2, 2]},
        "reaction": {"joint_acceleration_rad_s2": 10} | reaction,
    }
    return bs.Scenario.from_dict(data, folder)
