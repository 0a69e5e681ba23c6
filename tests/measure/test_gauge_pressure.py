"""Pressures beside the force: zero, sign and unit."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bumpstop.measure.reading.gauge_reading import GaugeReading, read_gauge
from measure.gauge_cases import Array, pressed, sprung_mass, write_with_pressure


def _read(path: Path, scale: float, offset: float, *, sign: float = 1.0, unit: str = "N/cm2") -> GaugeReading:
    time, force = pressed(noise=0.1)
    pressure = np.maximum(force, 0) / 2 * scale + offset
    return read_gauge(write_with_pressure(path, time, sign * force, pressure, unit))


@pytest.mark.parametrize(
    ("scale", "offset", "unit", "names"),
    [
        (1.0, 10.0, "N/cm2", ["shifted"]),
        (1.0, -3.0, "N/cm2", ["shifted"]),
        (0.1, 1.013, "bar", ["shifted"]),
        (-1.0, 0.0, "N/cm2", ["inverted"]),
        (-0.01, 0.1, "MPa", ["shifted", "inverted"]),
        (1.0, 0.2, "N/cm2", []),
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_pressures_are_zeroed_and_turned_over(
    tmp_path: Path, sign: float, scale: float, offset: float, unit: str, names: list[str]
) -> None:
    whole = _read(tmp_path / "whole.csv", 1.0, 0.0)
    reading = _read(tmp_path / "p.csv", scale, offset, sign=sign, unit=unit)
    assert reading.peak_pressure_N_cm2 == pytest.approx(whole.peak_pressure_N_cm2, abs=0.3)
    assert reading.lasting_pressure_N_cm2 == pytest.approx(whole.lasting_pressure_N_cm2, abs=0.3)
    told = [fault for fault in reading.faults if "Pressure" in fault.text]
    assert [fault.name for fault in told] == names
    assert all(fault.repaired for fault in told)
    assert reading.usable


def test_a_wrong_unit_of_pressure_is_named(tmp_path: Path) -> None:
    reading = _read(tmp_path / "p.csv", 1.0, 0.0, unit="MPa")
    (fault,) = reading.faults
    assert (fault.name, fault.spoils) == ("wrong_unit", False)
    assert fault.text.endswith("the unit of pressure, 'MPa', is wrong; the force counts all the same.")


@pytest.mark.parametrize("offset", [0.0, 2.5])
def test_a_film_that_was_not_used_records_no_pressure(tmp_path: Path, offset: float) -> None:
    """A column of zeros was 'saturated (2400)', and a peak of 0 N/cm²."""
    reading = _read(tmp_path / "p.csv", 0.0, offset)
    (fault,) = reading.faults
    assert (fault.name, fault.spoils) == ("no_pressure", False)
    assert (
        fault.text
        == f"Column 'Pressure [N/cm2]' is {offset:g} N/cm² all the time: no pressure was recorded, the force counts."
    )
    assert np.isnan(reading.peak_pressure_N_cm2)
    assert np.isnan(reading.lasting_pressure_N_cm2)
    assert reading.usable


def _held(value: float) -> float:
    return value if math.isfinite(value) else 0.0


@pytest.mark.parametrize(
    ("force_of", "pressures"),
    [
        (lambda time, force: force, (200.0, 80.0)),
        # Of a force that was cut off, and of a spike in it, the pressure is what it was.
        (lambda time, force: np.minimum(force, 50.0), (200.0, 80.0)),
        (lambda time, force: np.where(np.arange(time.size) == 5350, 500.0, force), (200.0, 80.0)),
        # What a gauge shows that was hit before, or of a force in another unit, is hardly that of this contact.
        (lambda time, force: force + np.where((time > -0.8) & (time < -0.7), 80.0, 0.0), (0.0, 0.0)),
        (lambda time, force: 1e4 * force, (0.0, 0.0)),
    ],
)
def test_a_pressure_counts_where_contact_is_known(
    tmp_path: Path, force_of: Callable[[Array, Array], Array], pressures: tuple[float, float]
) -> None:
    """In the first half second and after it, until the gauge is free: a later touch is none of it."""
    time, force = pressed(noise=0.1)
    rest = 0.1 * np.random.default_rng(1).standard_normal(5000)
    time, force = np.concatenate((time[0] - 1 + np.arange(5000) / 5000, time)), np.concatenate((rest, force))
    pressure = np.where((time > 0) & (time < 0.9), 80.0, 0.0) + np.where((time > 0.02) & (time < 0.03), 120.0, 0.0)
    pressure += np.where(time > 1.0, 150.0, 0.0)
    reading = read_gauge(write_with_pressure(tmp_path / "p.csv", time, force_of(time, force), pressure))
    found = (_held(reading.pressure_N_cm2), _held(reading.pressing_pressure_N_cm2))
    assert found == pytest.approx(pressures, abs=0.01), [fault.text for fault in reading.faults]


def test_a_pressure_in_a_wrong_unit_does_not_count(tmp_path: Path) -> None:
    reading = _read(tmp_path / "p.csv", 1.0, 0.0, unit="MPa")
    assert np.isnan(reading.pressure_N_cm2)
    assert np.isnan(reading.pressing_pressure_N_cm2)
    assert np.isnan(_read(tmp_path / "p.csv", 0.0, 2.5).pressure_N_cm2)


def test_a_pressure_that_was_cut_off_is_a_lower_bound(tmp_path: Path) -> None:
    """And so is one of which the zero is not known: no more than what it spans."""
    time, force = pressed(noise=0.1)
    pressure = np.minimum(np.maximum(force, 0) * 2, 150.0)
    reading = read_gauge(write_with_pressure(tmp_path / "p.csv", time, force, pressure))
    assert [fault.name for fault in reading.faults] == ["saturated"]
    assert reading.pressure_N_cm2 == pytest.approx(150, abs=0.3)
    late = time > 0.02
    begun = read_gauge(write_with_pressure(tmp_path / "b.csv", time[late], force[late], 100 + pressure[late]))
    assert not begun.usable
    assert begun.pressure_N_cm2 == pytest.approx(150, abs=0.3)


def test_a_sensor_that_is_slower_than_the_gauge_shows_its_pressure_late(tmp_path: Path) -> None:
    """The gauge is free again after 13 ms, and the pressure of the contact stands in the samples after that."""
    time, force, _ = sprung_mass(1.0, 60e3, 0.4, rate=5000)
    force += 0.1 * np.random.default_rng(0).standard_normal(time.size)
    pressure = np.where((time > 0.014) & (time < 0.03), 150.0, 0.0)
    reading = read_gauge(write_with_pressure(tmp_path / "p.csv", time, force, pressure))
    assert reading.usable
    assert reading.release < 0.014
    assert reading.pressure_N_cm2 == 150
    assert np.isnan(reading.pressing_pressure_N_cm2)
