"""What others measured: that it is typed as it was told, and that the page can tell a miss."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from validation.collision import measured_forces
from validation.findings import Findings

from bumpstop.model import Robot
from reference.elastic_arm import Body
from validation import facts


def test_figures_are_typed_as_they_were_told() -> None:
    typed = measured_forces.facts()["ur10e"]
    assert typed["speed_m_s_and_peak_N"] == [[0.16, 140], [0.36, 280]]
    assert (typed["distance_from_base_m"], typed["height_m"]) == (0.8, 0.4)
    if not (facts.folder() / "facts" / "measured_forces.toml").is_file():
        pytest.skip("measured_forces.toml is absent: set BUMPSTOP_SHARED")
    (row,) = facts.load("measured_forces")["force"]
    assert typed["speed_m_s_and_peak_N"] == row["rows"]
    assert typed["distance_from_base_m"] == row["distance_from_base_m"]
    assert typed["height_m"] == row["height_m"]
    assert typed["robot"] == row["robot"]


def test_the_tool_points_down_where_it_is_asked_to_be() -> None:
    robot = Robot.load("ur10e")
    at = robot.pose(measured_forces.tool_down(robot, 0.8, 0.4))
    assert np.hypot(at[0, 3], at[1, 3]) == pytest.approx(0.8, abs=1e-6)
    assert at[2, 3] == pytest.approx(0.4, abs=1e-6)
    assert at[2, 2] == pytest.approx(-1, abs=1e-6)
    with pytest.raises(ValueError, match="does not reach"):
        measured_forces.tool_down(robot, 2.0, 0.4)


def test_a_rigid_drive_train_follows_its_path_into_the_body() -> None:
    """Gears and servo of no give: the force is the spring's over reaction and stop."""
    robot = Robot.load("ur10e")
    q = measured_forces.tool_down(robot, 0.8, 0.4)
    stiff = measured_forces.Assumed(
        rotor_inertia=1e4, gear_stiffness=20.0, servo_bandwidth=1.0, reaction=0.03, deceleration=8.0
    )
    found = measured_forces.blow(robot, q, measured_forces.DOWN, 0.2, Body(stiffness=1e4), stiff)
    rates = np.abs(np.linalg.pinv(robot.jacobian(q)) @ [*measured_forces.DOWN, 0, 0, 0]).max()
    path = 0.2 * 0.03 + 0.2**2 / (2 * 8.0 / rates)
    assert found.peak_force == pytest.approx(1e4 * path, rel=0.03)


def test_a_measured_force_outside_the_band_is_told() -> None:
    told = measured_forces.facts()["ur10e"]
    told["speed_m_s_and_peak_N"] = [[0.16, 600]]
    findings = Findings("x", "x")
    measured_forces._rows(findings, told, draws=5)
    assert [check.passed for check in findings.checks] == [False, False]
