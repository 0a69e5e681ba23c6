"""Rows of recordings: their order, and recordings that stand behind one another in a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bumpstop.errors import InputError
from bumpstop.measure.reading.gauge_reading import read_gauge
from measure.gauge_cases import pressed, write


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
