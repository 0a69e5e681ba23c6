"""The integrated distribution against the sampled distribution, where nothing but the method differs."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.distribution import contact_duration as contact_duration
from collision.cases import VARIED, control_group

RUNS = 200_000


@pytest.mark.parametrize("name", list(VARIED))
def test_within_four_standard_errors(name: str) -> None:
    compare(VARIED[name], RUNS, seed=11)


def compare(scenario: bs.Scenario, runs: int, seed: int) -> dict[str, float]:
    """Assert that both distributions agree; returns the differences in standard errors."""
    exact = bs.evaluate(scenario)
    drawn = bs.evaluate(scenario, samples=runs, seed=seed, threads=2)
    scores: dict[str, float] = {}

    def check_probability(what: str, p: float, share: float, n: float) -> None:
        if math.isnan(p) and math.isnan(share):
            return
        # One run more or less is always allowed: the normal approximation ends there.
        error = math.sqrt(max(p * (1 - p), 1 / n) / n)
        scores[what] = (share - p) / error
        assert abs(share - p) < 4 * error, (what, p, share)

    def check_moments(what: str, ours: bs.Distribution, theirs: bs.Distribution, n: float) -> None:
        if not n or not math.isfinite(theirs.mean):
            assert not math.isfinite(ours.mean) or n < 50
            return
        error = max(theirs.sd / math.sqrt(n), 1e-12)
        scores[what] = (theirs.mean - ours.mean) / error
        assert abs(theirs.mean - ours.mean) < 4 * error + 1e-9 * abs(ours.mean), what
        if n > 1000 and theirs.sd > 1e-9:
            values = getattr(theirs, "values")  # noqa: B009
            fourth = np.mean((values - theirs.mean) ** 4) / theirs.sd**4
            spread = theirs.sd * math.sqrt((fourth - 1) / n) / 2
            assert abs(theirs.sd - ours.sd) < 4 * spread + 1e-9 * ours.sd, what
            for p in (0.05, 0.5, 0.95, 0.99):
                x = ours.quantile(p)
                if math.isfinite(x):
                    # The share of runs above our quantile, but for atoms, which have probability of their own.
                    check_probability(
                        f"{what} above q{p}", ours.exceedance(x * (1 + 1e-9)), theirs.exceedance(x * (1 + 1e-9)), n
                    )

    detected = runs * (1 - drawn.undetected_probability - drawn.no_contact_probability)
    after_contact = runs * (
        1 - drawn.undetected_probability - drawn.no_contact_probability - drawn.false_alarm_probability
    )
    check_probability("false alarm", exact.false_alarm_probability, drawn.false_alarm_probability, runs)
    check_probability("undetected", exact.undetected_probability, drawn.undetected_probability, runs)
    check_probability("no contact", exact.no_contact_probability, drawn.no_contact_probability, runs)
    check_probability("several", exact.multi_joint_probability, drawn.multi_joint_probability, detected)
    for j, (p, share) in enumerate(
        zip(exact.trigger_joint_probability, drawn.trigger_joint_probability, strict=True), start=1
    ):
        check_probability(f"joint {j}", p, share, detected)
    check_moments("peak force", exact.peak_force, drawn.peak_force, runs)
    check_moments("force at detection", exact.force_at_detection, drawn.force_at_detection, after_contact)
    check_moments("delay", exact.detection_delay, drawn.detection_delay, after_contact)
    if exact.contact_duration is not None and drawn.contact_duration is not None:
        check_moments("contact time", exact.contact_duration, drawn.contact_duration, after_contact)
    return scores


def test_an_alarm_after_the_arm_fell_back_from_the_body_is_a_detection() -> None:
    """A damped arm is turned back by a singularity in contact: the body is behind it when the alarm comes."""
    scenario = bs.Scenario.from_dict(
        {
            "robot": "panda",
            "pose_deg": [-0.367, -31.104, 4.086, -124.472, 13.421, 97.816, 32.526],
            "motion": {
                "velocity_mm_s": [0, 0, -5.17],
                "task": "position",
                "held_joints": [1, 2, 4, 7],
                "damping": 0.001,
            },
            "contact": {"stiffness_N_m": 2000, "offset_law": "half_normal"},
            "detector": {
                "thresholds_Nm": [40, 20, 5, 2, 40, 20, 20],
                "noise_sd_Nm": [2, 3.6, 1.5, 0.36, 7.2, 1, 6],
                "feedback_period_s": 0.02,
            },
            "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 4.5},
            "simulation": {"step_s": 0.001, "substeps": 1},
        }
    )
    distance = bs.evaluate(scenario).curve.tick_distance
    assert distance.max() > distance[-1] + 3e-4
    compare(scenario, 20_000, seed=4)


def test_contact_times_far_beyond_the_line_have_cells_of_their_own() -> None:
    """An observer feels so little that there are 200 000 pieces; false alarms swing far beyond the end of the line."""
    scenario = bs.Scenario.from_dict(
        {
            "robot": "sia5d",
            "pose_rad": [-2.650139, -0.746427, -0.777856, 1.126974, 2.449786, 0.000132, -0.010996],
            "motion": {"velocity_mm_s": [20.49, 0, 0], "duration_s": 0.2},
            "contact": {
                "stiffness_N_m": 190_000,
                "offset_law": "half_normal",
                "offset_sd_s": 0.183,
                "link": "link_b",
                "point_m": [-0.05648, -0.13785, 0.08798],
                "normal": [1.7116, 0.5388, -1.0391],
            },
            "detector": {
                "thresholds_Nm": [88.8, 9.75, 53.5, 37.7, 13.7, 5.76, 2.34],
                "noise_sd_Nm": [35.3, 0.857, 9.48, 3.64, 1.3, 0.862, 0.316],
                "feedback_period_s": 0.002,
                "residual": "observer",
                "observer_gain_1_s": 6.88,
            },
            "reaction": {"kind": "reverse", "joint_acceleration_rad_s2": 0.415, "latency_s": 0.007},
            "simulation": {"step_s": 0.001, "substeps": 2},
        }
    )
    compare(scenario, 40_000, seed=5)


def test_a_line_that_ends_before_the_first_tick_has_both_laws() -> None:
    scenario = control_group(
        pose_deg=[0, 109.9999999, 0, -20, 0, -40, 0], motion__velocity_mm_s=[0, 0, -50], motion__held_joints=[7],
        contact__offset_law="fixed", contact__offset_mm=1.0,
    )  # fmt: skip
    exact, drawn = bs.evaluate(scenario), bs.evaluate(scenario, samples=100, seed=1)
    assert exact.curve.ticks == 0
    assert exact.curve.end == "joint_limit"
    assert exact.no_contact_probability == drawn.no_contact_probability == 1
    # The arm brakes into the body: a joint does not stop from full speed in no time.
    pressed = exact.problem.stiffness * (exact.curve.line.braking[-1] - 1e-3)
    assert pressed > 30
    assert exact.peak_force.mean == pytest.approx(pressed, rel=1e-12)
    assert drawn.peak_force.mean == pytest.approx(pressed, rel=1e-12)


def test_a_point_that_comes_forward_again_passes_an_offset_where_its_path_does() -> None:
    times = contact_duration.first_passage_times(np.array([0.0, 2.0, 1.0, 1.5, 3.0]), np.array([1.0, 2.25, 3.5]), 0.1)
    assert times[:2] == pytest.approx([0.05, 0.35])
    assert math.isnan(times[2])


def test_slowly_growing_forces_need_few_cells_in_a_piece(monkeypatch: pytest.MonkeyPatch) -> None:
    """A soft body felt often has hundreds of thousands of pieces; here one cell and two nodes of each are tried."""
    scenario = control_group(
        detector__feedback_period_s=0.002, contact__stiffness_N_m=4000.0, motion__velocity_mm_s=[0, 0, -30]
    )
    fine = bs.evaluate(scenario).contact_duration
    monkeypatch.setattr(contact_duration, "_MAX_CELLS", 1)
    coarse = bs.evaluate(scenario).contact_duration
    assert fine is not None
    assert coarse is not None
    assert coarse.mean == pytest.approx(fine.mean, rel=1e-6)
    for p in (0.01, 0.5, 0.99, 0.999):
        assert coarse.quantile(p) == pytest.approx(fine.quantile(p), rel=1e-3)


def test_ten_scenarios_reach_what_they_claim() -> None:
    laws = {name: bs.evaluate(scenario) for name, scenario in VARIED.items()}
    assert laws["noisy detector, false alarms"].false_alarm_probability > 0.05
    assert laws["undetected at a joint limit"].undetected_probability > 0.01
    assert laws["undetected at a joint limit"].curve.end == "joint_limit"
    assert laws["lateral, two joints feel it"].multi_joint_probability > 0.1
    assert laws["seven free joints, elbow of the arm hit"].trigger_joint_probability[4:].max() < 1e-3
    triggers = {int(np.argmax(result.trigger_joint_probability)) for result in laws.values()}
    assert len(triggers) >= 3
