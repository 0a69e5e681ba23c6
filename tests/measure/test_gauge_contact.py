"""Which contact of a recording is the collision: touches before it, bounces, and second collisions."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from bumpstop.measure.reading.gauge_reading import read_gauge
from measure.gauge_cases import Array, write

NOISE_N = 0.2


def _bump(time: Array, begin: float, duration: float, height: float) -> Array:
    within = np.clip((time - begin) / duration, 0, 1)
    return height * np.sin(np.pi * within) * (within < 1)


def _recording(*bumps: tuple[float, float, float]) -> tuple[Array, Array]:
    """A contact at 0 s with 98 N that keeps a force until 1.5 s, and others (begin, duration, height)."""
    time = np.arange(-6, 4, 1e-3)
    force = np.maximum(_bump(time, 0, 0.035, 98.0), 50 * ((time > 0.02) & (time < 1.5)))
    for bump in bumps:
        force = np.maximum(force, _bump(time, *bump))
    return time, force + NOISE_N * np.random.default_rng(5).standard_normal(time.size)


@pytest.mark.parametrize(
    ("touches", "often", "before", "most"),
    [
        ([(-2.0, 0.1, 15.0)], "once", 2.0, 15.0),
        ([(-0.7, 0.06, 8.0)], "once", 0.7, 8.0),
        ([(-0.3, 0.06, 8.0)], "once", 0.3, 8.0),
        ([(-0.49, 0.06, 8.0)], "once", 0.49, 8.0),
        ([(-5.0, 1.0, 20.0), (-3.0, 0.004, 9.0)], "2 times", 3.0, 20.0),
    ],
)
def test_a_touch_is_no_collision(
    tmp_path: Path, touches: list[tuple[float, float, float]], often: str, before: float, most: float
) -> None:
    whole = read_gauge(write(tmp_path / "whole.csv", *_recording()))
    reading = read_gauge(write(tmp_path / "touched.csv", *_recording(*touches)))
    assert whole.faults == ()
    (fault,) = reading.faults
    assert (fault.name, fault.count, fault.repaired) == ("touched", len(touches), True)
    text = (
        r"The gauge was touched (.*) before the collision, last (.*) s before, with (.*) N at most: that was left out\."
    )
    said = re.fullmatch(text, fault.text)
    assert said is not None, fault.text
    assert said[1] == often
    assert float(said[2]) == pytest.approx(before, abs=0.06)
    assert float(said[3]) == pytest.approx(most, abs=4 * NOISE_N)
    assert reading.usable
    for name in ("peak_N", "lasting_N", "left_N", "peak_time", "onset"):
        assert getattr(reading, name) == pytest.approx(getattr(whole, name), rel=1e-3, abs=1e-4), name


def test_a_harder_second_impact_of_one_collision_is_its_peak(tmp_path: Path) -> None:
    """The gauge is free for a while between both: the first phase begins with the first."""
    reading = read_gauge(write(tmp_path / "bounce.csv", *_recording((-0.2, 0.035, 60.0))))
    assert reading.peak_N == pytest.approx(98, abs=4 * NOISE_N)
    assert reading.onset == pytest.approx(-0.2, abs=1e-3)
    assert reading.faults == ()


@pytest.mark.parametrize("begin", [-3.0, -0.6])
def test_two_collisions_are_not_taken_for_one(tmp_path: Path, begin: float) -> None:
    reading = read_gauge(write(tmp_path / "twice.csv", *_recording((begin, 0.035, 60.0))))
    assert reading.peak_N == pytest.approx(98, abs=4 * NOISE_N)
    (fault,) = reading.faults
    assert (fault.name, fault.count, fault.spoils) == ("several", 2, True)
    assert re.match(r"The gauge was hit with (60|59\.)", fault.text)
    assert f" N {-begin:.3g} s later: it is not known which collision counts." in fault.text


def test_a_weaker_collision_later_changes_nothing(tmp_path: Path) -> None:
    reading = read_gauge(write(tmp_path / "later.csv", *_recording((2.5, 0.035, 60.0))))
    assert reading.onset == pytest.approx(0, abs=1e-3)
    assert reading.usable
    whole = read_gauge(write(tmp_path / "whole.csv", *_recording()))
    assert (reading.lasting_N, reading.left_N) == (whole.lasting_N, whole.left_N)
    (fault,) = reading.faults
    assert (fault.name, fault.count) == ("anew", 1)
    assert "pressed anew 2.5 s after the beginning of contact, with 60" in fault.text
    assert read_gauge(write(tmp_path / "soft.csv", *_recording((2.5, 0.035, 20.0)))).faults == ()


def test_nothing_is_left_of_a_contact_that_another_follows(tmp_path: Path) -> None:
    time = np.arange(-1, 3, 1e-3)
    force = _bump(time, 0, 0.035, 98.0) + _bump(time, 0.7, 0.035, 90.0)
    reading = read_gauge(write(tmp_path / "two.csv", time, force))
    assert (reading.peak_N, reading.lasting_N, reading.left_N) == pytest.approx((98, 0, 0), abs=0.1)
    assert np.isnan(reading.pressing_N)
    assert [fault.name for fault in reading.faults] == ["anew"]


def test_an_arm_that_bounces_and_presses_is_one_contact(tmp_path: Path) -> None:
    time = np.arange(-1, 3, 1e-3)
    force = _bump(time, 0, 0.035, 98.0) + 70 * ((time > 0.3) & (time < 2))
    reading = read_gauge(write(tmp_path / "bounce.csv", time, force))
    assert (reading.lasting_N, reading.left_N, reading.pressing_N) == (70, 70, 70)


def test_a_collision_after_a_lasting_load_is_not_told(tmp_path: Path) -> None:
    """The gauge is never free before the collision: its first half second shows the load alone."""
    time, force = _recording()
    force = np.maximum(force, 15 * np.clip((time + 3) / 0.01, 0, 1) * (time < 0.01))
    reading = read_gauge(write(tmp_path / "loaded.csv", time, force))
    (fault,) = (each for each in reading.faults if each.spoils)
    assert fault.name == "late"
    assert fault.text.startswith("The highest force, 98")
    assert "comes 3.02 s after the beginning of contact, which shows 15" in fault.text


@pytest.mark.parametrize("rise", [2.0, 3.0])
def test_a_slow_press_is_told_and_counts(tmp_path: Path, rise: float) -> None:
    """Its force of the first half second is that of the first phase, however high it gets later."""
    time = np.arange(-0.5, 4.0, 1e-3)
    force = 60 * (1 - np.cos(np.pi * np.clip(time / rise, 0, 1)))
    reading = read_gauge(write(tmp_path / "press.csv", time, force))
    assert reading.usable
    (fault,) = (each for each in reading.faults if each.name == "late")
    assert fault.text.endswith("the gauge was pressed slowly.")
    assert reading.lasting_N == pytest.approx(120, rel=1e-3)
    assert reading.peak_N < 40
