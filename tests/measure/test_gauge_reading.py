"""Recordings of gauges: peak force against a closed form, and every kind of damage by its name."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bumpstop.errors import InputError
from bumpstop.measure.reading.gauge_curve import GaugeFormat, load_gauge_curve
from bumpstop.measure.reading.gauge_fault import NAMES
from bumpstop.measure.reading.gauge_reading import GaugeReading, read_gauge
from measure.gauge_cases import Array, pressed, sprung_mass, write


@pytest.mark.parametrize("rate", [1000.0, 4000.0, 10_000.0])
@pytest.mark.parametrize(("mass", "stiffness"), [(4.0, 75e3), (12.0, 25e3), (2.0, 10e3)])
def test_peak_is_that_of_a_sprung_mass(tmp_path: Path, mass: float, stiffness: float, rate: float) -> None:
    """The parabola meets a sine to (w h)^4 / 128, which is 1e-6 of it at w h = 0.1."""
    time, force, peak = sprung_mass(mass, stiffness, 0.25, rate=rate)
    reading = read_gauge(write(tmp_path / "curve.csv", time, force))
    wh = np.sqrt(stiffness / mass) / rate
    assert reading.peak_N == pytest.approx(peak, rel=max(1e-6, wh**4 / 100))
    # The highest sample alone would be too low by far more.
    assert abs(reading.sampled_peak_N / peak - 1) <= wh**2 / 8 * 1.01
    assert reading.usable
    assert reading.peak_time == pytest.approx(
        np.pi / 2 * np.sqrt(mass / stiffness), abs=0.03 / np.sqrt(stiffness / mass)
    )


def test_peak_at_10_kHz_is_within_a_millionth(tmp_path: Path) -> None:
    for stiffness in (10e3, 75e3, 150e3):
        time, force, peak = sprung_mass(4.0, stiffness, 0.25, rate=10_000.0)
        assert read_gauge(write(tmp_path / "curve.csv", time, force)).peak_N == pytest.approx(peak, rel=1e-6)


def test_figures_of_a_clamped_contact(tmp_path: Path) -> None:
    time, force = pressed()
    reading = read_gauge(write(tmp_path / "curve.csv", time, force))
    exact = pressed(noise=0.0)[1].max()
    assert reading.peak_N == pytest.approx(exact, abs=1.0)
    assert reading.left_N == pytest.approx(60, abs=0.5)
    assert reading.lasting_N == pytest.approx(60, abs=2.0)
    assert reading.drift_N == pytest.approx(0, abs=0.2)
    assert reading.noise_N == pytest.approx(0.3, rel=0.3)
    assert reading.onset == pytest.approx(0.0, abs=1e-3)
    assert reading.faults == ()


FORMS: dict[str, tuple[str, str, bool, float, float]] = {
    "milliseconds and kilonewtons": ("t_ms,F_kN", ",", False, 1e3, 1e-3),
    "German": ("Zeit [ms];Kraft [N]", ";", True, 1e3, 1.0),
    "pounds, tabs": ("Elapsed time (s)\tLoad (lbf)", "\t", False, 1.0, 1 / 4.4482216152605),
    "microseconds": ("time_us;force_N", ";", False, 1e6, 1.0),
    "units in a line of their own": ("Time;Force\ns;N", ";", False, 1.0, 1.0),
    "text above": ("Device: PRMS 1\nSerial: 4711\nOperator: somebody\nTime [s];Force [N]", ";", False, 1.0, 1.0),
}


@pytest.mark.parametrize("name", FORMS)
def test_every_form_gives_the_same_figures(tmp_path: Path, name: str) -> None:
    header, separator, comma, per_second, per_newton = FORMS[name]
    time, force = pressed()
    plain = read_gauge(write(tmp_path / "plain.csv", time, force))
    path = write(
        tmp_path / "curve.csv", time * per_second, force * per_newton, header, separator=separator, comma=comma
    )
    other = read_gauge(path)
    assert other.peak_N == pytest.approx(plain.peak_N, rel=1e-9)
    assert other.left_N == pytest.approx(plain.left_N, rel=1e-9)
    assert other.faults == ()


def test_rate_told_or_stated(tmp_path: Path) -> None:
    time, force = pressed()
    path = tmp_path / "curve.csv"
    path.write_text("Force [N]\n" + "\n".join(map(repr, force.tolist())) + "\n")
    with pytest.raises(InputError, match=r"time_column: is not found; give it, or the sampling rate"):
        read_gauge(path)
    told = read_gauge(path, GaugeFormat(rate_hz=5000))
    path.write_text("Sampling rate: 5 kHz\nForce [N]\n" + "\n".join(map(repr, force.tolist())) + "\n")
    stated = read_gauge(path)
    whole = read_gauge(write(path, time, force))
    assert told.peak_time == pytest.approx(whole.peak_time, abs=1e-9)
    assert stated.peak_time == pytest.approx(whole.peak_time, abs=1e-9)


def test_columns_told(tmp_path: Path) -> None:
    time, force = pressed()
    rows = [f"{t!r},{f!r},{0.5 * f!r}" for t, f in zip(time.tolist(), force.tolist(), strict=True)]
    path = tmp_path / "curve.csv"
    path.write_text("clock,channel a,channel b\n" + "\n".join(rows) + "\n")
    with pytest.raises(InputError, match=r"force_column: is not found; say which of 'clock', 'channel a'"):
        read_gauge(path)
    with pytest.raises(InputError, match=r"force_unit: column 'channel b' states no unit"):
        read_gauge(path, GaugeFormat(force_column="channel b", time_column="clock", time_unit="s"))
    form = GaugeFormat(force_column="3", time_column="clock", time_unit="s", force_unit="kN")
    reading = read_gauge(path, form)
    assert reading.peak_N == pytest.approx(500 * force.max(), rel=0.02)


def test_pressure(tmp_path: Path) -> None:
    time, force = pressed()
    rows = [f"{t!r};{f!r};{f / 100!r}" for t, f in zip(time.tolist(), force.tolist(), strict=True)]
    path = tmp_path / "curve.csv"
    path.write_text("time_s;force_N;pressure_MPa\n" + "\n".join(rows) + "\n")
    reading = read_gauge(path)
    assert reading.peak_pressure_N_cm2 == pytest.approx(force[time < 0.5].max())
    assert reading.lasting_pressure_N_cm2 == pytest.approx(force[time > 0.501].max(), rel=0.02)


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


def test_every_fault_is_tested() -> None:
    assert {fault for fault, *_ in DAMAGES.values()} == set(NAMES)


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


def test_round_trip_of_a_recording(tmp_path: Path) -> None:
    time, force = pressed()
    first = load_gauge_curve(write(tmp_path / "a.csv", time, force))
    again = load_gauge_curve(write(tmp_path / "b.csv", first.time, first.force, "time_s,force_N", separator=","))
    assert np.array_equal(first.time, again.time)
    assert np.array_equal(first.force, again.force)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "is empty"),
        ("time_s;force_N\n1;2\n", "has 1 samples that can be read; wanted at least 8"),
        ("time_s;force_N\na;b\n", "holds no numbers|has 0 samples"),
        ("time_s;force_N;force2_N\n" + "1;2;3\n" * 9, "may be any of 'force_N', 'force2_N'; say which one"),
        ("time;force_N\n" + "1;2\n" * 9, "column 'time' states no unit of time; give one of s, ms, us"),
    ],
)
def test_bad_files(tmp_path: Path, text: str, problem: str) -> None:
    path = tmp_path / "curve.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=problem):
        read_gauge(path)


@pytest.mark.parametrize(
    ("form", "problem"),
    [
        ({"force_unit": "pound"}, "force_unit: 'pound' is no unit of force"),
        ({"force_column": "fource"}, "force_column: 'fource' is no column; did you mean"),
        ({"time_column": "9"}, "time_column: '9' is no column"),
    ],
)
def test_bad_options(tmp_path: Path, form: dict[str, str], problem: str) -> None:
    path = write(tmp_path / "curve.csv", *pressed())
    with pytest.raises(InputError, match=problem):
        read_gauge(path, replace(GaugeFormat(), **form))  # type: ignore[arg-type]


def test_bad_numbers() -> None:
    with pytest.raises(InputError, match="rate_hz: is -1; wanted a number above zero"):
        GaugeFormat(rate_hz=-1)


def test_garbled_files_are_read_or_refused(tmp_path: Path) -> None:
    """Letters lost, repeated and replaced by chance: figures or an InputError, never anything else."""
    time, force = pressed(rate=500.0)
    whole = write(tmp_path / "whole.csv", time, force, "time_s;force_N").read_text()
    random = np.random.default_rng(1)
    read = 0
    for _ in range(200):
        letters = list(whole)
        for at in random.integers(0, len(letters), random.choice([1, 20, 300])).tolist():
            letters[at] = random.choice(["", ";", "\n", "-", "e9", "1e308", "nan", "ü", "0,1", '"', "12345"])
        path = tmp_path / "garbled.csv"
        path.write_text("".join(letters), encoding="utf-8")
        try:
            read_gauge(path).to_json()
            read += 1
        except InputError:
            pass
    assert read > 50


@pytest.mark.parametrize("as_words", [True, False])
def test_a_peak_that_is_missing_is_not_told(as_words: bool, tmp_path: Path) -> None:
    """Of a device that writes a word beyond its range, or nothing, the highest row is no peak."""
    time, force = pressed(noise=0.1)
    whole = read_gauge(write(tmp_path / "whole.csv", time, force))
    assert whole.usable
    lines = (tmp_path / "whole.csv").read_text().splitlines()
    over = [float(line.split(";")[1]) > 0.7 * whole.peak_N for line in lines[1:]]
    cut = [line for line, away in zip(lines[1:], over, strict=True) if not away]
    if as_words:
        cut = [line.split(";")[0] + ";OVERLOAD" if away else line for line, away in zip(lines[1:], over, strict=True)]
    (tmp_path / "cut.csv").write_text("\n".join([lines[0], *cut]) + "\n")
    found = read_gauge(tmp_path / "cut.csv")
    assert found.peak_N < 0.8 * whole.peak_N
    assert not found.usable
    assert any(fault.name == "gaps" and fault.spoils for fault in found.faults)
    # A row that is lost elsewhere costs nothing.
    (tmp_path / "one.csv").write_text("\n".join(lines[:100] + lines[101:]) + "\n")
    assert read_gauge(tmp_path / "one.csv").usable


def test_pressures_that_cannot_be_read_are_counted(tmp_path: Path) -> None:
    time, force = pressed(noise=0.1)
    pressure = [f"{100 * f / force.max():.3f}" for f in force]
    high = int(np.argmax(force))
    pressure[high - 30 : high + 30] = ["OVER"] * 60
    rows = [f"{t!r};{f!r};{p}" for t, f, p in zip(time.tolist(), force.tolist(), pressure, strict=True)]
    (tmp_path / "p.csv").write_text("\n".join(["Time [s];Force [N];Pressure [N/cm2]", *rows]) + "\n")
    found = read_gauge(tmp_path / "p.csv")
    assert 50 < found.peak_pressure_N_cm2 < 100
    assert [fault.count for fault in found.faults if "pressures are no number" in fault.text] == [60]
    rows = [f"{t!r};{f!r};OVER" for t, f in zip(time.tolist(), force.tolist(), strict=True)]
    (tmp_path / "p.csv").write_text("\n".join(["Time [s];Force [N];Pressure [N/cm2]", *rows]) + "\n")
    assert math.isnan(read_gauge(tmp_path / "p.csv").peak_pressure_N_cm2)


def test_columns_of_one_name_are_told_by_their_number(tmp_path: Path) -> None:
    time, force = pressed(noise=0.1)
    rows = [f"{t!r};{f / 10!r};{f!r}" for t, f in zip(time.tolist(), force.tolist(), strict=True)]
    path = tmp_path / "two.csv"
    path.write_text("\n".join(["Time [s];Force [N];Force [N]", *rows]) + "\n")
    second, third = (read_gauge(path, GaugeFormat(force_column=number)).peak_N for number in ("2", "3"))
    assert third == pytest.approx(10 * second)
    for column, said in (
        (None, "may be any of 'Force \\[N\\]'"),
        ("force", "may be any of columns 2, 3; give its number"),
    ):
        with pytest.raises(InputError, match=said):
            read_gauge(path, GaugeFormat(force_column=column))
