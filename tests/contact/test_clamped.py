"""Clamped contact: force of a linear spring, and the pressure it makes."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bumpstop.contact import LimitTable, clamped_force, pressure_N_cm2
from bumpstop.errors import InputError


def test_force_of_the_sources_example() -> None:
    # Section 6.1.3: compressing the cranium by 1 mm takes 150 N.
    cranium = LimitTable.load("bgia2011").contact_limits("cranium_forehead", "clamped")
    assert clamped_force(cranium.stiffness_N_m, 1e-3) == 150.0


def test_pressure_of_the_sources_example() -> None:
    # Section 6.1.3: 140 N on 5 cm² make 28 N/cm².
    assert pressure_N_cm2(140.0, 5.0) == 28.0
    assert pressure_N_cm2(140.0, 5.0, 1.5) == 42.0


def test_no_force_before_contact() -> None:
    assert clamped_force(75_000.0, -0.01) == 0.0
    assert clamped_force(75_000.0, 0.0) == 0.0


def test_floats_give_floats() -> None:
    assert type(clamped_force(75_000.0, 0.001)) is float
    assert type(pressure_N_cm2(100.0, 2.0)) is float


def test_arrays_give_arrays() -> None:
    force = clamped_force(np.array([1000.0, 2000.0]), np.array([[0.1], [-0.1]]))
    assert force.tolist() == [[100.0, 200.0], [0.0, 0.0]]
    assert pressure_N_cm2(np.array([10.0, 20.0]), 2.0).tolist() == [5.0, 10.0]
    assert pressure_N_cm2(10.0, np.array([1.0, 2.0]), 2.0).tolist() == [20.0, 10.0]


def test_arguments_are_left_alone() -> None:
    compression = np.array([-0.001, 0.001])
    clamped_force(1000.0, compression)
    assert compression.tolist() == [-0.001, 0.001]


def test_lost_numbers_stay_lost() -> None:
    assert math.isnan(clamped_force(1000.0, math.nan))
    assert math.isnan(pressure_N_cm2(math.nan, 1.0))
    assert pressure_N_cm2(math.inf, 1.0) == math.inf


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_refusals(bad: float) -> None:
    with pytest.raises(InputError, match=r"contact\.stiffness_N_m: .* finite and above 0"):
        clamped_force(bad, 0.001)
    with pytest.raises(InputError, match=r"contact\.area_cm2: .* finite and above 0"):
        pressure_N_cm2(10.0, bad)
    with pytest.raises(InputError, match=r"contact\.peak_factor: .* finite and at least 1"):
        pressure_N_cm2(10.0, 1.0, bad)


def test_one_bad_element_is_named() -> None:
    with pytest.raises(InputError, match=r"contact\.area_cm2: -3\.0 cannot be used"):
        pressure_N_cm2(10.0, np.array([1.0, -3.0, 2.0]))


@given(
    st.floats(1.0, 1e6),
    st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=10),
)
def test_force_never_falls_with_compression(stiffness_N_m: float, compressions: list[float]) -> None:
    forces = [clamped_force(stiffness_N_m, compression) for compression in sorted(compressions)]
    assert all(force >= 0.0 for force in forces)
    assert all(one <= other for one, other in pairwise(forces))


@given(st.floats(1e-3, 1e3), st.floats(1.0, 10.0))
def test_the_allowed_force_makes_at_most_the_allowed_pressure(area_cm2: float, peak_factor: float) -> None:
    hand = LimitTable.load("ts15066").contact_limits("hand_finger", "clamped")
    pressure = pressure_N_cm2(hand.allowed_force_N(area_cm2, peak_factor), area_cm2, peak_factor)
    # Four roundings of relative size 2^-53 between force and pressure.
    assert pressure <= 190.0 * (1.0 + 4 * 2.0**-53)
