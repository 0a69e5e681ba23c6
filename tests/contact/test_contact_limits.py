"""Limits of one contact: where force and pressure limits cross, and what force they allow together."""

from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bumpstop.contact import ContactLimits, LimitTable
from bumpstop.errors import InputError

BGIA = LimitTable.load("bgia2011")
TS = LimitTable.load("ts15066")


def test_crossing_area_of_the_cranium() -> None:
    cranium = BGIA.contact_limits("cranium_forehead", "clamped")
    crossing = cranium.crossing_area_cm2
    assert crossing == pytest.approx(130 / 30, rel=1e-15)
    # Schroeder's two examples around figure 6.1: 1 cm² at 40 N fails by pressure, 5 cm² at 140 N by force.
    assert (cranium.governing(1.0), cranium.allowed_force_N(1.0)) == ("pressure", 30)
    assert (cranium.governing(5.0), cranium.allowed_force_N(5.0)) == ("force", 130)


def test_peak_factor_moves_the_crossing_outwards() -> None:
    cranium = BGIA.contact_limits("cranium_forehead", "clamped")
    assert (cranium.governing(5.0, 2.0), cranium.allowed_force_N(5.0, 2.0)) == ("pressure", 75)
    assert cranium.governing(2 * 130 / 30 + 0.01, 2.0) == "force"


def test_limits_met_together_are_called_force() -> None:
    chest = TS.contact_limits("chest", "clamped", "pectoral muscle")
    even = dataclasses.replace(chest, force_N=340.0)
    assert even.governing(2.0) == "force"


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_impossible_area_is_refused(bad: float) -> None:
    limits = TS.contact_limits("chest", "clamped")
    with pytest.raises(InputError, match=r"contact\.area_cm2"):
        limits.allowed_force_N(bad)
    with pytest.raises(InputError, match=r"contact\.area_cm2"):
        limits.governing(bad)


@pytest.mark.parametrize("bad", [0.99, -1.0, math.nan, math.inf])
def test_impossible_peak_factor_is_refused(bad: float) -> None:
    limits = TS.contact_limits("chest", "clamped")
    with pytest.raises(InputError, match=r"contact\.peak_factor"):
        limits.allowed_force_N(1.0, bad)


ALL_LIMITS = [
    table.contact_limits(region.name, kind)
    for table in (BGIA, TS)
    for region in table.regions
    for kind in ("clamped", "free")
]
permitted_limits = st.sampled_from([limits for limits in ALL_LIMITS if limits.permitted])
areas_cm2 = st.floats(1e-3, 1e3)
peak_factors = st.floats(1.0, 10.0)


@given(st.sampled_from(ALL_LIMITS), areas_cm2, areas_cm2, peak_factors)
def test_allowed_force_never_falls_as_the_area_grows(
    limits: ContactLimits, one: float, other: float, peak_factor: float
) -> None:
    small, large = sorted((one, other))
    assert limits.allowed_force_N(small, peak_factor) <= limits.allowed_force_N(large, peak_factor)


@given(permitted_limits, st.floats(1.0 + 1e-12, 100.0), peak_factors)
def test_above_the_crossing_the_force_limit_governs(limits: ContactLimits, beyond: float, peak_factor: float) -> None:
    assert limits.crossing_area_cm2 is not None
    area_cm2 = limits.crossing_area_cm2 * peak_factor * beyond
    assert limits.governing(area_cm2, peak_factor) == "force"
    assert limits.allowed_force_N(area_cm2, peak_factor) == limits.force_N


@given(permitted_limits, st.floats(1e-3, 1.0 - 1e-12), peak_factors)
def test_below_the_crossing_the_pressure_limit_governs(limits: ContactLimits, share: float, peak_factor: float) -> None:
    assert limits.crossing_area_cm2 is not None
    area_cm2 = limits.crossing_area_cm2 * peak_factor * share
    assert limits.governing(area_cm2, peak_factor) == "pressure"
    # Four roundings of relative size 2^-53 lie between the two expressions.
    assert limits.allowed_force_N(area_cm2, peak_factor) == pytest.approx(limits.force_N * share, rel=1e-15)
