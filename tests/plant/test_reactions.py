"""Reactions of the plant: they begin where the arm is, whatever the motion, and go on without a jump."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bumpstop.collision.trajectory.trajectory import Trajectory
from bumpstop.model import Robot
from bumpstop.plant import Command, Experiment, Plant, PlantReaction, along, line, press

TM5_700 = Path(__file__).resolve().parents[2] / "examples" / "stopping" / "tm5_700.toml"
POSE = np.radians([0, -70, 100, -120, -90, 0])
DOWN = [0.0, 0.0, -0.1]
LIMIT = 6.0  # of the joints' accelerations [rad/s2]
LAWS: dict[str, dict[str, Any]] = {
    "constant": {},
    "constant time": {"deceleration": "constant_time", "stopping_time_s": 0.12},
    "ramp": {"deceleration": "ramp", "ramp_time_s": 0.05},
    "table": {"deceleration": "table", "stopping_table": str(TM5_700), "payload_percent": 100},
}


def reaction(kind: str, **law: Any) -> PlantReaction:
    data = {"kind": kind, "force_N": 20.0, "joint_acceleration_rad_s2": LIMIT, **law}
    motion = {"kind": "workspace_1"}
    return Experiment.from_dict({"robot": "ur5e", "motion": motion, "reaction": data}).reaction_of(Robot.load("ur5e"))


@cache
def motion(name: str) -> Command:
    robot = Robot.load("ur5e")
    if name == "press":
        return press(robot, POSE, DOWN, way=0.03, joint_acceleration=LIMIT)
    if name == "trajectory":
        t = np.linspace(0, 1.2, 61)
        bump = (1 - np.cos(2 * np.pi * t / 1.2)) / 2
        return along(Trajectory(t, POSE + bump[:, None] * np.array([0.2, 0.1, -0.1, 0.15, 0.1, 0.2])), robot, hold=0.1)
    return line(robot, POSE, DOWN, duration=0.4, joint_acceleration=LIMIT, hold=0.1 if name == "line and hold" else 0.0)


def tip(command: Command) -> Any:
    return Robot.load("ur5e").pose(command.q)[:, :3, 3]


@pytest.mark.parametrize("name", ["line", "line and hold", "press", "trajectory"])
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", ["stop", "reverse"])
def test_a_reaction_goes_on_from_where_the_arm_is(name: str, law: str, kind: str) -> None:
    command, answer = motion(name), reaction(kind, **LAWS[law])
    count = len(command.q)
    own = np.abs(np.diff(command.qd, axis=0)).max() / 1e-3
    for knot in (0, 1, 2, 3, 250, count // 2, count - 200, count - 3, count - 2, count - 1, count, count + 40):
        turned, whole = command.reaction(knot, answer), command.until(knot)
        np.testing.assert_array_equal(turned.q[0], whole.q[knot])
        np.testing.assert_array_equal(turned.qd[0], whole.qd[knot])
        change = np.abs(np.diff(turned.qd, axis=0)).max() / 1e-3
        assert change < 1.15 * (LIMIT + own), (knot, change)
        mean = (turned.qd[1:] + turned.qd[:-1]) / 2
        # The rate of sub-steps leads the place, and the last change ends within a millisecond: up to a fifth of it.
        assert np.abs(np.diff(turned.q, axis=0) / 1e-3 - mean).max() < 0.25e-3 * (LIMIT + own), knot
        if kind == "stop":
            assert np.abs(turned.qd[-200:]).max() == 0


def test_a_press_that_reacts_on_its_way_back_goes_no_farther_in() -> None:
    command = motion("press")
    depth = -tip(command)[:, 2]
    deepest = int(depth.argmax())
    back = deepest + 100
    for kind in ("stop", "reverse"):
        for knot in (back, len(depth) - 1, len(depth) + 300):
            turned = command.reaction(knot, reaction(kind))
            assert (-tip(turned)[:, 2] <= -tip(command.until(knot))[knot, 2] + 1e-9).all()
    # What already goes back goes on as it was.
    np.testing.assert_allclose(command.reaction(back, reaction("reverse")).q[:200], command.q[back:][:200], atol=1e-12)
    # A second reaction begins where the first one is.
    stopped = command.reaction(deepest - 200, reaction("stop"))
    np.testing.assert_array_equal(stopped.reaction(20, reaction("reverse")).q[0], stopped.q[20])


def test_a_motion_beyond_its_end() -> None:
    short, longer = (line(Robot.load("ur5e"), POSE, DOWN, duration=s, joint_acceleration=LIMIT) for s in (0.4, 0.6))
    np.testing.assert_allclose(short.until(600).q, longer.q, atol=1e-8)
    np.testing.assert_allclose(short.until(600).qd, longer.qd, atol=1e-6)
    np.testing.assert_array_equal(short.until(400).q, short.q)
    held = motion("trajectory")
    np.testing.assert_array_equal(held.until(1500).q[1300:], np.tile(held.q[-1], (201, 1)))
    assert not held.until(1500).qd[1301:].any()
    # A press goes on back.
    pressed = motion("press")
    way = np.diff(tip(pressed.until(len(pressed.q) + 50))[:, 2])
    np.testing.assert_allclose(way[-60:], -DOWN[2] * 1e-3, rtol=1e-3)


@pytest.mark.parametrize("way", [None, 0.03, 0.05135, 0.05275])
def test_a_motion_is_told_as_far_as_is_asked(way: float | None) -> None:
    """Of presses that last half milliseconds more, too, and step by step as at once."""
    robot = Robot.load("ur10e")
    command = line(robot, POSE, DOWN, duration=0.5) if way is None else press(robot, POSE, DOWN, way=way)
    end = len(command.q) - 1
    for more in (1, 2, 3):
        longer, later = command.until(end + more), command.until(end + 1).until(end + more)
        assert len(longer.q) == len(longer.qd) == end + more + 1
        np.testing.assert_allclose(later.q, longer.q, atol=1e-12)
        np.testing.assert_allclose(later.qd, longer.qd, atol=1e-12)


def test_a_line_that_a_joint_ends_brakes_beyond_its_end() -> None:
    arm = Robot.load("sia5d")
    cut = line(arm, np.radians([0, 109.7, 0, -20, 0, -40, 0]), [0, 0, -0.03], duration=2.0, joint_acceleration=LIMIT)
    assert "joint_limit" in cut.notes[0]
    last = len(cut.q) - 1
    beyond = cut.until(last + 100)
    assert len(beyond.q) == last + 101
    assert np.abs(np.diff(beyond.qd[last:], axis=0)).max() < 1.01e-3 * LIMIT
    assert not beyond.qd[-1].any()


def test_a_latency_that_outlasts_a_line_is_waited_for() -> None:
    """While it lasts the line goes on: the arm is as if it had been longer from the outset."""
    found = []
    for seconds in (0.35, 0.6):
        data = {
            "robot": "sia5d",
            "pose_deg": [0, 30, 0, -20, 0, -40, 0],
            "motion": {"kind": "line", "velocity_mm_s": [0, 0, -50], "duration_s": seconds, "held_joints": [7]},
            "object": [{"kind": "hand_finger", "ahead_mm": 14}],
            "reaction": {"kind": "stop", "force_N": 20, "latency_s": 0.1},
        }
        found.append(Experiment.from_dict(data).run())
    short, longer = found
    assert short.reaction_time is not None
    assert short.reaction_time > 0.35
    assert short.reaction_time == longer.reaction_time
    assert short.peak_force == pytest.approx(longer.peak_force, rel=1e-4)
    np.testing.assert_allclose(short.recording.q, longer.recording.q, atol=1e-8)


def test_the_longest_latency_fits_into_the_record() -> None:
    robot = Robot.load("ur5e")
    slow = line(robot, POSE, [0.0, 0.0, -0.001], duration=0.1)
    run = Plant(robot).run(slow, on_sample=lambda s: PlantReaction(kind="stop", latency_s=10.0))
    assert run.reaction_time == pytest.approx(10.001)
    assert run.trace.t[-1] == pytest.approx(10.25, abs=0.005)
    assert run.recording.t[-1] == pytest.approx(run.trace.t[-1], abs=0.005)


def test_what_a_stopping_table_assumes_is_noted_where_the_arm_reacts() -> None:
    robot = Robot.load("ur5e")
    answer = reaction("stop", **LAWS["table"])
    notes = []
    for reacts in (True, False):
        run = Plant(robot).run(
            line(robot, POSE, DOWN, duration=0.05), on_sample=lambda s, reacts=reacts: answer if reacts else None
        )
        notes.append(" ".join(run.notes))
    assert "Joint 4, 5, 6 is not in the stopping table" in notes[0]
    assert "stopping table" not in notes[1]
