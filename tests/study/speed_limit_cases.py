"""Speed limits along trajectories of a few waypoints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from bumpstop.collision import load_scenario
from bumpstop.collision.trajectory.trajectory import Trajectory
from bumpstop.study.speed.trajectory.trajectory_speed_limits import TrajectorySpeedLimits

PICK = Path(__file__).resolve().parents[2] / "examples/06_pick_and_place_trajectory.toml"


def few_rows(path: Path, t: Any, q: Any, qd: Any = None) -> TrajectorySpeedLimits:
    """Speed limits of the pick's arm along a few rows."""
    names = ["t", *(f"{kind}_{j + 1}" for kind in ("q", "qd")[: 1 if qd is None else 2] for j in range(7))]
    rows = np.column_stack([t, q] if qd is None else [t, q, qd])
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.17g")
    return TrajectorySpeedLimits(load_scenario(PICK, {"motion.file": str(path)}))


def rows_of(study: TrajectorySpeedLimits) -> pl.DataFrame:
    """Its rows alone: behind them ``run`` slows the trajectory down and judges it, which takes longest."""
    return pl.concat([study.shard(number) for number in range(study.shards)])


def begin() -> Any:
    return TrajectorySpeedLimits(load_scenario(PICK)).trajectory.position[0]


def wavy(rng: np.random.Generator, rows: int, with_velocity: bool) -> Trajectory:
    t = np.linspace(0, 4, rows)
    phase, size = rng.uniform(0, 6, (3, 6)), rng.uniform(0.1, 0.5, (3, 6))
    order = np.arange(1, 4)[:, None]
    q = (size[:, None] * np.sin(order[:, :, None] * t[None, :, None] + phase[:, None])).sum(axis=0)
    qd = (size[:, None] * order[:, :, None] * np.cos(order[:, :, None] * t[None, :, None] + phase[:, None])).sum(axis=0)
    return Trajectory(t, q, qd if with_velocity else None)
