"""Residuals and recordings that the commands of tuning are given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.detection import ResidualSeries
from bumpstop.model import inverse_dynamics
from bumpstop.recording import Recording
from detection.tuning_cases import residuals


@pytest.fixture(scope="module")
def noise(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Residuals of the example's seven joints, a row every feedback period of 4 ms."""
    series = residuals(0.05, 1, joints=7)
    path = tmp_path_factory.mktemp("noise") / "free.parquet"
    ResidualSeries(np.arange(series.t.size) * 0.004, 0.4 * series.rows).save(path)
    return path


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A recording of joint torque with noise, a UR5e at 250 Hz for 40 s, pushed from 30 s on; and a label of it."""
    folder = tmp_path_factory.mktemp("loop")
    robot, t = bs.Robot.load("ur5e"), 0.004 * np.arange(10_000)
    phase = 0.3 * t[:, None] + np.arange(6)
    q, qd, qdd = np.sin(phase), 0.3 * np.cos(phase), -0.09 * np.sin(phase)
    tau = inverse_dynamics(robot, q, qd, qdd) + np.random.default_rng(1).normal(0, 0.5, q.shape)
    tau[7500:7600, 1] += 60
    Recording(t=t, q=q, tau=tau).save(folder / "log.parquet")
    (folder / "labels.csv").write_text("start_s,end_s\n30,30.4\n")
    return folder / "log.parquet", folder / "labels.csv"
