"""Reactions of the plant: they begin where the arm is, whatever the motion, and go on without a jump."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bumpstop.collision.trajectory.trajectory import Trajectory
from bumpstop.model import Robot
from bumpstop.plant import Command, Experiment, PlantReaction, along, line, press

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
    for knot in (0, 1, 2, 3, 250, count // 2, count - 200, count - 3, count - 2, count - 1):
        turned, whole = command.reaction(knot, answer), command
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
        for knot in (back, len(depth) - 1):
            turned = command.reaction(knot, reaction(kind))
            assert (-tip(turned)[:, 2] <= -tip(command)[knot, 2] + 1e-9).all()
    # What already goes back goes on as it was.
    np.testing.assert_allclose(command.reaction(back, reaction("reverse")).q[:200], command.q[back:][:200], atol=1e-12)
    # A second reaction begins where the first one is.
    stopped = command.reaction(deepest - 200, reaction("stop"))
    np.testing.assert_array_equal(stopped.reaction(20, reaction("reverse")).q[0], stopped.q[20])
