"""The mean of what has a bound, beside an infinite mean."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.distribution.distribution import SampledDistribution, finite_mean
from collision.cases import control_group


def test_of_numbers() -> None:
    values = np.array([0.0, 0.0, 1.0, 2.5, 7.0, math.inf, math.inf])
    assert finite_mean(SampledDistribution(values)) == pytest.approx(2.1, rel=0.02)
    assert math.isnan(finite_mean(SampledDistribution(np.array([math.inf]))))


def test_of_collisions_cut_off_by_the_end_of_the_motion() -> None:
    """Half are never detected, the others have forces: of sampled ones the mean is a plain sum."""
    scenario = control_group(detector__thresholds_Nm=[100.0] * 7, motion__duration_s=0.076)
    exact, sampled = bs.evaluate(scenario), bs.evaluate(scenario, samples=100_000, seed=3)
    assert math.isinf(exact.peak_force.mean)
    assert 0.2 < exact.undetected_probability < 0.8
    assert finite_mean(exact.peak_force) == pytest.approx(finite_mean(sampled.peak_force), rel=0.03)


@pytest.mark.parametrize("samples", [None, 500])
def test_where_no_collision_has_a_bound_no_mean_is_told(samples: int | None) -> None:
    scenario = control_group(detector__thresholds_Nm=[1e6] * 7, motion__duration_s=0.5)
    result = bs.evaluate(scenario) if samples is None else bs.evaluate(scenario, samples=samples)
    assert math.isinf(result.peak_force.mean)
    assert "nan" not in str(result).split()
