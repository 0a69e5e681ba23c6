"""Rows of recordings: their order and times, second recordings in a file, and samples that are missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bumpstop.errors import InputError
from bumpstop.measure.reading.gauge_reading import GaugeReading, read_gauge
from measure.gauge_cases import Array, pressed, sprung_mass, write


@pytest.mark.parametrize("later", [0.0, 1e-4, -0.3, 0.4])
def test_a_second_recording_in_a_file_is_refused(tmp_path: Path, later: float) -> None:
    """At the same times its rows were dropped, at others they were sorted between those of the first."""
    time, force = pressed(rate=2000.0)
    other = time + later
    path = write(tmp_path / "two.csv", np.append(time, other), np.append(force, 1.5 * force))
    said = f"row {time.size + 1}: goes back in time from .* s to .* s: a second recording begins; wanted one recording;"
    with pytest.raises(InputError, match=said):
        read_gauge(path)
    rows = path.read_text().splitlines()
    half = time.size + 1
    path.write_text("\n".join([*rows[:half], "Shot 2", rows[0], *rows[half:]]) + "\n")
    with pytest.raises(InputError, match=said.replace(str(half), str(half + 2))):
        read_gauge(path)


def test_rows_in_another_order_are_sorted(tmp_path: Path) -> None:
    """Of a ring buffer that is read from its middle, of rows that are written late, and of a summary at the end."""
    time, force = pressed(rate=2000.0)
    whole = read_gauge(write(tmp_path / "whole.csv", time, force))
    size = time.size
    late = np.r_[0:500, 520:900, 500:520, 900:size]
    for order in (np.roll(np.arange(size), 900), late):
        reading = read_gauge(write(tmp_path / "order.csv", time[order], force[order]))
        assert reading.peak_N == whole.peak_N
        assert [fault.name for fault in reading.faults] == ["backward"]
    reading = read_gauge(write(tmp_path / "end.csv", np.append(time, 0.0), np.append(force, 999.0)))
    assert reading.peak_N == pytest.approx(whole.peak_N, rel=1e-3)


@pytest.mark.parametrize(("unit", "per_second"), [("s", 1.0), ("ms", 1e3), ("us", 1e6)])
def test_times_of_the_clock_are_read(tmp_path: Path, unit: str, per_second: float) -> None:
    """Seconds since 1970, and a row whose time no clock shows."""
    time, force = pressed(rate=2000.0)
    whole = read_gauge(write(tmp_path / "whole.csv", time, force))
    clock = (1.7e9 + time) * per_second
    clock[100] = 1e300
    reading = read_gauge(write(tmp_path / "clock.csv", clock, force, f"Time [{unit}];Force [N]"))
    assert reading.peak_N == pytest.approx(whole.peak_N, rel=1e-4)
    assert reading.peak_time == pytest.approx(whole.peak_time, abs=1e-5)
    assert {fault.name: fault.count for fault in reading.faults} == {"unreadable": 1}


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
