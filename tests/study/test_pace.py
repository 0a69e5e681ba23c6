"""Trajectories slowed down to their limits, against the laws of collisions that begin at single moments of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.study import run
from bumpstop.study.atlas import TrajectoryAtlas
from bumpstop.study.pace import least_of_ranges
from bumpstop.study.retiming import retime
from bumpstop.study.trajectory_writing import write_csv


def waves(seed: int, folder: Path) -> bs.Scenario:
    """A Panda that winds itself past places where it feels little; thresholds differ from joint to joint."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 1, 25)
    size, phase, rate = rng.uniform(0.1, 0.5, 7), rng.uniform(0, 6, 7), rng.uniform(2, 5, 7)
    turns = size * (np.sin(rate * t[:, None] + phase) - np.sin(phase)) * np.sin(np.pi * t[:, None] / 2) ** 2
    q = np.radians([0, -20, 0, -120, 0, 110, 30]) + turns
    names = ",".join(["t", *(f"q_{j}" for j in range(1, 8))])
    np.savetxt(folder / "t.csv", np.column_stack([t, q]), delimiter=",", header=names, comments="", fmt="%.17g")
    return bs.Scenario.from_dict(
        {
            "robot": "panda",
            "motion": {"kind": "trajectory", "file": str(folder / "t.csv")},
            "contact": {"body": "upper_arm_elbow", "limits": "ts15066", "area_cm2": 4.0},
            "detector": {
                "thresholds_Nm": [13, 13, 10, 24, 22, 15, 9],
                "noise_sd_Nm": [1.5, 1.5, 1.2, 3, 2.7, 1.8, 1],
            },
            "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 4.5},
        }
    )


def slowed(study: TrajectoryAtlas, pace: Any, folder: Path) -> tuple[bs.Scenario, Any]:
    """The same scenario on the slowed trajectory, and when it passes the rows."""
    slow = retime(study.trajectory, pace, study.problem.robot.velocity, study.problem.joint_acceleration)
    write_csv(folder / "slow.csv", slow)
    return study.scenario.with_values({"motion.file": str(folder / "slow.csv")}), slow.time[slow.waypoint]


def worst_risk(scenario: bs.Scenario, moments: Any) -> float:
    """Of collisions that begin at these moments and are noticed."""
    risks = []
    for moment in moments:
        law = bs.evaluate(scenario.with_values({"motion.contact_time": float(moment)}))
        over = max(law.verdict.p_over_force or 0.0, law.verdict.p_over_pressure or 0.0)
        risks.append(over - law.undetected_probability)
    return max(risks)


@pytest.mark.parametrize("seed", [62, 78, 197])
def test_an_arm_that_speeds_up_behind_a_place_where_it_feels_little_keeps_its_limit(seed: int, tmp_path: Path) -> None:
    study = TrajectoryAtlas(waves(seed, tmp_path))
    rows, _ = run(study)
    scenario, moments = slowed(study, study.pace(rows), tmp_path)
    assert worst_risk(scenario, moments[1:-1]) <= scenario.verdict.risk


def test_speeding_up_behind_such_a_place_is_told(tmp_path: Path) -> None:
    """Every row below its own limit is not enough."""
    study = TrajectoryAtlas(waves(78, tmp_path))
    rows, _ = run(study)
    own = np.minimum(1.0, 0.99 * rows["limit_mm_s"].to_numpy() / np.maximum(rows["speed_mm_s"].to_numpy(), 1e-3))
    beside = np.pad(own, 1, constant_values=1.0)
    scenario, moments = slowed(study, np.minimum(own, np.minimum(beside[:-2], beside[2:])), tmp_path)
    assert worst_risk(scenario, moments[1:-1]) > 0.05
    rows, summary = run(TrajectoryAtlas(scenario))
    assert (rows["speed_mm_s"] <= rows["limit_mm_s"]).all()
    assert not summary["acceptable"]


@pytest.mark.parametrize("count", [1, 2, 7, 100])
def test_least_of_ranges_is_that_of_slices(count: int) -> None:
    rng = np.random.default_rng(count)
    values = rng.normal(size=count)
    first, last = np.sort(rng.integers(0, count, (2, 60)), axis=0)
    wanted = [values[a : b + 1].min() for a, b in zip(first, last, strict=True)]
    assert np.array_equal(least_of_ranges(values, first, last), wanted)
