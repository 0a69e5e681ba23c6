"""Recordings of gauges: peak force against a closed form, and what cannot be read."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bumpstop.errors import InputError
from bumpstop.measure.reading.gauge_curve import GaugeFormat, load_gauge_curve
from bumpstop.measure.reading.gauge_reading import read_gauge
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


def _half_sine(begin: float, rise: float, *, rate: float = 5000.0, peak: float = 120.0) -> tuple[Array, Array]:
    """A half sine that begins at a time, in a recording that begins at 0 s."""
    time = np.arange(round(rate)) / rate
    return time, peak * np.sin(np.clip((time - begin) * math.pi / 2 / rise, 0, math.pi))


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("rate", [1000.0, 5000.0, 20_000.0])
@pytest.mark.parametrize("rise", [0.006, 0.02, 0.04])
def test_the_rise_is_no_zero(tmp_path: Path, rise: float, rate: float, noise: float) -> None:
    """The zero is known to 1 % of the force, or the recording says that it has too little time before contact."""
    random = np.random.default_rng(3)
    to_a_tenth = math.asin(0.1) * 2 / math.pi * rise
    for begin in np.array([-3, -2, -1, -0.3, 0, 0.2, 0.5, 0.8, 1.5, 5]) * to_a_tenth:
        time, force = _half_sine(begin, rise, rate=rate)
        reading = read_gauge(write(tmp_path / "curve.csv", time, force + noise * random.standard_normal(time.size)))
        # Sampling at 1 kHz costs a clean 6 ms rise (w h)^4 / 128 of the peak, less than 4e-5.
        assert reading.peak_N > 0.99 * 120 - 4 * noise, begin
        assert math.isnan(reading.zero_N) == ("truncated" in {fault.name for fault in reading.faults})
        if begin <= 0:
            assert math.isnan(reading.zero_N)


def test_a_zero_that_nothing_tells_is_named(tmp_path: Path) -> None:
    """Below 0 N before contact the peak is too low: it cannot be relied on, and is a lower bound."""
    for begin, shift, spoils, said in (
        (0.0, 0.0, False, "The recording has too little time before contact: its zero is taken to be 0 N."),
        (-0.003, 0.0, False, "The recording begins in contact, at 28.01 N: what was before is missing."),
        (0.0006, -12.0, True, "The recording has too little time before contact, and shows -12 N: its zero is not"),
        (-0.003, -12.0, True, "The recording begins in contact, at 16.01 N, and shows -12 N: its zero is not known"),
    ):
        time, force = _half_sine(begin, 0.02)
        reading = read_gauge(write(tmp_path / "curve.csv", time, force + shift))
        (fault,) = (each for each in reading.faults if each.name == "truncated")
        assert fault.text.startswith(said)
        assert (fault.spoils, reading.usable) == (spoils, not spoils)
        assert reading.lower_bound_N == pytest.approx(108, rel=1e-3) if spoils else math.isnan(reading.lower_bound_N)


@pytest.mark.parametrize("share", [0.4, 1.0, 2.0])
@pytest.mark.parametrize("lasting", [0.0, 0.5])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_far_zero_is_no_contact(tmp_path: Path, sign: float, lasting: float, share: float) -> None:
    """Afterwards the gauge shows no less: nothing pressed before. Else the bound is what was measured."""
    time, force = _half_sine(0.2, 0.02)
    force = np.where(time > 0.22, np.maximum(force, lasting * 120), force)
    reading = read_gauge(write(tmp_path / "curve.csv", time, sign * (force + share * 120)))
    assert reading.usable
    assert reading.peak_N == pytest.approx(120, rel=1e-3)
    other = read_gauge(write(tmp_path / "curve.csv", time, sign * (force - share * 120)))
    assert (other.peak_N if other.usable else other.lower_bound_N) == pytest.approx(120, rel=1e-3)


@pytest.mark.parametrize(("rebound", "noise"), [(2.0, 0.0), (0.0, 0.4), (0.0, 0.6)])
def test_a_rebound_or_noise_is_no_low_zero(tmp_path: Path, rebound: float, noise: float) -> None:
    """A sample below 0 N after the peak, or within the noise, says nothing of a zero that is not known."""
    for seed in range(5):
        time, force = _half_sine(0.0028, 0.02, rate=1000.0)
        force -= rebound * np.sin(np.clip((time - 0.0428) * math.pi / 0.02, 0, math.pi))
        force += noise * np.random.default_rng(seed).standard_normal(time.size)
        reading = read_gauge(write(tmp_path / "curve.csv", time, np.round(force, 2)))
        assert math.isnan(reading.zero_N)
        assert [(fault.name, fault.spoils) for fault in reading.faults] == [("truncated", False)]
        assert reading.peak_N == pytest.approx(120, abs=3 * noise + 0.1)


@pytest.mark.parametrize("lasting", [0.0, 30.0])
@pytest.mark.parametrize("noise", [0.0, 0.4])
def test_a_low_zero_is_refused_where_two_samples_or_the_end_tell_it(
    tmp_path: Path, noise: float, lasting: float
) -> None:
    for begin in (2 / 660, -0.005):
        time, force = _half_sine(begin, 0.023, rate=660.0, peak=40.0)
        force = np.where(time > begin + 0.023, np.maximum(force, lasting), force) - 12.35
        force += noise * np.random.default_rng(0).standard_normal(time.size)
        reading = read_gauge(write(tmp_path / "curve.csv", time, force))
        # Where the recording begins in contact and stays in it nothing tells the zero.
        assert reading.usable == (begin < 0 and lasting > 0), reading.faults


@pytest.mark.parametrize(("digit", "noise", "shift", "peak"), [(1.0, 0.5, 0.5, 90.0), (2.0, 1.0, -3.0, 150.0)])
def test_a_coarse_digit_leaves_a_long_time_before_contact(
    tmp_path: Path, digit: float, noise: float, shift: float, peak: float
) -> None:
    """The zero lies between two digits: the median of one half may be one of them, and that of all the other."""
    for seed in range(10):
        time, force = _half_sine(0.4, 0.02, rate=1000.0, peak=peak)
        force += shift + noise * np.random.default_rng(seed).standard_normal(time.size)
        reading = read_gauge(write(tmp_path / "curve.csv", time, np.round(force / digit) * digit))
        assert reading.zero_N == pytest.approx(shift, abs=0.25 * digit)
        assert {fault.name for fault in reading.faults} <= {"shifted"}


def test_a_step_of_a_digit_at_rest_leaves_the_zero(tmp_path: Path) -> None:
    """Without noise a slow drift shows as a step of one digit, here 2.5 % of the peak."""
    time, force = _half_sine(0.4, 0.02, rate=1000.0, peak=40.0)
    for step in (0.05, 0.1, 0.145, 0.16, 0.22, 0.3):
        reading = read_gauge(write(tmp_path / "curve.csv", time, np.round(force) + (time > step)))
        assert 0 <= reading.zero_N <= 1, step
        assert reading.usable
