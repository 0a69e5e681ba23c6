"""Collisions that nobody detects: judged by their force where the arm comes to rest, as over every limit elsewhere."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.trajectory.trajectory_result import TrajectoryCollisionResult
from collision.cases import control_group, reference_settings
from collision.trajectory_cases import gantry, scenario, trajectory_motion, write_csv
from reference import trace

# Joint 2 has 0.3 degrees left: the line ends after 1.6 mm.
AT_A_LIMIT: dict[str, Any] = {
    "pose_deg": [0, 109.7, 0, -20, 0, -40, 0],
    "motion__velocity_mm_s": [0, 0, -30],
    "detector__thresholds_Nm": [60.0] * 7,
}
FORCES = (1.0, 20.0, 60.0, 90.0, 110.0, 200.0)


def at_a_limit(**changes: Any) -> bs.Scenario:
    return control_group(**AT_A_LIMIT | changes)


def eased(folder: Path, until: float = 1.0, **changes: Any) -> bs.Scenario:
    """A slide that goes 0.1 m down and comes to rest after a second, or is cut off before."""
    gantry(folder)
    t = np.linspace(0, until, 60)
    way = 0.1 * (3 * t**2 - 2 * t**3)
    write_csv(folder / "path.csv", t, way[:, None] * [0, 0, -1.0])
    body = {"body": "thigh_knee", "area_cm2": 2.0, "stiffness_N_m": 20000}
    return scenario(folder, trajectory_motion(), contact=body, detector__thresholds_Nm=[2000.0] * 3, **changes)


def test_a_line_that_comes_to_rest_is_judged_by_its_force() -> None:
    result = bs.evaluate(at_a_limit(contact__body="thigh_knee", contact__stiffness_N_m=75000, contact__area_cm2=5.0))
    assert result.curve.end == "joint_limit"
    assert result.undetected_probability > 0.2
    # The arm brakes at the limit, and gets farther than the line.
    farthest = max(result.curve.distance.max(), result.curve.line.braking.max())
    assert farthest > result.curve.distance.max()
    hardest = result.problem.stiffness * farthest
    assert result.peak_force.exceedance(0.99 * hardest) > 1e-3
    assert result.peak_force.exceedance(1.001 * hardest) < 1e-12
    assert result.verdict.p_over_force == pytest.approx(0, abs=1e-12)
    assert "not detected" not in result.verdict.reason
    assert result.unbounded_because is None
    # All but what touches nothing.
    offset_sd = result.problem.offset_size
    for force in FORCES:
        nearer = farthest - force / result.problem.stiffness
        expected = math.erf(nearer / offset_sd / math.sqrt(2)) if nearer > 0 else 0.0
        assert result.peak_force.exceedance(force) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("thresholds", [60.0, 20.0, 10.0])
@pytest.mark.parametrize("offset_law", ["half_normal", "uniform"])
def test_exact_sampled_and_batch_agree(thresholds: float, offset_law: str) -> None:
    changes = {"detector__thresholds_Nm": [thresholds] * 7, "contact__offset_law": offset_law}
    if offset_law == "uniform":
        changes["detector__feedback_period_s"] = 0.04
    case = at_a_limit(**changes)
    exact, drawn = bs.evaluate(case), bs.evaluate(case, samples=40_000, seed=3)
    problem = exact.problem
    batch = bs.evaluate_batch(
        case, problem.q[None], problem.velocity[None], limits_N=FORCES, probabilities=[0.9, 0.999]
    )
    assert exact.undetected_probability > 1e-3
    for i, force in enumerate(FORCES):
        p = exact.peak_force.exceedance(force)
        assert batch.exceedance[0, i] == pytest.approx(p, abs=2e-6), force
        assert drawn.peak_force.exceedance(force) == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / 40_000) + 1e-12)
    for i, p in enumerate((0.9, 0.999)):
        assert batch.quantile[0, i] == pytest.approx(exact.peak_force.quantile(p), rel=1e-4)
    assert drawn.peak_force.mean == pytest.approx(exact.peak_force.mean, abs=4 * exact.peak_force.sd / 200)
    assert batch.mean[0] == pytest.approx(exact.peak_force.mean, rel=1e-5)


def test_far_tails_of_what_comes_to_rest_join_the_near_ones() -> None:
    result = bs.evaluate(at_a_limit(detector__thresholds_Nm=[6.0] * 7, detector__noise_sd_Nm=0.4))
    question = result.problem.detector, result.problem.contact
    for force in (10.0, 40.0, 80.0):
        near = float(result.integral.tail("peak_force", np.array([force]))[0, 0])
        assert result.curve.line.tail_without_interpolation(*question, force) == pytest.approx(near, rel=1e-7)


def test_no_milder_than_a_simulator_that_follows_the_line() -> None:
    case = at_a_limit(contact__offset_law="fixed", contact__offset_mm=0.4)
    result = bs.evaluate(case)
    after = float(result.end_notes()[0].split("after ")[1].split(" s")[0])
    followed = trace(reference_settings(case, duration_s=after), result.problem.offset_size)
    assert result.undetected_probability == pytest.approx(1, abs=1e-9)
    assert result.peak_force.quantile(0.5) >= followed.force_N.max() - 1e-9 * result.problem.stiffness


def test_the_end_of_a_motion_leaves_no_bound_and_names_its_key() -> None:
    result = bs.evaluate(control_group(detector__thresholds_Nm=[6000.0] * 7, motion__duration_s=2.0))
    assert result.curve.end == "motion_end"
    assert result.verdict.p_over_force == pytest.approx(result.undetected_probability)
    assert result.verdict.acceptable is False
    assert "are not detected within 2 s (motion.duration_s) and count as over every limit" in result.verdict.reason
    assert "peak force exceeds" not in result.verdict.reason, "nobody knows that force"
    assert math.isinf(result.peak_force.quantile(0.999))


def test_what_lasts_judges_an_arm_that_stands_in_two_phases() -> None:
    limits = {"contact__limits": "ts15066", "contact__body": "hand_finger", "contact__area_cm2": 5.0}
    case = at_a_limit(**limits, verdict__clamped_limit="two_phase")
    exact, drawn = bs.evaluate(case), bs.evaluate(case, samples=20_000)
    assert exact.problem.limits is not None
    lasting = exact.problem.limits.force_N
    assert exact.verdict.p_over_force == pytest.approx(exact.undetected_over(lasting), abs=1e-9)
    assert exact.verdict.p_over_force == pytest.approx(drawn.verdict.p_over_force, abs=0.02)
    assert exact.verdict.p_over_force < exact.undetected_probability


def test_a_trajectory_that_comes_to_rest(tmp_path: Path) -> None:
    case = eased(tmp_path)
    result = bs.evaluate(case)
    assert isinstance(result, TrajectoryCollisionResult)
    assert result.undetected_probability > 0.95
    # Contact begins at any time: over 220 N where more than 11 mm are left.
    t = np.linspace(0, 1, 100_001)
    left = 0.1 * (1 - (3 * t**2 - 2 * t**3))
    for force in (100.0, 220.0, 1500.0):
        assert result.peak_force.exceedance(force) == pytest.approx((20000 * left > force).mean(), abs=2e-3)
    drawn = bs.evaluate(case, samples=20_000)
    assert drawn.peak_force.exceedance(1500.0) == pytest.approx(result.peak_force.exceedance(1500.0), abs=0.014)
    assert "not detected" not in result.verdict.reason
    late = bs.evaluate(case.with_values({"motion.contact_onset_s": 0.96}))
    assert late.verdict.acceptable is True
    assert late.peak_force.quantile(0.999) == pytest.approx(20000 * float(left[96_000]), rel=1e-3)


def test_a_trajectory_that_is_cut_off_has_no_bound(tmp_path: Path) -> None:
    result = bs.evaluate(eased(tmp_path, until=0.8).with_values({"motion.contact_onset_s": 0.79}))
    assert result.verdict.acceptable is False
    assert "(motion.file) ends while the arm still moves" in result.verdict.reason
    assert math.isinf(result.peak_force.quantile(0.5))


def test_a_motion_too_short_for_contact_is_no_safe_one() -> None:
    case = control_group(contact__offset_law="fixed", contact__offset_mm=30.0, motion__duration_s=0.1)
    short, long = bs.evaluate(case), bs.evaluate(case.with_values({"motion.duration_s": 5.0}))
    assert short.verdict.conclusion == "inconclusive"
    assert short.verdict.acceptable is None
    assert "nothing is hit" in short.verdict.reason
    assert "0.1 s (motion.duration_s)" in short.verdict.reason
    assert long.verdict.conclusion in ("acceptable", "not_acceptable")


def test_a_body_in_the_way_of_a_line_that_comes_to_rest_may_be_acceptable() -> None:
    case = at_a_limit(contact__offset_law="fixed", contact__offset_mm=0.7, contact__area_cm2=5.0)
    result = bs.evaluate(case)
    assert result.undetected_probability == pytest.approx(1, abs=1e-9)
    assert result.verdict.acceptable is True
    assert any("are not detected before the motion ends" in note for note in result.notes)


def test_what_fails_is_not_acceptable_however_rare_contact_is() -> None:
    """Most cases touch nothing, and some of the others are over: that is a verdict."""
    result = bs.evaluate(at_a_limit(contact__area_cm2=1.0))
    assert result.no_contact_probability > 0.5
    assert result.verdict.conclusion == "not_acceptable"
