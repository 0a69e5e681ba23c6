"""Reactions to motions given as joint trajectories: how they slow down along the path."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.trajectory.trajectory_curve import trajectory_kernel
from bumpstop.collision.trajectory.trajectory_result import TrajectoryCollisionResult
from collision.trajectory_cases import gantry, scenario, trajectory_motion, waves, write_csv


@pytest.mark.parametrize("speed", [0.05, 0.2, 0.5])
def test_stopping_distance(speed: float, tmp_path: Path) -> None:
    gantry(tmp_path)
    t = np.array([0.0, 1.0, 2.0])
    write_csv(tmp_path / "path.csv", t, t[:, None] * [0, 0, -speed])
    problem = bs.CollisionProblem.from_scenario(scenario(tmp_path, trajectory_motion()))
    kernel = trajectory_kernel(problem)
    curve = kernel.curve(0.1, [0.0, 0.0, -1.0])
    for k in (30, 100, 200):
        travelled = curve.max_distance[k] - curve.distance[4 * k + 1]
        # The controller works in sub-steps of 0.2 ms; it has lost speed before it moves on.
        assert travelled == pytest.approx(speed**2 / (2 * 2.0) - speed * 0.2e-3 / 2, abs=2e-6 * speed)


@pytest.mark.parametrize("law", ["constant_time", "ramp"])
def test_a_motion_that_brakes_by_itself_is_not_stopped_sooner(law: str, tmp_path: Path) -> None:
    """What a law says of the rates holds on a path that slows down, too: its own braking does not come on top."""
    gantry(tmp_path)
    cruise, own = 0.4, 0.8  # m/s, m/s2
    t = np.arange(0.0, 1.5001, 0.005)
    speed = np.minimum(np.minimum(own * t, cruise), own * (1.5 - t))
    way = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(t))])
    write_csv(tmp_path / "path.csv", t, way[:, None] * [0, 0, -1.0], speed[:, None] * [0, 0, -1.0])
    more = {"stopping_time_s": 0.3} if law == "constant_time" else {"ramp_time_s": 0.2}
    reaction = {"kind": "stop", "joint_acceleration_rad_s2": 2.0, "deceleration": law, **more}
    kernel = trajectory_kernel(
        bs.CollisionProblem.from_scenario(scenario(tmp_path, trajectory_motion(), reaction=reaction))
    )
    fine = np.linspace(0.0, 1.0, 200_001)
    for k in (40, 150, 200, 260, 270, 290, 300, 350):
        u = kernel.reaction(k)
        v = float(np.interp(u[0], t, speed))
        if law == "constant_time":
            rate = v * (1 - fine / 0.3)
        else:
            brakes = np.maximum(own if u[0] > 1.0 else 0.0, 2.0 * np.minimum(1.0, fine / 0.2))
            rate = v - np.concatenate([[0.0], np.cumsum((brakes[1:] + brakes[:-1]) / 2 * np.diff(fine))])
        left = float(way[-1] - np.interp(u[0], t, way))  # of the path
        stop = min(float(np.trapezoid(np.maximum(rate, 0.0), fine)), left)
        travelled = left - float(way[-1] - np.interp(u[-1], t, way))
        if law == "constant_time" and u[0] < 0.5:
            assert travelled > 1.1 * stop, "the motion speeds up"
        elif u[-1] < 1.0 or u[0] > 1.0:
            assert travelled == pytest.approx(stop, abs=2e-4)


def test_contact_before_the_end(tmp_path: Path) -> None:
    """An arm that stops by itself needs no reaction to; the force is that of the rest of its way."""
    gantry(tmp_path)
    t = np.linspace(0, 1, 60)
    way = 0.1 * (3 * t**2 - 2 * t**3)
    write_csv(tmp_path / "path.csv", t, way[:, None] * [0, 0, -1.0])
    result = bs.evaluate(scenario(tmp_path, trajectory_motion(contact_onset_s=0.98)))
    rest = 0.1 - 0.1 * (3 * 0.98**2 - 2 * 0.98**3)
    assert result.undetected_probability > 0.99
    assert result.peak_force.mean == pytest.approx(20000 * rest, rel=1e-3)
    assert result.verdict.acceptable is None
    assert not any("still moves" in note for note in result.notes), "it comes to rest"
    assert isinstance(result, TrajectoryCollisionResult)
    assert result.max_undetected_force == pytest.approx(20000 * rest, rel=1e-3)
    assert result.peak_force.quantile(0.5) == pytest.approx(20000 * rest, rel=1e-3), "the arm presses no harder"


@pytest.mark.parametrize("kind", ["stop", "reverse"])
@pytest.mark.parametrize("seed", range(6))
def test_no_joint_brakes_harder_than_it_may(seed: int, kind: str, tmp_path: Path) -> None:
    t, q = waves(seed, 2.0)
    write_csv(tmp_path / "path.csv", t, q)
    limit = np.array([3.0, 2.0, 4.0, 2.5, 4.0, 3.0, 5.0])
    problem = bs.CollisionProblem.from_scenario(
        scenario(
            tmp_path,
            trajectory_motion(),
            robot="sia5d",
            reaction={"kind": kind, "joint_acceleration_rad_s2": [float(x) for x in limit]},
        )
    )
    kernel, path = trajectory_kernel(problem), problem.trajectory
    assert path is not None
    assert kernel.acceleration_overload == 1, "the motion itself keeps the limits"
    assert np.abs(path.at(np.linspace(0, 2, 500), 2)).max() < 2
    used = []
    for k in range(0, kernel.ticks - 60, 7):
        u = kernel.reaction(k)
        begin = u[0]
        assert begin == pytest.approx(0.004 * k + 0.001)
        # From the undisturbed motion before it, to the final speed after it.
        u = np.concatenate([[begin - 1e-3], u])
        acceleration = np.diff(path.at(np.clip(u, 0, 2)), n=2, axis=0) / 1e-6
        share = np.abs(acceleration) / limit
        assert share.max() < 1.03
        used.append(share.max(axis=1)[1:-2])
        final = u[-1] - u[-2]
        assert -1.001e-3 < final < (1e-3 if kind == "stop" else 0)
        assert (np.diff(u[1:], n=2) < 1e-12).all(), "an arm that brakes does not speed up"
    # And as hard as they may: some joint is at its limit in nearly every step.
    assert np.median(np.concatenate(used)) > 0.97


def test_curvature_beyond_the_limits(tmp_path: Path) -> None:
    """Where following the path alone needs more than the limits, the arm still brakes, and a note says so."""
    t, q = waves(1, 2.0, size=0.5)
    write_csv(tmp_path / "path.csv", t, q)
    result = bs.evaluate(
        scenario(
            tmp_path,
            trajectory_motion(contact_onset_s=1.0),
            robot="sia5d",
            reaction={"kind": "stop", "joint_acceleration_rad_s2": 0.5},
        )
    )
    assert result.kernel.acceleration_overload > 1.5
    assert any("own joint accelerations" in note for note in result.notes)
    ends = [result.kernel.reaction(k) for k in range(0, result.kernel.ticks, 11)]
    assert all((np.diff(u) >= 0).all() for u in ends)
