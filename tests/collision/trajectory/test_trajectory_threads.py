"""Distributions of trajectories do not depend on the threads that share the work."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.trajectory.trajectory_result import TrajectoryCollisionResult
from collision.trajectory_cases import scenario, trajectory_motion, waves, write_csv


@pytest.mark.parametrize("arm", ["rigid", "elastic"])
def test_integrated_distributions(arm: str, tmp_path: Path) -> None:
    t, q = waves(2, 0.4, rows=10)
    write_csv(tmp_path / "path.csv", t, q)
    path = scenario(tmp_path, trajectory_motion(), robot="iiwa14", arm={"model": arm})
    one, three = (bs.evaluate(path, threads=n) for n in (1, 3))
    assert isinstance(one, TrajectoryCollisionResult)
    assert isinstance(three, TrajectoryCollisionResult)
    assert one.to_json() == three.to_json()
    for name in ("tick", "begin", "mass"):
        np.testing.assert_array_equal(getattr(one.detections, name), getattr(three.detections, name))
    levels = np.linspace(0.01, 0.99, 30)
    assert [one.peak_force.quantile(p) for p in levels] == [three.peak_force.quantile(p) for p in levels]


def test_sampled_runs(tmp_path: Path) -> None:
    t, q = waves(2, 0.4, rows=10)
    write_csv(tmp_path / "path.csv", t, q)
    path = scenario(tmp_path, trajectory_motion(), robot="sia5d")
    one, two = (bs.evaluate(path, samples=600, seed=9, threads=n) for n in (1, 2))
    fewer = bs.evaluate(path, samples=300, seed=9)
    assert one.runs is not None
    assert two.runs is not None
    assert fewer.runs is not None
    for name, values in one.runs.items():
        assert (values == two.runs[name]).all()
        assert (values[:300] == fewer.runs[name]).all()
