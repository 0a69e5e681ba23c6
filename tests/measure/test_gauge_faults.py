"""Faults of recordings of gauges: every kind of damage by its name."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bumpstop.measure.reading.gauge_curve import GaugeFormat
from bumpstop.measure.reading.gauge_fault import NAMES
from bumpstop.measure.reading.gauge_reading import GaugeReading, read_gauge
from measure.gauge_cases import Array, pressed, sprung_mass, write


def _with_pressure(path: Path, pressure: Array) -> GaugeReading:
    time, force = pressed()
    rows = zip(time.tolist(), force.tolist(), pressure.tolist(), strict=True)
    path.write_text("time_s;force_N;pressure_N_cm2\n" + "".join(f"{t!r};{f!r};{p!r}\n" for t, f, p in rows))
    return read_gauge(path)


@pytest.mark.parametrize("digit", [1e-9, 0.1, 1.0])
@pytest.mark.parametrize("held", [1, 10, 50])
@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_a_saturated_pressure_sensor_is_named(tmp_path: Path, noise: float, held: int, digit: float) -> None:
    """The peak force counts all the same. A sensor that is slower than the gauge, or has few digits, is none."""
    smooth = pressed(noise=noise, seed=1)[1] / 3
    slow = smooth[(np.arange(smooth.size) // held) * held]
    whole = np.round(slow / digit) * digit
    assert _with_pressure(tmp_path / "whole.csv", whole).faults == ()
    if digit == 1:
        return  # of 30 digits: the last eight below the top are no sharper than those of a smooth peak
    whole[3000:3010] = np.nan
    cut = np.minimum(whole, 30.0)
    reading = _with_pressure(tmp_path / "cut.csv", cut)
    fault = next(each for each in reading.faults if each.name == "saturated")
    stands = int((cut == 30).sum())
    assert (fault.count, fault.spoils, reading.usable) == (stands, False, True)
    assert fault.text == f"{stands} pressures stand at 30 N/cm²: the highest pressure is at least what is told."


def test_a_gauge_cannot_show_more_than_its_range(tmp_path: Path) -> None:
    """Told or stated in the file, pressing or pulling: the range or the unit is wrong."""
    time, force = pressed()
    path = write(tmp_path / "curve.csv", time, force)
    highest = force.max()
    said = f"A force of {highest:.4g} N is beyond the device's range of 100 N: the range or the unit of force, 'N', is"
    stated = tmp_path / "stated.csv"
    stated.write_text("Range: 0.1 kN\n" + path.read_text())
    pulled = write(tmp_path / "pulled.csv", time, -force)
    for reading in (
        read_gauge(path, GaugeFormat(full_scale_N=100)),
        read_gauge(stated),
        read_gauge(pulled, GaugeFormat(full_scale_N=100)),
    ):
        (fault,) = (each for each in reading.faults if each.name == "wrong_unit")
        assert fault.text.startswith(said)
        assert not reading.usable
    # Devices are read a little beyond the end of their range.
    assert read_gauge(path, GaugeFormat(full_scale_N=highest / 1.01)).faults == ()


def _bump(time: Array, begin: float, duration: float) -> Array:
    """Half a sine of height 1."""
    within = (time > begin) & (time < begin + duration)
    return np.where(within, np.sin(np.pi * np.clip((time - begin) / duration, 0, 1)), 0.0)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_noise_hides_no_end_of_the_range(tmp_path: Path, sign: float, seed: int) -> None:
    """Of an amplifier that is at its end the samples still scatter."""
    time, force = pressed(noise=0.0)
    cut = np.minimum(force, 100) + 0.05 * np.random.default_rng(seed).standard_normal(time.size)
    reading = read_gauge(write(tmp_path / "cut.csv", time, sign * cut), GaugeFormat(full_scale_N=100))
    (fault,) = (each for each in reading.faults if each.spoils)
    assert fault.name == "saturated"
    assert 0.9 * (force >= 100).sum() < fault.count <= (np.abs(cut) >= 99.9).sum()
    # The same peak within a wider range is smooth.
    assert read_gauge(write(tmp_path / "whole.csv", time, force), GaugeFormat(full_scale_N=force.max() + 1)).usable


@pytest.mark.parametrize("rate", [500.0, 1000.0, 20_000.0])
def test_seconds_called_milliseconds_are_noticed_however_long(tmp_path: Path, rate: float) -> None:
    time, force = pressed(rate=rate, after=12.0)
    reading = read_gauge(write(tmp_path / "ms.csv", time, force), GaugeFormat(time_unit="ms"))
    assert any(fault.name == "wrong_unit" and "unit of time" in fault.text for fault in reading.faults)
    assert not reading.usable


def test_a_hundred_thousand_samples_in_a_second_are_read(tmp_path: Path) -> None:
    time, force = pressed(rate=100_000.0, after=0.6)
    assert read_gauge(write(tmp_path / "fast.csv", np.round(time, 5), force)).usable


Damage = Callable[[Array, Array], tuple[Array, Array]]


def _resampled(time: Array, force: Array) -> tuple[Array, Array]:
    every = np.arange(0, time.size, 10)
    return time, np.interp(time, time[every], force[every])


def _held(time: Array, force: Array) -> tuple[Array, Array]:
    return time, force[(np.arange(time.size) // 10) * 10]


DAMAGES: dict[str, tuple[str, bool, Damage, GaugeFormat]] = {
    "saturated": ("saturated", True, lambda t, f: (t, np.minimum(f, 90)), GaugeFormat()),
    "saturated at its range": ("saturated", True, lambda t, f: (t, np.minimum(f, 100)), GaugeFormat(full_scale_N=100)),
    "clipped below its range": ("clipped", True, lambda t, f: (t, np.minimum(f, 90)), GaugeFormat(full_scale_N=500)),
    "beyond its range": ("wrong_unit", True, lambda t, f: (t, f), GaugeFormat(full_scale_N=100)),
    "clipped at zero": ("clipped", False, lambda t, f: (t, np.maximum(f, 0)), GaugeFormat()),
    "shifted": ("shifted", False, lambda t, f: (t, f + 12.0), GaugeFormat()),
    "inverted": ("inverted", False, lambda t, f: (t, -f), GaugeFormat()),
    "coarse": ("coarse", True, lambda t, f: (t[::60], f[::60]), GaugeFormat()),
    "resampled along straight lines": ("resampled", False, _resampled, GaugeFormat()),
    "resampled by holding": ("resampled", False, _held, GaugeFormat()),
    "truncated at its peak": (
        "truncated",
        True,
        lambda t, f: (t[: f.argmax() + 1], f[: f.argmax() + 1]),
        GaugeFormat(),
    ),
    "truncated at its begin": ("truncated", True, lambda t, f: (t[t > 0.01], f[t > 0.01]), GaugeFormat()),
    "truncated after 0.2 s": ("truncated", False, lambda t, f: (t[t < 0.2], f[t < 0.2]), GaugeFormat()),
    "milliseconds called seconds": ("wrong_unit", True, lambda t, f: (1e3 * t, f), GaugeFormat()),
    "seconds called milliseconds": ("wrong_unit", True, lambda t, f: (t, f), GaugeFormat(time_unit="ms")),
    "kilonewtons called newtons": ("wrong_unit", True, lambda t, f: (t, f / 1e3), GaugeFormat()),
    "newtons called kilonewtons": ("wrong_unit", True, lambda t, f: (t, f), GaugeFormat(force_unit="kN")),
    "time for force": ("wrong_column", True, lambda t, f: (t, t + 1), GaugeFormat()),
    "force for time": ("wrong_column", True, lambda t, f: (f, t), GaugeFormat()),
    "an empty channel": ("wrong_column", True, lambda t, f: (t, 0 * f), GaugeFormat()),
    "an integral": ("wrong_column", True, lambda t, f: (t, np.cumsum(np.abs(f))), GaugeFormat()),
    "a spike": ("spike", True, lambda t, f: (t, np.where(np.arange(t.size) == 900, 900.0, f)), GaugeFormat()),
    "drift": ("drift", False, lambda t, f: (t, f + 8 * (t > 0.4)), GaugeFormat()),
    "backward": ("backward", False, lambda t, f: (np.roll(t, 500), np.roll(f, 500)), GaugeFormat()),
    "repeated": ("repeated", False, lambda t, f: (np.repeat(t, 2), np.repeat(f, 2)), GaugeFormat()),
    "gaps": (
        "gaps",
        False,
        lambda t, f: (np.delete(t, slice(3000, 3100)), np.delete(f, slice(3000, 3100))),
        GaugeFormat(),
    ),
    "touched before": ("touched", False, lambda t, f: (t, f + 15 * _bump(t, -1.0, 0.1)), GaugeFormat()),
    "hit twice": ("several", True, lambda t, f: (t, f + 70 * _bump(t, -1.0, 0.03)), GaugeFormat()),
    "pressed anew": ("anew", False, lambda t, f: (t, f + 40 * (t > t[-1] - 0.2)), GaugeFormat()),
    "loaded before": ("late", True, lambda t, f: (t, f + 20 * _bump(t, -1.5, 3.0) * (t < 0.01)), GaugeFormat()),
    "uneven": ("uneven", False, lambda t, f: (t + 7e-5 * np.sin(np.arange(t.size)), f), GaugeFormat()),
    "unreadable": (
        "unreadable",
        False,
        lambda t, f: (t, np.where(np.arange(t.size) % 97 == 5, np.nan, f)),
        GaugeFormat(),
    ),
}


def damaged(tmp_path: Path, name: str) -> GaugeReading:
    fault, _, damage, form = DAMAGES[name]
    noise = 0.0 if "resampled along" in name else 0.3
    time, force = pressed(noise=noise)
    if fault in ("touched", "several", "late"):
        time, force = _waiting(time, force)
    return read_gauge(write(tmp_path / "curve.csv", *damage(time, force)), form)


def _waiting(time: Array, force: Array) -> tuple[Array, Array]:
    """A recording with two seconds more before contact."""
    step = time[1] - time[0]
    ahead = time[0] - step * np.arange(round(2 / step), 0, -1)
    return np.append(ahead, time), np.append(0.3 * np.random.default_rng(9).standard_normal(ahead.size), force)


@pytest.mark.parametrize("name", DAMAGES)
def test_damage_is_named_and_counted(tmp_path: Path, name: str) -> None:
    fault, spoils, _, _ = DAMAGES[name]
    reading = damaged(tmp_path, name)
    found = {each.name: each for each in reading.faults}
    assert fault in found, reading.faults
    assert found[fault].count > 0
    assert found[fault].text.endswith(".")
    assert reading.usable is not spoils, reading.faults


def test_what_hides_the_peak_leaves_a_lower_bound(tmp_path: Path) -> None:
    """Of a recording with a wrong unit or column, a spike or several collisions nothing is known."""
    time, force = pressed()
    peak = read_gauge(write(tmp_path / "whole.csv", time, force)).peak_N
    bounds = {name: damaged(tmp_path, name).lower_bound_N for name, (_, spoils, *_) in DAMAGES.items() if spoils}
    known = {name: bound for name, bound in bounds.items() if not math.isnan(bound)}
    assert set(known) == {
        *("saturated", "saturated at its range", "clipped below its range", "coarse"),
        *("truncated at its peak", "truncated at its begin"),
    }
    assert all(0.5 * peak < bound < 1.01 * peak for bound in known.values()), known
    assert known["saturated"] == pytest.approx(90, abs=0.5)
    assert math.isnan(read_gauge(tmp_path / "whole.csv").lower_bound_N)


def test_every_fault_is_tested() -> None:
    # That of the pressure alone: test_gauge_pressure.
    assert {fault for fault, *_ in DAMAGES.values()} | {"no_pressure"} == set(NAMES)


@pytest.mark.parametrize("name", ["shifted", "inverted", "repeated", "backward", "unreadable"])
def test_what_is_repaired_gives_the_same_peak(tmp_path: Path, name: str) -> None:
    time, force = pressed()
    whole = read_gauge(write(tmp_path / "whole.csv", time, force))
    reading = damaged(tmp_path, name)
    assert reading.peak_N == pytest.approx(whole.peak_N, rel=5e-3)
    assert reading.left_N == pytest.approx(whole.left_N, rel=5e-3)


def test_counts(tmp_path: Path) -> None:
    assert {f.name: f.count for f in damaged(tmp_path, "unreadable").faults} == {"unreadable": 65}
    assert {f.name: f.count for f in damaged(tmp_path, "repeated").faults} == {"repeated": 6250}
    assert [f.count for f in damaged(tmp_path, "resampled by holding").faults if f.name == "resampled"] == [10]
    assert [f.count for f in damaged(tmp_path, "resampled along straight lines").faults] == [10]


@pytest.mark.parametrize("digits", [1, 2, 6])
@pytest.mark.parametrize("every", [3, 7, 25])
def test_straight_lines_are_seen_in_what_a_device_writes(tmp_path: Path, every: int, digits: int) -> None:
    """With noise, and rounded to the digits of the file."""
    time, force = pressed(noise=0.5 if digits == 1 else 0.3)
    lines = np.round(np.interp(time, time[::every], force[::every]), digits)
    reading = read_gauge(write(tmp_path / "curve.csv", time, lines))
    assert [f.count for f in reading.faults if f.name == "resampled"] == [every], reading.faults


@pytest.mark.parametrize("digits", [0, 1, 2, 9])
@pytest.mark.parametrize("noise", [0.0, 0.05, 0.3])
def test_whole_curves_are_not_called_resampled(tmp_path: Path, noise: float, digits: int) -> None:
    """Smooth, with a kink where contact begins, and with few digits."""
    curves = [pressed(noise=noise, rate=rate) for rate in (1000.0, 5000.0)]
    for mass in (0.6, 8.0):
        time, force, _ = sprung_mass(mass, 60e3, 0.25, rate=5000.0)
        curves.append((time, force + noise * np.random.default_rng(1).standard_normal(time.size)))
    for time, force in curves:
        reading = read_gauge(write(tmp_path / "curve.csv", time, np.round(force, digits)))
        assert "resampled" not in {fault.name for fault in reading.faults}, reading.faults


@pytest.mark.parametrize("digit", [1.0, 0.1])
@pytest.mark.parametrize("noise", [0.0, 0.2])
@pytest.mark.parametrize("slow", [15.0, 150.0])
@pytest.mark.parametrize("lasting", [0.0, 45.0, 100.0])
def test_a_cut_peak_is_told_from_a_smooth_one(
    digit: float, noise: float, slow: float, lasting: float, tmp_path: Path
) -> None:
    """A plateau after the impact has equal samples, too: it says nothing of the peak."""
    time = np.arange(-0.1, 1.5, 5e-4)
    fall = lasting + (1 - lasting / 320) * 320 * np.exp(-((np.maximum(time * slow - np.pi / 2, 0)) ** 2) / 2)
    force = np.where(time < 0, 0.0, np.where(time < np.pi / 2 / slow, 320 * np.sin(slow * time), fall))
    force = np.round((force + noise * np.random.default_rng(1).standard_normal(time.size)) / digit) * digit
    for curve, form, expected in (
        (force, GaugeFormat(), False),
        (np.minimum(force, 200.0), GaugeFormat(), True),
        (np.minimum(force, 310.0), GaugeFormat(full_scale_N=310.0), True),
    ):
        names = {fault.name for fault in read_gauge(write(tmp_path / "x.csv", time + 0.1, curve), form).faults}
        assert ("saturated" in names) == expected, (names, form)


def test_a_saturated_plateau_is_not_called_cut_off_below(tmp_path: Path) -> None:
    """The median of a contact that lasts is the plateau itself."""
    time, force = pressed()
    force = np.where((time > 0) & (time < 0.9), force + 40, force)
    reading = read_gauge(write(tmp_path / "curve.csv", time, np.minimum(force, 60.0)))
    assert [fault.name for fault in reading.faults if fault.name in ("saturated", "clipped")] == ["saturated"]


def test_a_recording_that_never_leaves_contact_is_not_called_cut_off_below(tmp_path: Path) -> None:
    """Its lowest samples are far above any baseline."""
    time = np.arange(0, 1, 2e-4)
    force = 60 + 30 * np.maximum(np.sin(40 * time), -0.5)
    reading = read_gauge(write(tmp_path / "curve.csv", time, force))
    assert "clipped" not in {fault.name for fault in reading.faults}


def test_swapped_columns_are_named_and_nothing_else(tmp_path: Path) -> None:
    time, force = pressed()
    (fault,) = read_gauge(write(tmp_path / "curve.csv", force, time)).faults
    assert fault.text.startswith("Column 'Time [s]' goes back ")
    assert fault.text.endswith(" times: it is no time.")


def test_a_recording_that_begins_in_contact_can_be_told_as_json(tmp_path: Path) -> None:
    time, force = pressed()
    for begin, spoils in ((0.003, False), (0.02, True)):
        reading = read_gauge(write(tmp_path / "cut.csv", time[time > begin], force[time > begin]))
        told = json.loads(json.dumps(reading.to_json(), allow_nan=False))["faults"]
        assert [each["spoils"] for each in told if "begins in contact" in each["text"]] == [spoils]
