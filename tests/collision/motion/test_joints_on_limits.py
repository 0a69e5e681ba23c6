"""Joints that stand on their limits: rounding ends no line, the smallest way out of the range does."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import bumpstop as bs

BODY = {"body": "lower_arm_wrist", "limits": "ts15066", "area_cm2": 2.0}


def scenario(robot: str, q: np.ndarray, velocity: np.ndarray, **more: dict[str, Any]) -> bs.Scenario:
    data: dict[str, Any] = {
        "robot": robot,
        "pose_rad": q.tolist(),
        "motion": {"velocity_mm_s": (1e3 * velocity).tolist()},
        "contact": BODY,
        "detector": {"thresholds_Nm": [20.0] * len(q), "noise_sd_Nm": 2.0},
        "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 4.0, "latency_s": 0.02},
    }
    for table, keys in more.items():
        data[table] = data.get(table, {}) | keys
    return bs.Scenario.from_dict(data)


@pytest.mark.parametrize("inside", [0.0, 1e-15, 1e-14, 1e-9])
def test_a_joint_that_does_not_move_ends_no_line(inside: float) -> None:
    """Joint 6 turns about the vertical in which the tool moves. Its batch ended at once, at 115 N."""
    q = np.radians([0, -90, 90, -90, -90, 360]) - inside * np.eye(6)[5]
    given = scenario("ur10e", q, np.array([0, 0, -0.1]))
    single = bs.evaluate(given)
    batch = bs.evaluate_batch(given, q[None], np.array([[0, 0, -0.1]]), limits_N=[160.0])
    assert single.peak_force.quantile(0.999) == pytest.approx(215.1, abs=0.1)
    assert batch.quantile[0, 3] == pytest.approx(215.1, abs=0.1)
    assert batch.exceedance[0, 0] == pytest.approx(1, abs=1e-6)
    assert batch.end[0] == single.curve.end == "all_detected"


def test_nor_from_rest() -> None:
    """Joint 7 at 180 degrees: it was acceptable at 73 N."""
    q = np.radians([90, -45, -135, 90, -45, -45, 180])
    at, inside = (
        bs.evaluate(scenario("sia5d", pose, np.array([0, 0, -0.1]), motion={"task": "position", "start": "rest"}))
        for pose in (q, q - 1e-6 * np.eye(7)[6])
    )
    assert at.curve.end == inside.curve.end == "all_detected"
    assert at.peak_force.mean == pytest.approx(inside.peak_force.mean, rel=1e-5)
    assert at.verdict.conclusion == inside.verdict.conclusion == "not_acceptable"


@pytest.mark.parametrize("robot", ["sia5d", "iiwa14", "panda", "ur10e"])
def test_round_poses_on_limits_end_as_those_within(robot: str) -> None:
    """Multiples of 15 to 90 degrees, one joint or two on a limit: single, batch and 1e-12 rad inside agree."""
    arm, rng = bs.Robot.load(robot), np.random.default_rng(3)
    low, high = np.maximum(arm.lower, -6.3), np.minimum(arm.upper, 6.3)
    gives = ({}, {"arm": {"model": "elastic"}}, {"contact": {"kind": "free"}})
    compared = 0
    for case in range(60):
        unit = math.radians(rng.choice([15, 30, 45, 90]))
        q = np.clip(np.round(rng.uniform(low, high) / unit) * unit, low, high)
        joints = [arm.dof - 1] if rng.random() < 0.4 else rng.choice(arm.dof, rng.integers(1, 3), replace=False)
        ends = rng.integers(2, size=arm.dof)
        within = q.copy()
        for j in joints:
            q[j] = (arm.lower if ends[j] else arm.upper)[j]
            within[j] = q[j] + (1e-12 if ends[j] else -1e-12)
        velocity = 0.1 * rng.choice([-1, 1]) * np.eye(3)[rng.integers(3)]
        motion = {"task": str(rng.choice(["pose", "position"])), "start": str(rng.choice(["moving", "rest"]))}
        given, other = (scenario(robot, pose, velocity, motion=motion, **gives[case % 3]) for pose in (q, within))
        try:
            single, inside = bs.evaluate(given), bs.evaluate(other)
            batch = bs.evaluate_batch(given, q[None], velocity[None])
        except bs.InputError:  # a singular start
            continue
        compared += 1
        assert single.curve.end == inside.curve.end == batch.end[0]
        assert single.peak_force.quantile(0.999) == pytest.approx(inside.peak_force.quantile(0.999), rel=5e-3, abs=0.02)
        assert batch.quantile[0, 3] == pytest.approx(single.peak_force.quantile(0.999), rel=2e-3, abs=1e-6)
    assert compared > 20


@pytest.mark.parametrize("start", ["moving", "rest"])
def test_a_joint_that_leaves_its_range_ends_the_line_at_once(start: str) -> None:
    """Joint 2 on its limit of 110 degrees: the way out ends at the start, the way in does not."""
    q = np.radians([0, 110, 0, -20, 0, -40, 0])
    out, back = (
        bs.evaluate(scenario("sia5d", q, np.array([0, 0, speed]), motion={"start": start, "held_joints": [7]}))
        for speed in (-0.25, 0.25)
    )
    assert out.curve.end == "joint_limit"
    assert len(out.curve.distance) == 1
    assert out.curve.end_joint == 2
    assert any("joint 2 reaches its limit, after 0 s" in note for note in out.notes)
    assert back.curve.end != "joint_limit"


def test_poses_beyond_a_limit_by_rounding_are_taken() -> None:
    q = np.nextafter(np.radians([0, -90, 90, -90, -90, 360]), np.inf)
    given = scenario("ur10e", q, np.array([0, 0, -0.1]))
    batch = bs.evaluate_batch(given, q[None], np.array([[0, 0, -0.1]]))
    assert batch.mean[0] == pytest.approx(bs.evaluate(given).peak_force.mean, rel=1e-4)
    with pytest.raises(bs.InputError, match=r"joint 6 at 6\.28319 is outside its limits"):
        bs.evaluate_batch(given, q[None] + 1e-8, np.array([[0, 0, -0.1]]))
