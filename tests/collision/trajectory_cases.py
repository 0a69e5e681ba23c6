"""Joint trajectories and arms that follow them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import bumpstop as bs
from bumpstop.arrays import FloatArray
from collision.cases import SIA5D_POSE

GANTRY = """<robot name="gantry"><link name="base_link"/>{joints}</robot>"""
SLIDE = """<joint name="slide_{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/>
<axis xyz="{axis}"/><limit lower="-2" upper="2" velocity="{speed}" effort="1"/></joint><link name="{child}"/>"""
AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
EXAMPLE = Path(__file__).parents[2] / "examples" / "06_pick_and_place_trajectory.toml"


def gantry(folder: Path, speed: float = 1.0) -> None:
    """Three slides, so that paths are straight in the joints, too."""
    links = ["base_link", "link_x", "link_y", "link_z"]
    joints = "".join(
        SLIDE.format(name=name, parent=links[i], child=links[i + 1], axis=axis, speed=speed)
        for i, (name, axis) in enumerate(AXES.items())
    )
    (folder / "gantry.urdf").write_text(GANTRY.format(joints=joints), encoding="utf-8")


def write_csv(path: Path, time: FloatArray, *columns: FloatArray) -> Path:
    dof = columns[0].shape[1]
    names = [f"{symbol}_{j + 1}" for symbol in ("q", "qd")[: len(columns)] for j in range(dof)]
    rows = [",".join(f"{value:.17g}" for value in row) for row in np.column_stack([time, *columns])]
    path.write_text("\n".join([",".join(["t", *names]), *rows]) + "\n", encoding="utf-8")
    return path


def scenario(folder: Path, motion: dict[str, Any], robot: str = "gantry.urdf", **changes: Any) -> bs.Scenario:
    dof = 3 if "gantry" in robot else 7
    data: dict[str, Any] = {
        "robot": robot,
        "motion": motion,
        "contact": {"stiffness_N_m": 20000},
        "detector": {"thresholds_Nm": [20.0] * dof, "noise_sd_Nm": 4.0},
        "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 2.0},
    }
    for key, value in changes.items():
        table, _, name = key.partition("__")
        data[table] = value if not name else data.get(table, {}) | {name: value}
    return bs.Scenario.from_dict(data, folder)


def trajectory_motion(**more: Any) -> dict[str, Any]:
    return {"kind": "trajectory", "file": "path.csv", **more}


def waves(
    seed: int, duration: float, dof: int = 7, rows: int = 40, size: float = 0.15
) -> tuple[FloatArray, FloatArray]:
    """A smooth random motion about the standard pose."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, duration, rows)
    q = np.tile(np.radians(SIA5D_POSE), (rows, 1))[:, :dof]
    for harmonic in (1, 2, 3):
        rate = 0.9 * harmonic
        q = q + size / harmonic * rng.normal(size=dof) * np.sin(rate * t[:, None] + rng.uniform(0, 6, dof))
    return t, q
