"""Scenarios to start from: of every built-in robot, inside its limits, and with every placeholder marked."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.register.starting_scenario import DEFAULT_ROBOT, starting_scenario
from cli.support import run


@pytest.mark.parametrize("name", bs.robots())
def test_every_robot_starts_with_a_scenario_that_runs(name: str) -> None:
    text = starting_scenario(name)
    scenario = bs.Scenario.from_dict(tomllib.loads(text))
    result = bs.evaluate(scenario)
    robot, problem = bs.Robot.load(name), result.problem
    assert 0 < result.peak_force.quantile(0.5) < 1000
    assert result.verdict.false_alarm_ok
    assert len(result.warnings) == 1
    assert result.warnings[0].startswith(f"{', '.join(scenario.assumed)} ")
    assert result.curve.end not in ("joint_limit", "singularity")
    assert np.all(problem.q > robot.lower)
    assert np.all(problem.q < robot.upper)
    # The tip is above the base's plane, in reach of a table, and moves down.
    assert 0.1 < robot.pose(problem.q)[2, 3] < 1.0
    assert result.curve.normal[2] == pytest.approx(-1)
    for key in ("pose_deg", "velocity_mm_s", "area_cm2", "body ="):
        (line,) = [line for line in text.splitlines() if line.startswith(key)]
        assert "# REPLACE" in line
    for key in ("thresholds_Nm", "noise_sd_Nm", "joint_acceleration_rad_s2", "latency_s"):
        before = text[: re.search(rf"^{key}", text, re.MULTILINE).start()].splitlines()[-3:]  # type: ignore[union-attr]
        assert any(line.startswith("# REPLACE") for line in before)
        assert any("placeholder" in line or "Schroeder (2013)" in line for line in before), (key, before)
        made_up = any("placeholder" in line for line in before)
        assert made_up is any(one.endswith(key) for one in scenario.assumed), key


def test_thresholds_are_the_share_of_the_torque_limits_that_they_say() -> None:
    limits = bs.Robot.load("ur5e").drive_train.torque_limit
    thresholds = tomllib.loads(starting_scenario("ur5e"))["detector"]["thresholds_Nm"]
    np.testing.assert_allclose(thresholds, limits / 8, rtol=0.02)


def test_command(tmp_path: Path) -> None:
    path = tmp_path / "cell.toml"
    assert run("new", "-o", path) == (0, f"scenario: {path}\n", "")
    assert path.read_text(encoding="utf-8") == starting_scenario(DEFAULT_ROBOT) == run("new").out
    assert run("evaluate", path).status == 3
    path.write_text("mine", encoding="utf-8")
    refused = run("new", "sia5d", "-o", path)
    assert (refused.status, path.read_text(encoding="utf-8")) == (2, "mine")
    assert "exists; give another file, or --force" in refused.err
    assert run("new", "sia5d", "-o", path, "--force").status == 0
    assert path.read_text(encoding="utf-8") == starting_scenario("sia5d")


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("ur10x",), "ROBOT: 'ur10x' is unknown; did you mean 'ur10' or 'ur10e'?"),
        (("arm.urdf",), "ROBOT: 'arm.urdf' is a path; wanted a built-in robot"),
        (("ur5e", "-o", "absent/cell.toml"), "--out: 'absent/cell.toml' cannot be written (No such file or directory)"),
        (("ur5e", "-o", "."), "--out: '.' cannot be written (Is a directory)"),
    ],
)
def test_bad_input(arguments: tuple[str, ...], problem: str) -> None:
    refused = run("new", *arguments)
    assert (refused.status, refused.out) == (2, "")
    assert refused.err.startswith(f"error: {problem}")
