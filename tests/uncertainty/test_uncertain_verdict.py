"""The verdict with an interval against brute force, in small; ``python -m validation --only uncertainty`` has more."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.report.collision.uncertainty import UncertaintySection
from bumpstop.uncertainty.conclusion import concluded, rank_of
from bumpstop.uncertainty.evaluation import points_for
from bumpstop.uncertainty.point_evaluation import PointEvaluator
from cli.support import run, strict_json
from collision.cases import control_group
from uncertainty.uncertain_cases import random_uncertain

# Scenarios of which some pass and some fail.
JUDGED = (1, 5, 9)
EXAMPLE = Path(__file__).parents[2] / "examples" / "07_hand_uncertain.toml"


def test_points_are_evaluations_of_their_scenarios() -> None:
    for seed in range(3):
        evaluator = PointEvaluator(random_uncertain(seed, assumed=1, distributions=2))
        ends = np.array([each.limits(0.9)[1] for each in evaluator.inputs])
        points = evaluator.at(ends[None], far_tails=True)
        alone = bs.evaluate(evaluator.scenario_at(ends))
        over = max(alone.verdict.p_over_force or 0.0, alone.verdict.p_over_pressure or 0.0)
        assert points.p_over[0] == pytest.approx(over, rel=1e-12)
        assert (points.utilisation[0] > 1) == (over > alone.scenario.verdict.accepted_probability)


def test_two_phases_and_free_contact_have_utilisations_that_agree_with_the_verdict() -> None:
    table = {"contact.stiffness_N_m": {"relative": [0.5, 2.0]}}
    hand = {"contact__limits": "ts15066", "contact__area_cm2": 2.0, "uncertainty": table}
    for changes in ({"verdict__clamped_limit": "two_phase"}, {"contact__kind": "free"}):
        for speed in (40, 110):
            scenario = control_group(**hand, **changes, motion__velocity_mm_s=[0, 0, -speed])
            found = PointEvaluator(scenario).at(np.array([[1.0]]))
            assert (found.utilisation[0] > 1) == (found.p_over[0] > 1e-3), (changes, speed)


def test_a_distance_in_an_interval_is_looked_at_in_every_phase_of_the_control_cycle() -> None:
    """Even steps of the scan were five cycles each: all saw the same force, and the verdict was acceptable."""
    scenario = bs.Scenario.from_dict({
        "robot": "ur10e",
        "pose_deg": [10, -80, 110, -120, -90, 20],
        "motion": {"velocity_mm_s": [0, 0, -100]},
        "contact": {"body": "hand_finger", "area_cm2": 4, "offset_law": "fixed", "offset_mm": 12.0},
        "detector": {"thresholds_Nm": [40, 40, 30, 12, 12, 12], "noise_sd_Nm": [2.0, 2.0, 1.5, 0.6, 0.6, 0.6]},
        "reaction": {"joint_acceleration_rad_s2": 12},
        "uncertainty": {"contact.offset_mm": {"interval": [4.0, 20.0]}},
    })  # fmt: skip
    evaluator = PointEvaluator(scenario)
    use = evaluator.at(np.linspace(4.0, 20.0, 400)[:, None]).utilisation
    assert np.mean(use > 1) > 0.2
    result = bs.evaluate_uncertain(scenario)
    assert result.conclusion == "inconclusive"
    assert result.deciding == ("contact.offset_mm",)
    assert result.case("worst").utilisation > 0.995 * use.max()
    (bar,) = result.tornado
    assert bar.utilisation_low < 1.05 * use.min()
    assert bar.utilisation_high > 0.98 * use.max()
    assert bs.judge_situation(scenario).word == "INCONCLUSIVE"


def test_the_interval_covers_further_draws() -> None:
    scenario = random_uncertain(5, assumed=0, distributions=3)
    result = bs.evaluate_uncertain(scenario, seed=1)
    evaluator = PointEvaluator(scenario)
    u = np.random.default_rng(4).random((400, 3))
    drawn = evaluator.at(np.column_stack([each.quantile(u[:, j]) for j, each in enumerate(evaluator.inputs)]))
    use = np.sort(drawn.utilisation)
    inside = (use <= result.case("confident").utilisation).mean()
    # Four standard errors of 400 draws about 95 %.
    assert 0.95 - 4 * 0.011 <= inside <= 1.0
    assert np.quantile(use, 0.95) == pytest.approx(result.case("confident").utilisation, rel=0.03)


def test_a_bar_of_the_tornado_is_a_difference() -> None:
    """Of narrow ranges swings are derivatives times ranges: the order is that of finite differences."""
    table = {
        "contact.stiffness_N_m": {"distribution": "normal", "relative_sd": 0.01},
        "contact.area_cm2": {"relative": [0.97, 1.03]},
        "detector.threshold_scale": {"interval": [0.98, 1.02]},
        "motion.speed_mm_s": {"distribution": "normal", "relative_sd": 0.003},
    }
    scenario = control_group(contact__area_cm2=2.0, uncertainty=table)
    result = bs.evaluate_uncertain(scenario, points=64)
    evaluator = PointEvaluator(scenario)
    slopes = {}
    for j, each in enumerate(evaluator.inputs):
        step = np.zeros(4)
        step[j] = 1e-3 * evaluator.central_figures[j]
        use = evaluator.at(evaluator.central_figures + np.array([-step, step])).utilisation
        low, high = each.limits(0.95)
        slopes[each.key] = abs(use[1] - use[0]) / (2 * step[j]) * (high - low)
    assert [bar.key for bar in result.tornado] == sorted(slopes, key=lambda key: -slopes[key])
    for bar in result.tornado:
        assert bar.swing == pytest.approx(slopes[bar.key], rel=0.05)


def test_what_is_assumed_and_swaps_the_verdict_makes_it_inconclusive() -> None:
    words = []
    for seed in (0, 3, 4, 5, 8):
        scenario = random_uncertain(seed, assumed=2, distributions=0)
        result = bs.evaluate_uncertain(scenario)
        evaluator = PointEvaluator(scenario)
        ends = np.array([each.limits(0.95) for each in evaluator.inputs])
        share = np.random.default_rng(seed).random((40, 2))
        ratio = evaluator.exceedance_ratio(evaluator.at(ends[:, 0] + share * np.ptp(ends, axis=1)))
        if (ratio > 1).any() and (ratio <= 1).any():
            assert result.conclusion == "inconclusive", seed
        elif result.conclusion != "inconclusive":
            assert result.acceptable == bool((ratio <= 1).all())
        words.append(result.conclusion)
    assert {"acceptable", "not_acceptable", "inconclusive"} <= set(words)


def test_judgements_have_the_word_of_the_evaluation() -> None:
    word = {"acceptable": "PASS", "not_acceptable": "FAIL", "inconclusive": "INCONCLUSIVE"}
    scenarios = [random_uncertain(seed) for seed in JUDGED]
    judged = bs.judge_situations([*scenarios, control_group(), control_group(robot="absent")], processes=1)
    for scenario, found in zip(scenarios, judged, strict=False):
        assert isinstance(found, bs.Judgement)
        assert found.word == word[bs.evaluate_uncertain(scenario).conclusion]
        assert found.reason.endswith(".")
    assert {found.word for found in judged[: len(JUDGED)] if isinstance(found, bs.Judgement)} >= {"PASS", "FAIL"}
    plain, refused = judged[-2:]
    assert isinstance(plain, bs.Judgement)
    assert (plain.word, plain.confidence) == ("FAIL", None)
    assert isinstance(refused, bs.InputError)


def test_the_same_seed_gives_the_same_whatever_the_threads() -> None:
    scenario = bs.load_scenario(EXAMPLE)
    one, two = (bs.evaluate_uncertain(scenario, points=64, threads=n).to_json() for n in (1, 3))
    assert one == two
    assert bs.evaluate_uncertain(scenario, points=64, seed=1).to_json() != one


def test_ranks_cover_and_points_decide_as_soon_as_they_do() -> None:
    assert (rank_of(0.95, 256), rank_of(0.05, 256), rank_of(0.95, 1)) == (244, 11, 0)
    assert [points_for(c) for c in (0.5, 0.95, 0.99)] == [64, 256, 1024]
    rng = np.random.default_rng(3)
    for _ in range(200):
        ratio, untested = rng.lognormal(-1.5, 1.0, 64), rng.random(64) < 0.02
        whole = concluded(ratio, untested, 0.95, 64)
        for n in range(64):
            assert concluded(ratio[:n], untested[:n], 0.95, 64) in (None, whole)


@pytest.mark.usefixtures("unsaved_pictures")
def test_from_the_shell(tmp_path: Path) -> None:
    shown = run("evaluate", EXAMPLE, "--json", "--out", tmp_path)
    found = strict_json(shown.out)
    assert (shown.status, found["uncertainty"]["conclusion"]) == (0, "acceptable")
    assert found == json.loads(json.dumps(bs.evaluate_uncertain(bs.load_scenario(EXAMPLE)).to_json()))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "How sure" in page
    assert "not the risk of ISO 12100" in page
    assert {path.name for path in tmp_path.glob("*.svg")} >= {"tornado.svg", "exceedance_band.svg"}
    wide = run("evaluate", EXAMPLE, "--set", "uncertainty.contact.area_cm2={ interval = [0.9, 2.5] }", "--json")
    verdict = strict_json(wide.out)["verdict"]
    assert (wide.status, verdict["acceptable"], verdict["conclusion"]) == (4, None, "inconclusive")
    assert "contact.area_cm2 is assumed and decides" in verdict["reason"]


def test_without_limits_forces_are_shown() -> None:
    scenario = bs.load_scenario(EXAMPLE).with_values({"contact.body": None, "contact.stiffness_N_m": 75000.0})
    result = bs.evaluate_uncertain(scenario, points=64)
    assert result.conclusion == "no_limits"
    assert np.isfinite(result.case("worst").utilisation)
    assert "NO LIMITS" in str(result)
    section = UncertaintySection(result.central, result)
    assert ["peak force [N]" in picture.render().svg for picture in section.pictures()] == [True, True]
    assert "of the limit" not in "".join(section.content())
    assert not UncertaintySection(result.central, None).applies()


def test_an_upper_end_is_no_less_than_it_is_and_told_from_what_is_accepted() -> None:
    scenario = random_uncertain(4, assumed=0)
    first = bs.evaluate_uncertain(scenario)
    over = first.case("confident").p_over
    for accepted in (1e-3, over * 1.001, over / 1.001):
        found = bs.evaluate_uncertain(scenario.with_values({"verdict.accepted_probability": accepted}))
        told = re.search(r"of at most ([0-9.]+) %, (?:within the accepted )?([0-9.]+) %", found.reason)
        assert told is not None, found.reason
        most, allowed = told.groups()
        assert float(most) >= 100 * over * (1 - 1e-12)
        assert (float(most) > float(allowed)) == (over > accepted), found.reason


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"detector.thresholds_Nm[3]": {"interval": [14, 25]}}, "a false alarm comes before contact too often"),
        (
            {"contact.area_cm2": {"interval": [1.0, 2.5]}},
            "one contact exceeds the limits for Hand/Finger with probability above 0.1 % (less than 0.0001 % in the "
            "central case)",
        ),
    ],
)
def test_a_judgement_says_what_is_decided(table: dict[str, Any], words: str) -> None:
    judged = bs.judge_situation(control_group(contact__area_cm2=2.0, uncertainty=table))
    assert judged.word == "INCONCLUSIVE"
    assert judged.reason == f"What is assumed ({next(iter(table))}) decides whether {words}."
