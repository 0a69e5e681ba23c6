"""Reactions of many simulation steps, and what else grows with them: slow arms in small steps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from collision.cases import SIA5D_POSE, control_group
from collision.trajectory_cases import gantry, scenario, trajectory_motion, write_csv

SPEED, ACCELERATION, STEP = 0.05, 0.1, 1e-5
SLOW = {
    "simulation": {"step_s": STEP, "substeps": 1},
    "reaction__joint_acceleration_rad_s2": ACCELERATION,
}
# Rates fall by equal parts and positions follow the new ones.
OVERRUN = SPEED**2 / (2 * ACCELERATION) - SPEED * STEP / 2


def line(folder: Path, **changes: Any) -> bs.Scenario:
    """A gantry that takes 50 000 steps to stand still."""
    gantry(folder)
    motion = {"velocity_mm_s": [0, 0, -1e3 * SPEED], "task": "position", "duration_s": 0.3}
    return scenario(folder, motion, pose_rad=[0, 0, 0], detector__feedback_period_s=0.02, **SLOW | changes)


@pytest.mark.parametrize("kind", ["stop", "reverse"])
def test_a_slow_arm_is_followed_until_it_stands(kind: str, tmp_path: Path) -> None:
    curve = bs.stopping_curve(bs.CollisionProblem.from_scenario(line(tmp_path, reaction__kind=kind)), whole=True)
    np.testing.assert_allclose(curve.max_distance - curve.tick_distance, OVERRUN, rtol=1e-6)


def test_so_is_one_on_a_trajectory(tmp_path: Path) -> None:
    gantry(tmp_path)
    t = np.array([0.0, 0.5])
    q = np.zeros((2, 3))
    q[:, 2] = -SPEED * t
    write_csv(tmp_path / "path.csv", t, q, np.tile([0, 0, -SPEED], (2, 1)))
    motion = trajectory_motion(contact_onset_s=0.0)
    result = bs.evaluate(scenario(tmp_path, motion, detector__feedback_period_s=0.05, **SLOW))
    stops = result.curve.tick_distance + OVERRUN < SPEED * t[-1]
    assert stops.any()
    np.testing.assert_allclose((result.curve.max_distance - result.curve.tick_distance)[stops], OVERRUN, rtol=1e-6)


@pytest.mark.parametrize(
    "contact", [{"kind": "clamped"}, {"kind": "free", "body_mass_kg": 100.0}], ids=lambda contact: contact["kind"]
)
def test_a_small_step_changes_no_long_contact(contact: dict[str, Any], tmp_path: Path) -> None:
    """The arm reverses for a second; ticks fall a fifth of a millisecond apart from step to step, no more."""
    laws = []
    for step in (STEP, 20 * STEP):
        changes = {"simulation": {"step_s": step, "substeps": 1}, "detector__thresholds_Nm": [2.0] * 3}
        body = {"stiffness_N_m": 1000.0, "offset_law": "fixed", "offset_mm": 1.0}
        changes |= {"detector__noise_sd_Nm": 0.1, "contact": body | contact}
        laws.append(bs.evaluate(line(tmp_path, reaction__kind="reverse", **changes)))
    fine, coarse = laws
    assert fine.peak_force.mean == pytest.approx(coarse.peak_force.mean, rel=5e-3)
    assert fine.contact_duration is not None
    assert coarse.contact_duration is not None
    assert coarse.contact_duration.mean > 0.5
    assert fine.contact_duration.mean == pytest.approx(coarse.contact_duration.mean, rel=5e-3)


def test_a_detector_armed_long_after_the_motion_never_alarms() -> None:
    late = control_group(
        simulation__step_s=1e-5,
        simulation__substeps=1,
        motion__duration_s=0.01,
        detector__feedback_period_s=1e-5,
        detector__arming_delay_s=1e5,
    )
    result = bs.evaluate(late)
    assert result.false_alarm_probability == 0
    assert result.undetected_probability + result.no_contact_probability == pytest.approx(1)


def test_noise_far_narrower_than_a_tick_of_travel_is_left_to_the_exact_law() -> None:
    narrow = control_group(
        contact__stiffness_N_m=1e9,
        detector__thresholds_Nm=[1e-6] * 7,
        detector__noise_sd_Nm=1e-9,
    )
    batch = bs.evaluate_batch(narrow, np.radians([SIA5D_POSE]), np.array([[0, 0, -0.05]]))
    assert batch.mean[0] == pytest.approx(bs.evaluate(narrow).peak_force.mean, rel=1e-7)
