"""Slowed trajectories keep path and limits, however far apart their waypoints are."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from bumpstop.collision.trajectory.trajectory import Trajectory
from bumpstop.errors import InputError
from bumpstop.study.speed.trajectory.retiming import retime
from study.speed_limit_cases import wavy


@pytest.mark.parametrize("with_velocity", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_retimed_keeps_limits_and_path(seed: int, with_velocity: bool) -> None:
    rng = np.random.default_rng(seed)
    trajectory = wavy(rng, 120, with_velocity)
    allowed = np.clip(0.7 + 0.5 * np.sin(np.linspace(0, 9, 120) + seed), 0.25, 1.0)
    velocity, acceleration = np.full(6, 0.9), np.full(6, 2.0)
    found = retime(trajectory, allowed, velocity, acceleration)
    assert (np.diff(found.time) > 0).all()
    assert found.time[-1] >= trajectory.duration * (1 - 1e-12)
    assert (found.position[found.waypoint] == trajectory.position).all()
    rate = np.linalg.norm(trajectory.at(trajectory.time, 1), axis=1)
    assert (np.linalg.norm(found.velocity[found.waypoint], axis=1) <= allowed * rate * (1 + 1e-12)).all()
    # What a robot makes of the rows, between them too.
    spline = CubicHermiteSpline(found.time, found.position, found.velocity)
    t = np.linspace(0, found.time[-1], 40_001)
    assert (np.abs(spline(t, 1)) <= velocity).all()
    assert (np.abs(spline(t, 2)) <= acceleration).all()
    assert (np.abs(found.acceleration) <= acceleration).all()
    # The path speed changes evenly in time between waypoints, which tells where on the path a moment lies.
    piece = np.clip(np.searchsorted(found.time, t, side="right") - 1, 0, len(found.time) - 2)
    share = t - found.time[piece]
    dt, du = np.diff(found.time)[piece], np.diff(found.path_time)[piece]
    speeds = np.linalg.norm(found.velocity, axis=1) / np.maximum(
        np.linalg.norm(trajectory.at(found.path_time, 1), axis=1), 1e-12
    )
    change = (speeds[piece + 1] - speeds[piece]) / dt
    moment = found.path_time[piece] + share * speeds[piece] + change * share**2 / 2
    assert np.abs(speeds[piece] * dt + change * dt**2 / 2 - du).max() < 1e-9
    assert np.abs(spline(t) - trajectory.at(moment)).max() < 1e-9


@pytest.mark.parametrize("gap", [0.5, 20.0])
def test_waypoints_far_apart_keep_the_path_too(gap: float) -> None:
    rng = np.random.default_rng(3)
    trajectory = Trajectory(gap * np.arange(6), rng.uniform(-2, 2, (6, 3)), None)
    found = retime(trajectory, rng.uniform(0.2, 1, 6), np.full(3, 3.0), np.full(3, 9.0))
    spline = CubicHermiteSpline(found.time, found.position, found.velocity)
    # Between two rows the path speed changes evenly in time, which tells where on the path the middle lies.
    path_speed = np.linalg.norm(found.velocity, axis=1) / np.linalg.norm(trajectory.at(found.path_time, 1), axis=1)
    dt = np.diff(found.time)
    moment = found.path_time[:-1] + dt * (3 * path_speed[:-1] + path_speed[1:]) / 8
    assert np.abs(spline(found.time[:-1] + dt / 2) - trajectory.at(moment)).max() < 1e-9


def test_waypoints_too_far_apart_are_refused() -> None:
    rng = np.random.default_rng(3)
    trajectory = Trajectory(np.arange(6.0), rng.uniform(-1e4, 1e4, (6, 3)), None)
    with pytest.raises(InputError, match="closer together"):
        retime(trajectory, rng.uniform(0.2, 1, 6), np.full(3, 1e5), np.full(3, 1e6))


def test_nothing_to_slow_down_changes_nothing() -> None:
    trajectory = wavy(np.random.default_rng(1), 50, True)
    found = retime(trajectory, np.ones(50), np.full(6, 1e3), np.full(6, 1e4))
    assert np.allclose(found.time[found.waypoint], trajectory.time, rtol=1e-12)


@pytest.mark.parametrize("path_speed", [1.5, 3.0])
def test_no_path_speed_makes_a_path_faster_than_it_was_given(path_speed: float) -> None:
    trajectory = wavy(np.random.default_rng(1), 50, True)
    found = retime(trajectory, np.full(50, path_speed), np.full(6, 1e3), np.full(6, 1e4))
    assert (np.diff(found.time[found.waypoint]) >= np.diff(trajectory.time) * (1 - 1e-12)).all()
    assert (np.abs(found.velocity[found.waypoint]) <= np.abs(trajectory.at(trajectory.time, 1)) + 1e-12).all()


def test_a_moment_without_a_safe_speed_is_named() -> None:
    trajectory = wavy(np.random.default_rng(1), 10, True)
    allowed = np.ones(10)
    allowed[6] = 0.0
    with pytest.raises(InputError, match=f"at {trajectory.time[6]:.6g} s"):
        retime(trajectory, allowed, np.ones(6), np.ones(6))


def test_what_rests_at_its_end_rests_there_slowed_down_too() -> None:
    """A file's digits leave a rate at the end, which is more than a hundredth of what a slow motion has."""
    t = np.linspace(0, 1, 26)
    rounded = np.round(10 * t**3 - 15 * t**4 + 6 * t**5, 4)[:, None]
    for end, stops in ((0.0, True), (0.1, False)):
        trajectory = Trajectory(t, rounded + end * t[:, None])
        found = retime(trajectory, np.append(np.full(25, 0.02), 1.0), np.full(1, 9.0), np.full(1, 99.0))
        assert np.abs(trajectory.at(1.0, 1)).max() > 1e-3
        assert trajectory.stops_short != stops
        assert Trajectory(found.time, found.position, found.velocity).stops_short != stops
