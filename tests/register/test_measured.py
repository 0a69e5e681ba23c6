"""What measured peaks say of outcomes: worse, never better, and why."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import bumpstop as bs
from bumpstop.register import RegisterResult
from bumpstop.register.measured import judge_by_shots
from bumpstop.register.shots import Shot
from bumpstop.uncertainty.judgement import Judgement
from register.cases import write_register


def shot(measured: float, speed: float = 50.0, band: tuple[float, float] = (80.0, 95.0)) -> Shot:
    return Shot(
        situation="a", shot="1", speed_mm_s=speed, predicted_N=88, low_N=band[0], high_N=band[1], measured_N=measured
    )


def test_measured_peaks_never_make_an_outcome_better(tmp_path: Path) -> None:
    result = bs.evaluate_register(bs.load_register(write_register(tmp_path, {"name": "a", "speed_mm_s": 50})))
    limit = result.results[0].verdict.limits
    assert limit is not None
    for measured, speed, outcome in (
        (math.nan, 50, "pass"),
        (90, 50, "pass"),
        (60, 50, "pass"),
        (96, 50, "inconclusive"),
        (limit.force_N, 50, "inconclusive"),
        (limit.force_N + 0.1, 50, "fail"),
        (limit.force_N + 0.1, 40, "fail"),
        (limit.force_N + 0.1, 60, "inconclusive"),
    ):
        assert judge_by_shots(result, [shot(measured, speed)]).outcome == outcome, (measured, speed)
    assert judge_by_shots(result, [shot(limit.force_N + 1, 60, (math.nan, math.nan))]).outcome == "inconclusive"
    failing = RegisterResult(result.register, (replace(result.results[0], outcome="fail", reason="as computed"),))
    assert judge_by_shots(failing, [shot(60)]).results == failing.results


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (shot(135.04), "measured 135.04 N, above the limit of 135 N."),
        (shot(120.02, band=(80.0, 120.0)), "measured 120.02 N, above the predicted 80 to 120 N:"),
        (shot(120.0004, band=(80.0, 120.0002)), "measured 120.0004 N, above the predicted 80 to 120.0002 N:"),
        (
            replace(shot(math.nan), lower_bound_N=135.04),
            "measured at least 135.04 N, above the limit of 135 N.",
        ),
    ],
)
def test_measured_peaks_are_told_with_all_of_their_digits(made: Shot, said: str, tmp_path: Path) -> None:
    result = bs.evaluate_register(bs.load_register(write_register(tmp_path, {"name": "a", "speed_mm_s": 50})))
    assert result.results[0].verdict.limits is not None
    assert result.results[0].verdict.limits.force_N == 135
    assert said in judge_by_shots(result, [made]).results[0].reason


def test_what_a_peak_without_a_band_is_above_is_told_from_it(tmp_path: Path) -> None:
    result = bs.evaluate_register(bs.load_register(write_register(tmp_path, {"name": "a", "speed_mm_s": 50})))
    most = bs.evaluate(result.results[0].situation.scenario).peak_force.quantile(0.999)
    measured = round(most, 6) + 1e-4
    (found,) = judge_by_shots(result, [shot(measured, band=NO_BAND)]).results
    words = found.reason.split()
    assert words[words.index("measured") + 1] == f"{measured:.15g}"
    assert float(words[words.index("above") + 2]) < measured


NO_BAND = (math.nan, math.nan)


@pytest.mark.parametrize(
    ("made", "outcome", "said"),
    [
        (
            shot(120, band=NO_BAND),
            "inconclusive",
            "above the 98.65 N that 0.1 % should exceed: the prediction",
        ),
        (shot(120, band=(0.0, 1e6)), "inconclusive", "above the 98.65 N that 0.1 % should exceed"),
        (shot(90, band=NO_BAND), "pass", ""),
        (shot(120, speed=100, band=NO_BAND), "pass", ""),
        (shot(0.09, band=NO_BAND), "inconclusive", "below a fifth of the computed median of"),
        (shot(0.09), "inconclusive", "measured 0.09 N, below a third of the predicted 80 to 95 N: reading or unit?"),
        (shot(0), "inconclusive", "reading or unit?"),
        (shot(27), "pass", ""),
        (shot(90, speed=10), "inconclusive", "its band of 80 to 95 N is that of 50 mm/s, the speed of the motion"),
        (shot(90, speed=51), "pass", ""),
        # Planned at another speed, with the band of that.
        (shot(45, speed=20, band=(36.0, 54.0)), "pass", ""),
        # What it should measure cannot be computed: without a band, and with one that may be that of the motion.
        (
            shot(134, speed=0, band=NO_BAND),
            "inconclusive",
            "what it should measure cannot be computed at this speed (motion.velocity_mm_s is zero)",
        ),
        (shot(100, speed=0, band=(60.0, 120.0)), "inconclusive", "cannot be computed at this speed"),
    ],
)
def test_readings_that_show_nothing_or_refute_the_prediction(
    made: Shot, outcome: str, said: str, tmp_path: Path
) -> None:
    result = bs.evaluate_register(bs.load_register(write_register(tmp_path, {"name": "a", "speed_mm_s": 50})))
    (found,) = judge_by_shots(result, [shot(85), made]).results
    assert found.outcome == outcome
    assert said in found.reason
    assert said in found.to_json()["reason"]
    # Of one that fails by itself the reason stays, and this stands beside it.
    failing = RegisterResult(result.register, (replace(result.results[0], outcome="fail", reason="as computed"),))
    (failed,) = judge_by_shots(failing, [made]).results
    assert (failed.outcome, failed.reason) == ("fail", "as computed")
    assert [said in warning for warning in failed.warnings] == [True] * bool(said)


@pytest.mark.parametrize(
    ("known", "speed", "outcome", "said"),
    [
        (
            {"lower_bound_N": 150.0, "unusable_recording": "s.csv"},
            50,
            "fail",
            "at least 150 N, above the limit of 135 N",
        ),
        (
            {"lower_bound_N": 150.0, "unusable_recording": "s.csv"},
            60,
            "inconclusive",
            "at least 150 N: its recording 's.csv'",
        ),
        ({"lower_bound_N": 90.0}, 50, "inconclusive", "at least 90 N: its recording cannot be relied on"),
        ({"unusable_recording": "s.csv"}, 50, "inconclusive", "mm/s: its recording 's.csv' cannot be relied on"),
        (
            {"recording": "r.csv"},
            50,
            "inconclusive",
            "'r.csv', that was not read: fill in its peak, or run bumpstop measure",
        ),
    ],
)
def test_shots_that_were_made_without_a_peak_do_not_pass(
    known: dict[str, Any], speed: float, outcome: str, said: str, tmp_path: Path
) -> None:
    result = bs.evaluate_register(bs.load_register(write_register(tmp_path, {"name": "a", "speed_mm_s": 50})))
    made = replace(shot(math.nan, speed), **known)
    (found,) = judge_by_shots(result, [shot(85), made]).results
    assert found.outcome == outcome
    assert said in found.reason
    # A peak that somebody typed counts, and not its recording.
    assert judge_by_shots(result, [replace(shot(90), recording="r.csv")]).outcome == "pass"


def test_several_shots_above_their_predictions_are_told(tmp_path: Path) -> None:
    result = bs.evaluate_register(bs.load_register(write_register(tmp_path, {"name": "a", "speed_mm_s": 50})))
    for peaks, told in (
        ((92, 93, 94), True),
        ((92, 93), False),
        ((92, 93, 94, 87), False),
        ((92, 93, 94, math.nan), True),
    ):
        (found,) = judge_by_shots(result, [shot(peak) for peak in peaks]).results
        assert found.outcome == "pass"
        assert [
            text.startswith("All 3 measured shots lie above their predictions, by 5.7 % in") for text in found.warnings
        ] == [True] * told
    # A verdict that holds over [uncertainty] is not one of point values.
    judged = Judgement("PASS", "", 0.0, 0.5, 0.95, 1, "acceptable")
    sure = RegisterResult(result.register, (replace(result.results[0], judgement=judged),))
    assert judge_by_shots(sure, [shot(92), shot(93), shot(94)]).results[0].warnings == ()


def test_what_a_gauge_shows_after_the_first_phase_is_judged(tmp_path: Path) -> None:
    """An arm that presses on: its peak of the first half second is below the limit, and what lasts above it."""
    row = {"name": "a", "speed_mm_s": 50}
    result = bs.evaluate_register(bs.load_register(write_register(tmp_path, row)))
    for lasting, speed, outcome, said in (
        (135.04, 50, "fail", "at 50 mm/s pressed with 135.04 N after the first 0.5 s, above the limit of 135 N."),
        (100, 50, "inconclusive", "pressed with 100 N after the first 0.5 s, above the predicted 80 to 95 N"),
        (135.04, 60, "inconclusive", "that of 50 mm/s, the speed of the motion"),
        (90, 50, "pass", ""),
    ):
        (found,) = judge_by_shots(result, [replace(shot(90, speed), lasting_N=lasting)]).results
        assert found.outcome == outcome, lasting
        assert said in found.reason
    (found,) = judge_by_shots(result, [replace(shot(90, band=NO_BAND), lasting_N=120)]).results
    assert "pressed with 120 N after the first 0.5 s, above the 98.65 N that 0.1 % should exceed" in found.reason
    unknown = replace(shot(math.nan), lower_bound_N=90, unusable_recording="s.csv", lasting_N=140)
    assert judge_by_shots(result, [unknown]).outcome == "fail"


def test_a_prediction_of_another_contact_is_told(tmp_path: Path) -> None:
    """Shots of the belly's soft gauge under the name of a hand: in their band, which is far below what is computed."""
    result = bs.evaluate_register(bs.load_register(write_register(tmp_path, {"name": "a", "speed_mm_s": 50})))
    soft = replace(shot(34, band=(25.0, 45.0)), predicted_N=33)
    (found,) = judge_by_shots(result, [shot(85), soft]).results
    assert found.outcome == "inconclusive"
    assert found.reason == (
        "Shot 1 at 50 mm/s has a prediction of 33 N, and 81.58 N are computed at this speed: is it of this situation, "
        "its body region and speed?"
    )
    bare = replace(soft, predicted_N=math.nan)
    assert "has a prediction of up to 45 N" not in judge_by_shots(result, [bare]).results[0].reason
    far = replace(bare, measured_N=20, low_N=15, high_N=35)
    assert "has a prediction of up to 35 N" in judge_by_shots(result, [far]).results[0].reason
    # A gauge that is softer than the body shows less, and is none of another.
    assert judge_by_shots(result, [replace(shot(60, band=(50.0, 70.0)), predicted_N=60)]).outcome == "pass"


def test_each_phase_of_a_shot_has_its_limit(tmp_path: Path) -> None:
    """Contact judged in two phases: the transient limit is that of the peak, not of what lasts."""
    row = {"name": "a", "speed_mm_s": 50, "contact.limits": "ts15066", "verdict.clamped_limit": "two_phase"}
    result = bs.evaluate_register(bs.load_register(write_register(tmp_path, row)))
    (one,) = result.results
    assert one.outcome == "pass"
    assert one.verdict.limits is not None
    assert one.verdict.transient is not None
    limit, first = one.verdict.limits.force_N, one.verdict.transient.force_N
    assert first > limit
    for peak, lasting, outcome in ((limit + 1, 40, "pass"), (limit + 1, limit + 0.5, "fail"), (first + 1, 40, "fail")):
        made = replace(shot(peak, band=(80.0, first + 2)), lasting_N=lasting)
        assert judge_by_shots(result, [made]).outcome == outcome, (peak, lasting)
