"""Pressures beside the force: zero, sign and unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bumpstop.measure.reading.gauge_reading import GaugeReading, read_gauge
from measure.gauge_cases import pressed


def _read(path: Path, scale: float, offset: float, *, sign: float = 1.0, unit: str = "N/cm2") -> GaugeReading:
    time, force = pressed(noise=0.1)
    pressure = np.maximum(force, 0) / 2 * scale + offset
    rows = zip(time.tolist(), (sign * force).tolist(), pressure.tolist(), strict=True)
    text = "".join(f"{t!r};{f!r};{p!r}\n" for t, f, p in rows)
    path.write_text(f"Time [s];Force [N];Pressure [{unit}]\n{text}", encoding="utf-8")
    return read_gauge(path)


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
