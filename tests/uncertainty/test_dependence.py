"""Verdicts that rest on independent inputs say so: against inputs that are drawn together."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.uncertainty.dependence import dependence_note
from bumpstop.uncertainty.point_evaluation import PointEvaluator

_TABLE = {
    "contact.stiffness_N_m": {"distribution": "lognormal", "sigma": 0.1},
    "reaction.joint_acceleration_rad_s2": {"distribution": "lognormal", "sigma": 0.1},
    "detector.threshold_scale": {"distribution": "uniform", "low": 0.9, "high": 1.1},
}


def hand(speed: float, table: dict[str, object] | None = None) -> bs.Scenario:
    base = bs.load_scenario("examples/07_hand_uncertain.toml").without_uncertainty()
    return base.with_values({"motion.velocity_mm_s": [0, 0, -speed], "uncertainty": _TABLE if table is None else table})


@cache
def share_over(speed: float, together: bool) -> float:
    """Of 600 draws of the inputs, how many exceed a limit more often than accepted: to 0.01 where it is 0.05."""
    scenario = hand(speed)
    evaluator = PointEvaluator(scenario)
    rng = np.random.default_rng(3)
    u = rng.random((600, 3))
    if together:
        # More stiffness, higher thresholds and less deceleration all make forces higher.
        u = u[:, :1] * np.ones(3)
        slower = [each.key for each in evaluator.inputs].index("reaction.joint_acceleration_rad_s2")
        u[:, slower] = 1 - u[:, slower]
    rows = np.column_stack([each.quantile(u[:, j]) for j, each in enumerate(evaluator.inputs)])
    return float((evaluator.at(rows).p_over > scenario.verdict.accepted_probability).mean())


@pytest.mark.parametrize("speed", [42.0, 45.0, 50.0])
def test_the_note_stands_where_inputs_that_go_together_would_swap_the_verdict(speed: float) -> None:
    scenario = hand(speed)
    result = bs.evaluate_uncertain(scenario)
    apart, together = share_over(speed, False), share_over(speed, True)
    assert (result.conclusion == "acceptable") == (apart < 0.05)
    said = [note for note in result.notes if note.startswith("This holds for inputs that are independent")]
    assert bool(said) == (apart < 0.05 < together)
    judged = bs.judge_situation(scenario)
    assert all(note in judged.reason for note in said)
    assert ("independent of one another" in judged.reason) == bool(said)


def test_all_three_cases_are_among_the_speeds() -> None:
    assert share_over(42.0, True) < 0.05
    assert share_over(45.0, False) < 0.05 < share_over(45.0, True)
    assert share_over(50.0, False) > 0.05


def test_one_distribution_has_nothing_to_go_with() -> None:
    evaluator = PointEvaluator(hand(45.0, {"contact.stiffness_N_m": _TABLE["contact.stiffness_N_m"]}))
    assert dependence_note(evaluator, 0.95, evaluator.central_figures) is None


def test_the_example_says_which_inputs_and_how_much() -> None:
    result = bs.evaluate_uncertain(bs.load_scenario("examples/07_hand_uncertain.toml"))
    assert result.conclusion == "acceptable"
    assert result.notes[0] == (
        "This holds for inputs that are independent of one another. Were contact.stiffness_N_m, "
        "reaction.joint_acceleration_rad_s2, reaction.latency_s, detector.threshold_scale to go together, one contact "
        "would exceed a limit at 95 % confidence with probability up to 2.5 %, 0.1 % accepted."
    )
