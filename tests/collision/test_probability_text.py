"""Probabilities in words: never nothing for what is only improbable, and the text that results are printed as."""

from __future__ import annotations

import math
import re
from functools import partial

import pytest

import bumpstop as bs
from bumpstop.collision.probability_text import (
    accepted_percent,
    apart,
    decimal,
    none_of,
    percent,
    small_percent,
    use_percent,
)
from cli.support import EXAMPLE, run


@pytest.mark.parametrize(
    ("p", "counted", "integrated"),
    [
        (0.0, ("0 %", "0.0000"), ("less than 0.0001 %", "< 1e-12")),
        (1e-14, ("less than 0.0001 %", "< 1e-12"), ("less than 0.0001 %", "< 1e-12")),
        (5.4e-6, ("0.00054 %", "5.4e-06"), ("0.00054 %", "5.4e-06")),
        (0.25, ("25 %", "0.2500"), ("25 %", "0.2500")),
        (1.0, ("100 %", "1.0000"), ("over 99.9999 %", "1.0000")),
        (math.nextafter(1, 0), ("over 99.9999 %", "1.0000"), ("over 99.9999 %", "1.0000")),
    ],
)
def test_a_quadrature_does_not_round_to_certainty(
    p: float, counted: tuple[str, str], integrated: tuple[str, str]
) -> None:
    assert (percent(p), decimal(p)) == counted
    assert (percent(p, integrated=True), decimal(p, integrated=True)) == integrated


def test_what_is_next_to_nothing_has_figures_beside_what_is_accepted() -> None:
    assert small_percent(2e-20) == "2e-18 %"
    assert small_percent(0.0, integrated=True) == "less than 1e-10 %"
    assert small_percent(0.0) == "0 %"
    assert small_percent(0.5) == "50 %"
    assert small_percent(1.0, integrated=True) == "over 99.9999 %"


def test_more_than_what_is_accepted_reads_as_more() -> None:
    assert apart(0.00105, 0.001, percent) == "0.105 %"
    assert apart(0.0010000004, 0.001, percent) == "0.10000004 %"
    assert apart(0.00099, 0.001, percent) == "0.099 %"
    assert apart(0.001, 0.001, percent) == "0.1 %"
    assert (apart(0.0300251, 0.029905, percent), accepted_percent(0.029905)) == ("3 %", "2.9905 %")
    assert (apart(0.0298, 0.029905, percent), apart(0.0299049, 0.029905, percent)) == ("2.98 %", "2.99 %")
    assert (apart(1.04e-7, 1e-7, small_percent), accepted_percent(1e-7)) == ("1.04e-05 %", "1e-05 %")
    assert apart(0.029905, 0.029905, percent) == "2.9905 %"
    scenario = bs.load_scenario(EXAMPLE).with_values({"motion.speed_mm_s": 75.0})
    over = bs.evaluate(scenario).verdict.p_over_force
    assert over is not None
    told = scenario.with_values({"contact.area_cm2": 9.0, "verdict.accepted_probability": over / 1.0001})
    reason = bs.evaluate(told).verdict.reason
    first, second = (float(number) for number in re.findall(r"([0-9.]+) %", reason)[:2])
    assert first > second


def test_what_is_at_most_so_much_is_rounded_up() -> None:
    for p, told in ((2.7187e-5, "0.0028 %"), (2.7e-5, "0.0027 %"), (0.0999, "10 %"), (0.1234, "12.4 %"), (0.0, "0 %")):
        assert percent(p, up=True) == told
    assert (percent(0.99951, up=True), percent(0.9995000001, up=True)) == ("99.951 %", "99.9501 %")
    assert small_percent(1.04e-9, up=True) == "1.1e-07 %"
    for accepted, told in ((1e-3, "0.11 %"), (1.004001e-3, "0.1004 %")):
        assert apart(1.004e-3, accepted, partial(percent, up=True), up=True) == told


@pytest.mark.parametrize(
    ("use", "told"),
    [(1.0004, "100.04 %"), (0.9996, "99.96 %"), (1.0, "100 %"), (0.99999999, "99.999999 %"), (0.4321, "43.2 %"),
     (12.344, "1234 %"), (0.0, "0 %")],
)  # fmt: skip
def test_a_share_of_a_limit_is_not_rounded_to_all_of_it(use: float, told: str) -> None:
    assert use_percent(use) == told


def test_a_result_prints_what_the_terminal_shows() -> None:
    shown = run("evaluate", EXAMPLE).out
    assert [line.rstrip() for line in shown.splitlines()] == str(bs.evaluate(bs.load_scenario(EXAMPLE))).splitlines()
    assert "never detected < 1e-12" in shown
    drawn = str(bs.evaluate(bs.load_scenario(EXAMPLE), samples=1000, seed=1))
    assert "never detected 0.0000" in drawn


@pytest.mark.parametrize(
    ("runs", "told"),
    [
        (1, "less than 95 % (none of 1 run), accepted: 0.1 %"),
        (20, "less than 14 % (none of 20 runs), accepted: 0.1 %"),
        (4000, "less than 0.075 % (none of 4000 runs), within the accepted 0.1 %"),
    ],
)
def test_no_run_over_a_limit_is_no_probability_of_zero(runs: int, told: str) -> None:
    """Some 3 over the number of runs is what is left at 95 % confidence."""
    verdict = bs.evaluate(bs.load_scenario(EXAMPLE), samples=runs).verdict
    assert verdict.p_over_force == 0
    assert verdict.reason.endswith(f"with probability {told}.")


def test_no_run_over_a_limit_of_an_uncertain_scenario_either() -> None:
    scenario = bs.load_scenario(EXAMPLE).with_values({"uncertainty.contact.area_cm2": {"interval": [1.9, 2.1]}})
    reason = bs.evaluate_uncertain(scenario, samples=20).reason
    assert "with probability less than 14 % (none of 20 runs), accepted: 0.1 %" in reason


def test_the_bound_of_no_run_has_no_more_words_than_one() -> None:
    assert none_of(10_000_000) == "less than 0.0001 % (none of 10000000 runs)"
