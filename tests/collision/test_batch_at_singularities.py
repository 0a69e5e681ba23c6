"""Many poses at once, beside singularities and with joint limits ignored: there the least difference decides."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop import CollisionProblem, Robot
from bumpstop.arrays import FloatArray
from bumpstop.collision import problem as problem_module
from collision.cases import control_group, ur10e

# The joints that bend a wrist and an elbow, whose singularities are at zero.
BENDING = {"sia5d": (5, 3), "ur10e": (4, 2)}
BASES = {"sia5d": control_group(), "ur10e": ur10e()}


@pytest.fixture
def no_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots whose joints turn without end."""
    own = problem_module.robot_of

    def unlimited(scenario: bs.Scenario) -> Robot:
        robot = own(scenario)
        free = (replace(joint, lower=-math.inf, upper=math.inf) for joint in robot.joints)
        return replace(robot, joints=tuple(free))

    monkeypatch.setattr(problem_module, "robot_of", unlimited)


def beside(base: bs.Scenario, count: int, speed: float) -> tuple[FloatArray, FloatArray]:
    """Poses (count, dof), within the robot's own limits but for a joint next to zero, and velocities (count, 3)."""
    robot, problem = Robot.load(base.robot), CollisionProblem.from_scenario(base)
    rng = np.random.default_rng(3)
    q = rng.uniform(robot.lower, robot.upper, size=(count, robot.dof))
    for joint in base.motion.held_joints:
        q[:, joint - 1] = problem.q[joint - 1]
    for i in range(count):
        q[i, BENDING[str(base.robot)][i % 2]] = rng.choice([-1, 1]) * 10 ** rng.uniform(-4, -1)
    direction = rng.normal(size=(count, 3))
    return q, speed * direction / np.linalg.norm(direction, axis=1)[:, None]


@pytest.mark.usefixtures("no_limits")
@pytest.mark.parametrize(
    ("robot", "count", "speed", "rows"),
    [
        # A path that passes a singularity by a hair, and reactions that swing forward again beside one.
        ("ur10e", 300, 0.01, [90, 182]),
        ("ur10e", 40, 0.05, [2, 7, 30]),
        ("sia5d", 300, 0.05, [42]),
    ],
)
@pytest.mark.parametrize("kind", ["reverse", "stop"])
def test_a_batch_is_its_laws_beside_singularities(
    robot: str, count: int, speed: float, rows: list[int], kind: str
) -> None:
    base = BASES[robot].with_values({"reaction.kind": kind})
    q, velocity = beside(base, count, speed)
    problem = CollisionProblem.from_scenario(base)
    limits = [60.0, 135.0, 250.0]
    batch = bs.evaluate_batch(problem, q[rows], velocity[rows], limits_N=limits)
    for row, i in enumerate(rows):
        changes: dict[str, Any] = {
            "pose_deg": None,
            "pose_rad": q[i].tolist(),
            "motion.velocity_mm_s": (1e3 * velocity[i]).tolist(),
        }
        result = bs.evaluate(base.with_values(changes))
        assert batch.end[row] == result.curve.end
        assert batch.mean[row] == pytest.approx(result.peak_force.mean, rel=5e-5)
        for column, limit in enumerate(limits):
            assert batch.exceedance[row, column] == pytest.approx(result.peak_force.exceedance(limit), abs=5e-5)


def test_a_batch_sees_the_farthest_place_of_a_fast_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without velocity limits joints start at hundreds of rad/s and carry the point round while they brake."""
    base = BASES["ur10e"].with_values({"reaction.kind": "stop"})
    q, velocity = beside(base, 30, 0.05)
    own = problem_module.robot_of

    def unlimited(scenario: bs.Scenario) -> Robot:
        robot = own(scenario)
        free = (replace(joint, lower=-math.inf, upper=math.inf, velocity=math.inf) for joint in robot.joints)
        return replace(robot, joints=tuple(free))

    monkeypatch.setattr(problem_module, "robot_of", unlimited)
    batch = bs.evaluate_batch(CollisionProblem.from_scenario(base), q[[0, 2]], velocity[[0, 2]])
    for row, i in enumerate((0, 2)):
        pose = {"pose_deg": None, "pose_rad": q[i].tolist(), "motion.velocity_mm_s": (1e3 * velocity[i]).tolist()}
        assert batch.mean[row] == pytest.approx(bs.evaluate(base.with_values(pose)).peak_force.mean, rel=1e-4)
