"""Effective mass and singular values against plain linear algebra."""

from __future__ import annotations

import numpy as np
import pytest

from bumpstop.model import (
    Joint,
    LinkInertia,
    Robot,
    effective_mass,
    manipulability,
    mass_matrix,
    robots,
    singular_values,
)
from model.dynamics_cases import general_arm
from model.random_chains import positions, random_robots
from model.random_motions import random_arms, random_motion


def test_effective_mass_by_a_linear_solve() -> None:
    rng = np.random.default_rng(30)
    for robot in (general_arm(), *random_arms()):
        m = random_motion(robot, 4, rng)
        n = rng.normal(size=(4, 3))
        n /= np.linalg.norm(n, axis=1)[:, None]
        link = robot.joints[m.link].link
        found = effective_mass(robot, m.q, n, link, m.point)
        for i in range(4):
            row = n[i] @ robot.jacobian(m.q[i], link, m.point)[:3]
            mobility = row @ np.linalg.solve(mass_matrix(robot, m.q[i]), row)
            # Relative to what the joints could do, as a push may miss them by a hair.
            scale = (row @ row + 1e-3) / np.linalg.eigvalsh(mass_matrix(robot, m.q[i]))[0]
            assert abs(1 / found[i] - mobility) <= 1e-10 * scale
        assert np.array_equal(effective_mass(robot, m.q, n[0], link, m.point)[:1], found[:1])


def test_effective_mass_of_what_cannot_move() -> None:
    joint = Joint(name="j", link="l", inertia=LinkInertia(mass=2.0, center=(0.5, 0.0, 0.0)))
    robot = Robot(name="door", joints=(joint,), tip_origin=(0.5, 0.0, 0.0))
    assert effective_mass(robot, [0.0], (0.0, 0.0, 1.0)) == np.inf
    assert effective_mass(robot, [0.0], (0.0, 1.0, 0.0)) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("name", "pose", "link", "direction"),
    [
        ("sia5d", 0.0, "link_e", (0.0, 1.0, 0.0)),
        ("panda", 0.0, "panda_link3", (0.0, 1.0, 0.0)),
        ("panda", 0.0, "panda_link5", (0.0, 1.0, 0.0)),
        ("ur10", np.pi / 2, "forearm_link", (1.0, 0.0, 0.0)),
    ],
)
def test_effective_mass_where_rounding_alone_moves_the_point(
    name: str, pose: float, link: str, direction: tuple[float, float, float]
) -> None:
    robot = Robot.load(name)
    q = np.full(robot.dof, pose)
    assert 0 < np.abs(robot.jacobian(q, link)[:3].T @ direction).max() < 1e-15
    assert effective_mass(robot, q, direction, link) == np.inf
    # What is small and no rounding counts: a joint turned by a millionth moves the point by a millionth.
    turned = effective_mass(robot, q + 1e-6, direction, link)
    assert 1e6 < turned < 1e15


@pytest.mark.parametrize(("rows", "count"), [("linear", 3), ("all", 6)])
def test_singular_values_by_numpy(rows: str, count: int) -> None:
    rng = np.random.default_rng(31)
    for robot in (*map(Robot.load, robots()), *random_robots()):
        q = np.concatenate([positions(robot, 3, rng), np.zeros((1, robot.dof))])
        link, point = robot.joints[int(rng.integers(robot.dof))].link, rng.uniform(-0.5, 0.5, 3)
        found = singular_values(robot, q, link, point, rows=rows)  # type: ignore[arg-type]
        known = np.zeros((4, count))
        some = np.linalg.svd(robot.jacobian(q, link, point)[:, :count], compute_uv=False)
        known[:, : some.shape[1]] = some
        scale = known[:, :1] + 1e-300
        assert (np.abs(found - known) <= 1e-13 * scale).all()
        measure = manipulability(robot, q, link, point, rows=rows)  # type: ignore[arg-type]
        assert (np.abs(measure - known.prod(axis=1)) <= 1e-12 * scale[:, 0] ** count).all()


def test_small_singular_values_keep_their_digits() -> None:
    # Two links nearly stretched out: the smaller value goes with the sine of the elbow.
    joints = (Joint(name="a", link="one"), Joint(name="b", link="two", origin=(1.0, 0.0, 0.0)))
    robot = Robot(name="planar", joints=joints, tip_origin=(1.0, 0.0, 0.0))
    for elbow in 10.0 ** -np.arange(1, 8):
        largest, smallest, none = singular_values(robot, [0.3, elbow])
        assert largest * smallest == pytest.approx(np.sin(elbow), rel=1e-12 / elbow * 1e-3 + 1e-13)
        assert none == 0
        assert manipulability(robot, [0.3, elbow]) == 0
