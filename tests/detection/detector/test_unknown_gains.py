"""Joints of unknown gain: their residual is no torque in Nm, so no force may count their thresholds."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bumpstop.detection import Detector, undetectable_forces
from bumpstop.detection.loop.unknown_gains import force_thresholds
from bumpstop.detection.standing import hidden_torques
from bumpstop.joint import JointTorqueModel
from bumpstop.model import Robot
from cli.support import run, strict_json
from detection.detector.test_detector import gainless
from detection.detector.test_fitted_dynamics import planted
from detection.moving_arms import UR5E

SHARED = Path(os.environ.get("BUMPSTOP_SHARED", Path(__file__).resolve().parents[4] / "shared"))
CELL = Path(__file__).resolve().parents[3] / "examples/05_ur10e.toml"
LIMITS = np.array([20.0, 10, 20, 6, 6, 6])


def test_forces_count_no_threshold_of_a_joint_of_unknown_gain() -> None:
    model = replace(planted(3, essential=True, gains=True), unscaled=(1, 4))
    counted, notes = force_thresholds(UR5E, model, LIMITS)
    assert counted.tolist() == [20, math.inf, 20, 6, math.inf, 6]
    (note,) = notes
    assert note.startswith("shoulder_lift_joint, wrist_2_joint: of unknown gain")
    assert "forces do not count them" in note
    for known in (None, replace(model, unscaled=())):
        same, none = force_thresholds(UR5E, known, LIMITS)
        np.testing.assert_array_equal(same, LIMITS)
        assert none == ()
    detector = Detector(UR5E, model, LIMITS)
    assert detector.notes.count(note) == 1
    np.testing.assert_array_equal(detector.smallest_torque(), counted)
    assert np.flatnonzero(np.isinf(detector.smallest_torque(resting=True))).tolist() == [1, 4]
    # What friction holds of them has no unit either.
    assert np.flatnonzero(np.isnan(hidden_torques(UR5E, model))).tolist() == [1, 4]
    assert np.flatnonzero(np.isinf(detector.noise_sd)).tolist() == [1, 4]


def test_sensitivity_counts_no_threshold_of_a_joint_of_unknown_gain(tmp_path: Path) -> None:
    file, pose = tmp_path / "gainless.toml", [0, 30, 0, -20, 0, -40, 0]
    gainless(JointTorqueModel.load("sia5d"), 3).save(file)
    given = ("sensitivity", "sia5d", "--pose-deg", ",".join(map(str, pose)), "--model", file, "--thresholds")
    found = strict_json(run(*given, "20,10,20,20,20,20,20", "--json").out)
    wanted = strict_json(run(*given, "20,10,20,inf,20,20,inf", "--json").out)
    assert found == wanted
    assert [joint["threshold_Nm"] for joint in found["joints"]] == [20, 10, 20, None, 20, 20, None]
    largest = undetectable_forces(Robot.load("sia5d"), np.radians(pose), [20, 10, 20, np.inf, 20, 20, np.inf])
    assert found["largest_detectable_force_N"] == pytest.approx(float(largest.largest_detectable))
    assert sum("joint_u, joint_t: of unknown gain" in note for note in found["notes"]) == 1


def test_an_arm_of_which_three_gains_are_unknown_feels_no_force_across(tmp_path: Path) -> None:
    """Gains of joints 1, 5 and 6 show in no motion of the first part of this recording."""
    log = SHARED / "data/ur3e_rtde/fig9.xlsx"
    if not log.exists():
        pytest.skip(f"{log} is absent: set BUMPSTOP_SHARED")
    model, limits = tmp_path / "arm.toml", tmp_path / "limits.toml"
    known = ("--known", "shoulder_lift_joint.B=10.88")
    run("identify", log, "--robot", "ur3e", "--model", "dynamics", "--until", 26, *known, "-o", model)
    tune = ("tune", log, "--model", model, "--until", 26, "--per-hour", 30, "--causal")
    tuned = strict_json(run(*tune, "--save", limits, "--scenario", CELL, "--json").out)
    # The thresholds are those of the detector; the forces are not.
    assert all(math.isfinite(value) for value in tuned["thresholds_Nm"])
    for point in tuned["operating_curve"]:
        assert point["scenarios"][str(CELL)]["anywhere"] is None
    assert sum("of unknown gain" in note for note in tuned["notes"]) == 1
    detect = ("detect", log, "--model", model, "--thresholds", limits, "--from", 26, "--undetectable-force", 2000)
    found = strict_json(run(*detect, "--json").out)
    assert [stretch["largest_N"] for stretch in found["undetectable_poses"]] == [None]
    assert sum("of unknown gain" in note for note in found["notes"]) == 1
    assert "unknown, " in next(note for note in found["notes"] if "At standstill" in note)
    across = ("sensitivity", "ur3e", "--pose-deg", "0,-60,90,0,90,0", "--thresholds", limits, "--direction", "0,1,0")
    data = strict_json(run(*across, "--model", model, "--json").out)
    assert data["force_along_N"] is None
    assert [joint["threshold_Nm"] is None for joint in data["joints"]] == [True, False, False, False, True, True]
    assert [value is None for value in data["standing"]["dead_zone_Nm"]] == [True, False, False, False, True, True]
