"""Starts at a singularity are refused, regular ones are not, whatever rounding makes of a row of the Jacobian."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop import CollisionProblem, Robot, Scenario, _native
from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError

VELOCITY = (0.01, 0.02, -0.03)
# Regular on every arm here.
REGULAR_DEG = [17, -40, 25, 60, -35, 50, 20]
PANDA_DEG = [17, -40, 25, -90, -35, 110, 20]
# The Jacobian's least singular value over its largest: below the one a pose is singular but for rounding, above the
# other it is regular. Poses between, whose lengths bring them near a singularity by chance, are not judged here.
SINGULAR, REGULAR = 1e-9, 1e-4


def scenario(robot: str, **motion: Any) -> Scenario:
    dof = Robot.load(robot).dof
    pose = PANDA_DEG if robot == "panda" else REGULAR_DEG[:dof]
    return Scenario.from_dict(
        {
            "robot": robot,
            "pose_deg": pose,
            "motion": {"velocity_mm_s": [1e3 * v for v in VELOCITY], **motion},
            "contact": {"stiffness_N_m": 50_000.0},
            "detector": {"thresholds_Nm": [20.0] * dof, "noise_sd_Nm": 3.0},
            "reaction": {"joint_acceleration_rad_s2": 5.0},
        }
    )


def multiples(robot: Robot, degrees: int, count: int) -> FloatArray:
    """Poses within the limits, within half a turn, all of whose angles are multiples of so many degrees."""
    rng = np.random.default_rng(degrees)
    grid = np.deg2rad(np.arange(-180, 181, degrees))
    own = [grid[(grid >= low) & (grid <= high)] for low, high in zip(robot.lower, robot.upper, strict=True)]
    return np.stack([rng.choice(values, count) for values in own], axis=1)


def closeness(robot: Robot, q: FloatArray, task: str, held: list[int]) -> FloatArray:
    """Least singular value over the largest (N,), translations in units of how far the tip is from the joints."""
    free = [j for j in range(robot.dof) if j + 1 not in held]
    jacobian = np.array([robot.jacobian(pose) for pose in q])[:, :, free]
    if task == "position":
        jacobian = jacobian[:, :3]
    jacobian[:, :3] /= np.sqrt((jacobian[:, :3] ** 2).sum((1, 2)) / 3)[:, None, None]
    values = np.linalg.svd(jacobian, compute_uv=False)
    return np.asarray(values[:, -1] / values[:, 0])


CASES = [
    (name, {"task": task, "held_joints": held})
    for name in bs.robots()
    for task in ("pose", "position")
    for held in (
        [[], [1, 2], [5]]
        if task == "position"
        # Without its elbow an arm of seven joints has a wrist that keeps its distance from the shoulder.
        else [[], [1], [3], [7]]
        if Robot.load(name).dof == 7
        else [[]]
    )
]


@pytest.mark.parametrize(("name", "motion"), CASES, ids=[f"{name} {motion}" for name, motion in CASES])
def test_right_angles_and_their_parts(name: str, motion: dict[str, Any]) -> None:
    """Of poses at multiples of 90, 45 and 30 degrees: by an SVD that shares nothing with the kernels."""
    problem = CollisionProblem.from_scenario(scenario(name, **motion))
    robot = problem.robot
    q = np.concatenate([multiples(robot, degrees, 150) for degrees in (90, 45, 30)])
    near = closeness(robot, q, motion["task"], motion["held_joints"])
    found = np.array([_native.line_start(problem.setup, pose, np.array(VELOCITY)).singular for pose in q])
    # An arm that need not keep its orientation is hardly ever singular.
    assert (near < SINGULAR).sum() > 20 or motion["task"] == "position"
    assert (near > REGULAR).sum() > 20
    np.testing.assert_array_equal(q[(near < SINGULAR) & ~found], np.empty((0, robot.dof)))
    np.testing.assert_array_equal(q[(near > REGULAR) & found], np.empty((0, robot.dof)))
    # A batch says the same of each.
    some = slice(None, None, 5)
    end = bs.evaluate_batch(problem, q[some], np.tile(VELOCITY, (len(q[some]), 1))).end
    np.testing.assert_array_equal(end == "singular_start", found[some])


@pytest.mark.parametrize("name", bs.robots())
def test_random_poses_are_not_refused(name: str) -> None:
    problem = CollisionProblem.from_scenario(scenario(name))
    robot = problem.robot
    q = np.random.default_rng(3).uniform(
        np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi), (300, robot.dof)
    )
    assert closeness(robot, q, "pose", []).min() > 1e-6
    assert not any(_native.line_start(problem.setup, pose, np.array(VELOCITY)).singular for pose in q)


@pytest.mark.parametrize(
    ("name", "pose", "held"),
    [("sia5d", [0, 0, 0, 90, 0, 0, 0], [7]), ("ur10e", [0, -90, 90, 0, 0, 0], []), ("ur10e", [0, 0, 0, 0, 0, 0], [])],
)
def test_a_row_of_nothing_but_rounding_is_a_singularity(name: str, pose: list[float], held: list[int]) -> None:
    told = r"pose_deg: is singular: no finite joint rates move the tip .*; give another pose, or motion.damping"
    with pytest.raises(InputError, match=told):
        bs.evaluate(scenario(name, held_joints=held).with_values({"pose_deg": pose}))


@pytest.mark.parametrize("damping", [1e-9, 1e-3])
def test_with_damping_there_is_none(damping: float) -> None:
    """However small it is, and alone as in a batch."""
    damped = scenario("ur10e", damping=damping).with_values({"pose_deg": [0, -90, 90, 0, 0, 0]})
    problem = CollisionProblem.from_scenario(damped)
    assert not problem.start.singular
    assert np.isfinite(problem.start.qd).all()
    end = bs.evaluate_batch(problem, problem.q[None], np.array([VELOCITY])).end
    assert end[0] not in ("singular_start", "singularity")


@pytest.mark.parametrize("off", [1e-8, 1e-7, 1e-5, 1e-4])
def test_how_near_does_not_depend_on_the_base_frame(off: float) -> None:
    """A row that all but vanishes in one base frame leans on the others in another: both say the same."""
    singular = np.deg2rad([0.0, -90, 90, 0, 0, 0])
    problem = CollisionProblem.from_scenario(scenario("ur10e"))
    for turn in np.linspace(0, 2 * np.pi, 9):
        # A turn of the first joint turns the whole Jacobian.
        pose = singular + off
        pose[0] = turn
        assert _native.line_start(problem.setup, pose, np.array(VELOCITY)).singular == (off < 1e-6)
