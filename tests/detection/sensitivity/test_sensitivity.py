"""Forces that no threshold detects: against a search over directions, known shapes, and Schroeder's table."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop import _native
from bumpstop.detection import (
    largest_undetected_force,
    largest_undetected_torque,
    required_torque,
    undetectable_force_along,
    undetectable_forces,
    undetectable_stretches,
)
from bumpstop.model import Joint, Robot
from detection.direction_search import directions, farthest
from detection.sensitivity_cases import random_cases, singular_cases

# The library moves every bound out by 1e-12 so that no edge is lost to rounding.
ROUNDING = 1e-11
EXAMPLE = Path(__file__).parents[3] / "examples" / "01_hand_downward.toml"


@pytest.mark.parametrize("dof", range(3, 13))
def test_farthest_vertex_is_what_a_search_over_directions_finds(dof: int) -> None:
    columns, low, high = random_cases(np.random.default_rng(dof), dof, 60)
    found = kernel(columns, low, high)
    searched = farthest(columns.transpose(0, 2, 1), low, high, directions(48))
    np.testing.assert_allclose(found["largest"], searched, rtol=1e-9)
    assert (found["rank"] == 3).all()


@pytest.mark.parametrize("rank", [1, 2])
@pytest.mark.parametrize("dof", [3, 6, 7, 12])
def test_singular_poses(dof: int, rank: int) -> None:
    columns, low, high, walls, lost = singular_cases(np.random.default_rng(100 * rank + dof), dof, 30, rank)
    found = kernel(columns, low, high)
    assert (found["rank"] == rank).all()
    assert np.isinf(found["largest"]).all()
    # A thin slab across the lost directions makes the polytope bounded.
    flat = np.concatenate([columns.transpose(0, 2, 1), lost], axis=1)
    searched = farthest(
        flat, np.concatenate([low, -walls], axis=1), np.concatenate([high, walls], axis=1), directions(64)
    )
    np.testing.assert_allclose(found["detectable"], searched, rtol=1e-9)
    for axes, own in zip(found["axes"], lost, strict=True):
        null = axes[rank:]
        np.testing.assert_allclose(null @ null.T, np.eye(3 - rank), atol=1e-12)
        np.testing.assert_allclose(own @ null.T @ null, own, atol=1e-11)


def kernel(columns: np.ndarray, low: np.ndarray, high: np.ndarray) -> dict[str, np.ndarray]:
    """Of cases with bands of their own."""
    names = ("largest", "detectable", "largest_vector", "singular", "rank", "axes")
    rows = [
        _native.undetectable_forces(np.ascontiguousarray(c[None]), a, b)
        for c, a, b in zip(columns, low, high, strict=True)
    ]
    return {name: np.concatenate([row[k] for row in rows]) for k, name in enumerate(names)}


def test_the_farthest_force_lies_on_three_faces_and_inside_the_others() -> None:
    robot = Robot.load("iiwa14")
    q = np.random.default_rng(5).uniform(-1.5, 1.5, (200, 7))
    theta, mean = np.array([20.0, 10, 15, 8, 5, 4, 3]), np.array([1.0, -2, 0, 1, 0.5, 0, -0.5])
    forces = undetectable_forces(robot, q, theta, noise_mean=mean)
    residual = np.einsum("nij,ni->nj", robot.jacobian(q)[:, :3], forces.largest_vector) + mean
    share = np.sort(np.abs(residual) / theta, axis=1)
    assert (share[:, -1] < 1 + ROUNDING).all()
    np.testing.assert_allclose(share[:, -3:], 1, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(forces.largest_vector, axis=1), forces.largest, rtol=1e-12)


def test_three_prismatic_joints_make_a_box() -> None:
    joints = tuple(
        Joint(name=f"j{k}", link=f"l{k}", kind="prismatic", axis=tuple(np.eye(3)[k]), lower=-1, upper=1)
        for k in range(3)
    )
    box = Robot(name="gantry", joints=joints)
    assert float(undetectable_forces(box, [0, 0, 0], [3, 4, 12]).largest) == pytest.approx(13, rel=ROUNDING)
    # A mean takes from one side what it gives to the other; z sigma moves both out.
    forces = undetectable_forces(box, [0, 0, 0], [3, 4, 12], noise_mean=[1, 0, 0])
    np.testing.assert_allclose(np.abs(forces.largest_vector), [4, 4, 12], rtol=ROUNDING)
    assert forces.largest_vector[0] < 0
    wide = undetectable_forces(box, [0, 0, 0], [3, 4, 12], noise_sd=[1, 2, 3], z=2)
    assert float(wide.largest) == pytest.approx(math.sqrt(5**2 + 8**2 + 18**2), rel=ROUNDING)
    # A joint without a threshold drops out, and its direction with it.
    forces = undetectable_forces(box, [0, 0, 0], [3, math.inf, 4])
    assert math.isinf(forces.largest)
    assert float(forces.largest_detectable) == pytest.approx(5, rel=ROUNDING)
    np.testing.assert_allclose(np.abs(forces.null_space), [[0, 1, 0]], atol=1e-15)
    nothing = undetectable_forces(box, [0, 0, 0], math.inf)
    assert nothing.rank == 0
    assert math.isinf(nothing.largest)
    assert nothing.null_space.shape == (3, 3)


def test_along_a_direction() -> None:
    robot = Robot.load("sia5d")
    scenario = bs.load_scenario(EXAMPLE)
    problem = bs.CollisionProblem.from_scenario(scenario)
    curve = bs.stopping_curve(problem)
    share = np.abs(curve.torque_per_newton[0])
    along = undetectable_force_along(robot, problem.q, curve.normal, problem.thresholds)
    # The first tick comes a step after the start: the lever has moved by less than a ten-thousandth.
    assert float(along) == pytest.approx(np.min(problem.thresholds / np.maximum(share, 1e-300)), rel=1e-3)
    # No direction passes the farthest vertex, and its own direction reaches it.
    worst = undetectable_forces(robot, problem.q, problem.thresholds)
    n = directions(500)
    rows = np.tile(problem.q, (500, 1))
    forces = undetectable_force_along(robot, rows, n, problem.thresholds)
    assert forces.max() <= float(worst.largest) * (1 + ROUNDING)
    own = undetectable_force_along(robot, problem.q, worst.largest_vector / worst.largest, problem.thresholds)
    assert float(own) == pytest.approx(float(worst.largest), rel=1e-9)


def test_mean_shifts_the_side_that_is_pushed_to() -> None:
    robot, q = Robot.load("ur5e"), np.array([0.1, -1.0, 1.2, 0.3, 0.9, 0.0])
    n = np.array([0.0, 0.0, -1.0])
    per_newton = robot.jacobian(q)[:3].T @ n
    mean = np.array([1.0, -2, 0.5, 1, 0, 0])
    theta = np.full(6, 10.0)
    room = np.where(per_newton > 0, theta - mean, theta + mean)
    turned = np.abs(per_newton) > 1e-6
    wanted = np.min(room[turned] / np.abs(per_newton[turned]))
    assert float(undetectable_force_along(robot, q, n, theta, noise_mean=mean)) == pytest.approx(wanted, rel=1e-12)


def test_two_joints_with_one_axis_and_equal_thresholds_lose_no_edge() -> None:
    # Wrist stretched: joints 4 and 6 turn about one axis, so their faces fall together.
    robot = Robot.load("iiwa14")
    q = np.array([0.3, 0.5, -0.2, -1.1, 0.4, 0.0, 0.7])
    point = (0.1, 0.05, 0.2)
    both = undetectable_forces(robot, q, 10.0, point=point)
    one = undetectable_forces(robot, q, [10, 10, 10, 10, math.inf, 10, 10], point=point)
    assert float(both.largest) == pytest.approx(float(one.largest), rel=1e-9)


def test_source_table_4_1_and_equations() -> None:
    up, down = required_torque([0, 5, 10, -7, -10], 10)
    np.testing.assert_array_equal(up, [10, 5, 0, 17, 20])
    np.testing.assert_array_equal(down, [-10, -15, -20, -3, 0])
    # 75 mm/s against 19 100 N/m with a lever of 0.4 m, looked at every 4 ms.
    torque = largest_undetected_torque([10, 20], [19_100 * 0.075 * 0.4, 0], 0.004)
    np.testing.assert_allclose(torque, [20 + 2.292, 40])
    np.testing.assert_allclose(largest_undetected_force(torque, [-0.4, 0]), [22.292 / 0.4, math.inf])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"thresholds": [1, 2]}, "thresholds: has shape"),
        ({"thresholds": [10, 10, 0, 10, 10, 10]}, "thresholds of joint 3: is 0"),
        ({"thresholds": math.nan}, "thresholds of joint 1: is nan"),
        ({"noise_mean": [0, 0, 12, 0, 0, 0]}, "noise_mean of joint 3: 12 alarms without contact"),
        ({"noise_sd": -1.0}, "noise_sd of joint 1: is -1"),
        ({"z": -1.0}, "z: is -1"),
        ({"q": [0, 0, math.nan, 0, 0, 0]}, r"q\[2\]: is nan"),
    ],
)
def test_refusals(given: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"q": [0.0] * 6, "thresholds": 10.0} | given
    with pytest.raises(bs.InputError, match=message):
        undetectable_forces(Robot.load("ur5e"), **arguments)  # type: ignore[arg-type]


def test_stretches_of_a_motion_with_large_undetectable_forces() -> None:
    """The elbow is stretched out twice; a stretch ends only 5 % below the limit, as the C++ monitor warns."""
    robot, t = Robot.load("ur5e"), np.linspace(0, 2, 801)
    q = np.radians([0, -60, 0, -80, 50, 0]) + np.outer(np.cos(2 * np.pi * t), [0, 0, 1.5, 0, 0, 0])
    limits = np.array([20.0, 20, 20, 9, 9, 9])
    largest = undetectable_forces(robot, q, limits).largest
    limit = 1.3 * float(np.median(largest))
    found = undetectable_stretches(robot, t, q, limits, limit)
    inside = np.zeros(t.size, dtype=bool)
    for one in found:
        rows = (t >= one.start_s) & (t <= one.end_s)
        inside |= rows
        assert largest[rows][0] > limit
        assert one.largest_N == largest[rows].max()
        assert (largest[rows] > 0.95 * limit).all()
    assert inside[largest > limit].all()
    assert len(found) > 1
    # What the hysteresis adds is there, and lies only between both limits.
    added = inside & ~(largest > limit)
    assert added.any()
    assert (largest[added] > 0.95 * limit).all()
    assert undetectable_stretches(robot, t, q, limits, 2 * float(largest.max())) == ()
    # A joint less, and a direction is not detectable at all: any force stays undetected, from the first row to the
    # last.
    nothing = np.array([20.0, 20, *[np.inf] * 4])
    (whole,) = undetectable_stretches(robot, t, q, nothing, 1e9)
    assert (whole.start_s, whole.end_s, whole.to_json()["largest_N"]) == (t[0], t[-1], None)
    with pytest.raises(bs.InputError, match="limit_N: is 0"):
        undetectable_stretches(robot, t, q, limits, 0)
