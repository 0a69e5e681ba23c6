"""The zero of a gauge is that shortly before contact, and one that moves is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bumpstop.measure.reading.gauge_reading import GaugeReading, read_gauge
from measure.gauge_cases import Array, write

NOISE_N = 0.2


def _recording(*, rate: float = 1000.0, before: float = 5.0) -> tuple[Array, Array]:
    """98 N at 17.5 ms, 50 N until 1.2 s."""
    time = np.arange(round((before + 1.6) * rate)) / rate - before
    pulse = 98 * np.sin(np.pi * np.clip(time / 0.035, 0, 1))
    force = np.where(time < 1.2, np.maximum(pulse, 50.0 * (time > 0.02)), 0.0)
    return time, force + NOISE_N * np.random.default_rng(3).standard_normal(time.size)


def _drifts(reading: GaugeReading) -> list[tuple[float, bool]]:
    """How far the zero moves before contact, and whether that spoils."""
    return [
        (float(fault.text.split(" by ")[1].split(" N ")[0]), fault.spoils)
        for fault in reading.faults
        if fault.name == "drift" and "before contact" in fault.text
    ]


@pytest.mark.parametrize("rate", [4.0, 2.0, 1.0, -1.0, -2.0, -4.0])
def test_a_drifting_zero_is_that_of_the_last_moments(tmp_path: Path, rate: float) -> None:
    """From the middle of the last 0.2 s to the peak it is 0.12 s."""
    time, force = _recording(before=3.0)
    reading = read_gauge(write(tmp_path / "d.csv", time, force + rate * (time + 3)))
    assert reading.peak_N == pytest.approx(98, abs=0.12 * abs(rate) + 3 * NOISE_N)
    assert reading.zero_N == pytest.approx(2.9 * rate, abs=0.2)
    ((moved, spoils),) = _drifts(reading)
    assert moved == pytest.approx(2.8 * rate, abs=0.2)
    # More than a tenth of the peak may be a load.
    assert spoils == (rate == 4)
    assert reading.usable != spoils


@pytest.mark.parametrize("step", [12.0, 4.0, -4.0, -12.0])
@pytest.mark.parametrize("at", [-4.0, -2.0, -0.7])
def test_a_zero_that_steps(tmp_path: Path, at: float, step: float) -> None:
    """What steps up and stays for longer than the first phase may be a load, and spoils."""
    time, force = _recording()
    reading = read_gauge(write(tmp_path / "s.csv", time, force + step * (time > at)))
    if reading.usable:
        assert reading.peak_N == pytest.approx(98, abs=3 * NOISE_N)
        assert _drifts(reading) == [(pytest.approx(step, abs=0.1), False)]
    else:
        assert step == 12
        assert {"late", "drift"} & {fault.name for fault in reading.faults if fault.spoils}


def test_a_load_that_creeps_is_no_zero(tmp_path: Path) -> None:
    time, force = _recording()
    load = 20 * np.sin(np.pi / 2 * np.clip((time + 1.5) / 1.5, 0, 1)) * (time < 1.2)
    reading = read_gauge(write(tmp_path / "l.csv", time, force + load))
    assert any(fault.name == "drift" and fault.text.endswith("but it may be a load.") for fault in reading.faults)
    assert not reading.usable


def test_a_zero_that_moves_shortly_before_contact_spoils(tmp_path: Path) -> None:
    time, force = _recording()
    reading = read_gauge(write(tmp_path / "s.csv", time, force - 5 * (time > -0.08)))
    assert (-5.0, True) in [(round(moved), spoils) for moved, spoils in _drifts(reading)]
    assert not reading.usable


@pytest.mark.parametrize("before", [0.012, 0.05, 0.3, 30.0])
@pytest.mark.parametrize("noise", [0.0, 0.5, 2.0, 4.0])
def test_noise_moves_no_zero(tmp_path: Path, noise: float, before: float) -> None:
    for seed in range(3):
        time, force = _recording(before=before)
        force = force + noise * np.random.default_rng(seed).standard_normal(time.size)
        reading = read_gauge(write(tmp_path / "n.csv", time, force))
        assert _drifts(reading) == []


def test_hum_moves_no_zero(tmp_path: Path) -> None:
    time, force = _recording(before=1.0)
    reading = read_gauge(write(tmp_path / "h.csv", time, force + 2 * np.sin(2 * np.pi * 50 * time)))
    assert reading.faults == ()
