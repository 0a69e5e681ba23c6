"""Quantiles of runs are the runs of the right rank."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.distribution.distribution import SampledDistribution
from collision.cases import control_group

PROBABILITIES = ["0.01", "0.05", "0.07", "0.55", "0.29", "0.5", "0.57", "0.9", "0.95", "0.99", "0.999"]


@pytest.mark.parametrize("count", [1, 2, 3, 10, 19, 20, 21, 100, 1000, 1001])
def test_the_smallest_value_that_no_more_are_above(count: int) -> None:
    """In whole numbers and fractions: 1, 2 .. count in any order, so that the quantile is its own rank."""
    values = np.random.default_rng(count).permutation(np.arange(1.0, count + 1))
    sample = SampledDistribution(values)
    for p in PROBABILITIES:
        allowed = (1 - Fraction(p)) * count
        smallest = next(x for x in range(1, count + 1) if count - x <= allowed)
        assert sample.quantile(float(p)) == smallest, p


def test_values_that_occur_many_times() -> None:
    sample = SampledDistribution(np.array([0.0] * 50 + [3.0] * 45 + [7.0] * 5))
    assert [sample.quantile(p) for p in (0.5, 0.51, 0.95, 0.951)] == [0.0, 3.0, 3.0, 7.0]
    assert sample.exceedance(3.0) == 0.05


def test_runs_without_detection_are_beyond_all() -> None:
    undetected = np.array([False] * 18 + [True] * 2)
    sample = SampledDistribution(np.arange(1.0, 21), undetected)
    assert sample.quantile(0.9) == 18
    assert sample.quantile(0.91) == math.inf


def test_those_of_a_law_are_runs_of_it() -> None:
    result = bs.evaluate(control_group(), samples=200, seed=5)
    assert result.runs is not None
    values = np.sort(result.peak_force.values)  # type: ignore[attr-defined]
    for p, rank in ((0.5, 100), (0.95, 190), (0.99, 198), (0.995, 199)):
        assert result.peak_force.quantile(p) == values[rank - 1]
