"""Numbers of a few digits on the safe side."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bumpstop.identification.comparison import JointScore, mean_told
from bumpstop.rounding import on_its_side, rounded, to_decimals
from bumpstop.terminal import counted, in_percent


@pytest.mark.parametrize(
    ("value", "down", "up"),
    [
        (0.0, 0.0, 0.0),
        (999.96, 999.9, 1000.0),
        (999.94, 999.9, 1000.0),
        (-1.23456, -1.235, -1.234),
        (1.23456e-7, 1.234e-7, 1.235e-7),
        (math.inf, math.inf, math.inf),
        (-1e308, -1e308, -1e308),
        # What is a rounding of the value is not a digit of it.
        (0.1 + 0.2, 0.3, 0.3),
        (100 * 0.07, 7.0, 7.0),
        (1000 * (1 - 2e-16), 1000.0, 1000.0),
    ],
)
def test_four_digits_on_either_side(value: float, down: float, up: float) -> None:
    assert rounded(value, 4, up=False) == down
    assert rounded(value, 4, up=True) == up


@pytest.mark.parametrize(
    ("value", "down", "up"),
    [
        (135.001, 135.0, 135.01),
        (135.0, 135.0, 135.0),
        (-0.018, -0.02, -0.01),
        (0.1 + 0.2, 0.3, 0.3),
        (1.15, 1.15, 1.15),
        (math.inf, math.inf, math.inf),
        (-1e308, -1e308, -1e308),
    ],
)
def test_two_decimals_on_either_side(value: float, down: float, up: float) -> None:
    assert to_decimals(value, 2, up=False) == down
    assert to_decimals(value, 2, up=True) == up


def test_any_value_lies_between_its_two_roundings() -> None:
    random = np.random.default_rng(3)
    for value in random.choice([-1, 1], 2000) * 10 ** random.uniform(-9, 9, 2000):
        for digits in (1, 2, 6):
            low, high = rounded(float(value), digits, up=False), rounded(float(value), digits, up=True)
            assert low <= value <= high
            assert high - low == pytest.approx(10.0 ** (math.floor(math.log10(abs(value))) + 1 - digits), rel=1e-5)
            assert {float(f"{low:.{digits}g}"), float(f"{high:.{digits}g}")} == {low, high}


@pytest.mark.parametrize(
    ("value", "limits", "told"),
    [
        (160.03, [160.0], "160.03"),
        (159.996, [160.0], "159.996"),
        (160.0, [160.0], "160"),
        (160.03, [], "160"),
        (160.03, [160.0, 160.032], "160.03"),
        (135.04, [135.04], "135.04"),
        (math.inf, [160.0], "inf"),
    ],
)
def test_a_value_is_told_on_its_side_of_its_limits(value: float, limits: list[float], told: str) -> None:
    texts = (f"{value:.{digits}g}" for digits in range(4, 18))
    assert on_its_side(texts, value, *((limit, limit) for limit in limits)) == told


def test_what_no_text_tells_is_told_by_the_first() -> None:
    assert on_its_side(iter(["1 %", "1.0 %"]), 1.2, (1.1, 1.1)) == "1 %"


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [(0.01734, 2, "1.7 %"), (0.999, 2, "100 %"), (5.668, 2, "567 %"), (12.34, 3, "1234 %"), (-0.0312, 3, "-3.12 %"),
     (float("inf"), 2, "none"), (float("nan"), 3, "none"), (0.0, 2, "0 %"),
     (1e-7, 3, "less than 0.0001 %"), (1.5e-6, 3, "0.00015 %")],
)  # fmt: skip
def test_shares_in_percent_have_no_powers_of_ten(value: float, digits: int, text: str) -> None:
    assert in_percent(value, digits) == text


def test_one_of_them_is_one() -> None:
    assert [counted(count, "row") for count in (0, 1, 2)] == ["0 rows", "1 row", "2 rows"]
    assert [counted(count, "row", "was") for count in (1, 2)] == ["1 row was", "2 rows were"]
    assert [counted(count, "sample", "stands") for count in (1, 2)] == ["1 sample stands", "2 samples stand"]


def test_a_mean_error_has_no_digits_of_rounding() -> None:
    def told(mean: float, rmse: float) -> float:
        return mean_told(JointScore(name="elbow", r2=0.9, r2_raw=0.9, mean=mean, sd=rmse, rmse=rmse))

    assert told(-1.216e-6, 0.3) == 0.0
    assert told(-0.02625, 0.1124) == -0.02625
    assert math.isnan(told(math.nan, 0.1))
    assert told(0.1, 0.0) == 0.1
