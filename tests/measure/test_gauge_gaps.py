"""Samples that are missing from recordings: at the top of the curve they may be the peak."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bumpstop.measure.reading.gauge_reading import GaugeReading, read_gauge
from measure.gauge_cases import Array, pressed, sprung_mass, write


def _without(path: Path, time: Array, force: Array, begin: float, end: float) -> GaugeReading:
    kept = (time < begin) | (time > end)
    return read_gauge(write(path, time[kept], force[kept]))


def _hidden(reading: GaugeReading) -> list[str]:
    return [fault.text for fault in reading.faults if fault.name == "gaps" and fault.spoils]


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("noise", [0.0, 0.3, 1.0])
def test_a_gap_over_the_peak_spoils_whatever_sample_is_highest(tmp_path: Path, noise: float, seed: int) -> None:
    """The highest sample that is left need not stand beside the gap."""
    time, force, _ = sprung_mass(4.0, 10e3, 0.25, rate=4000.0, before=0.1, after=0.7)
    summit = time[int(np.argmax(force))]
    force = force + noise * np.random.default_rng(seed).standard_normal(time.size)
    reading = _without(tmp_path / "gap.csv", time, force, summit - 5e-3, summit + 5e-3)
    assert _hidden(reading)
    assert not reading.usable


def test_unreadable_rows_elsewhere_hide_no_gap(tmp_path: Path) -> None:
    """As many rows are missing as hold no number at another place."""
    time, force = pressed()
    summit = time[int(np.argmax(force))]
    gap = (time > summit + 0.05) & (time < summit + 0.07)
    force[20 : 20 + int(gap.sum())] = np.nan
    reading = read_gauge(write(tmp_path / "trick.csv", time[~gap], force[~gap]))
    assert {fault.name: fault.count for fault in reading.faults} == {"unreadable": int(gap.sum()), "gaps": 1}
    # Rows that hold no number are no gaps of their own.
    time, force = pressed()
    force[1000:1100] = np.nan
    reading = read_gauge(write(tmp_path / "rows.csv", time, force))
    assert {fault.name: fault.count for fault in reading.faults} == {"unreadable": 100}


def test_short_gaps_on_a_plateau_near_the_peak_cost_nothing(tmp_path: Path) -> None:
    """A force that stays above 80 % of the peak moves slowly: single rows that are lost hide nothing."""
    time, force = pressed(noise=0.0)
    force = np.where((time > 0.03) & (time < 0.9), np.maximum(force, 120.0), force)
    force = force + 0.3 * np.random.default_rng(2).standard_normal(time.size)
    lost = np.flatnonzero(time > 0.1)[:2000:50]
    reading = read_gauge(write(tmp_path / "plateau.csv", np.delete(time, lost), np.delete(force, lost)))
    assert [(fault.name, fault.count, fault.spoils) for fault in reading.faults] == [("gaps", lost.size, False)]
