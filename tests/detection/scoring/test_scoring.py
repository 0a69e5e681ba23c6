"""Events against labels: every rule by a planted case."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.detection import (
    Detector,
    Label,
    ResidualSeries,
    Tolerance,
    event_times,
    load_labels,
    roc,
    scaled_residual,
    score,
)
from detection.moving_arms import UR5E, moving

LABELS = (Label(10, 11, "hand"), Label(20, 22, "elbow"), Label(30, 30.5))


def scored(events: list[float], **given: object) -> dict[str, object]:
    arguments: dict[str, object] = {"labels": LABELS, "monitored": (0.0, 3600.0)} | given
    return score(events, **arguments).to_json()  # type: ignore[arg-type]


def test_plain() -> None:
    found = scored([10.1, 20.3, 100.0])
    assert (found["detected"], found["missed"], found["false_alarms"]) == (2, 1, 1)
    assert found["false_alarm_times_s"] == [100.0]
    delay = found["delay_s"]
    assert isinstance(delay, dict)
    assert delay == {
        key: pytest.approx(value)
        for key, value in zip(("mean", "p50", "p95", "max"), (0.2, 0.1, 0.3, 0.3), strict=True)
    }
    # Three labels of 1, 2 and 0.5 s, each with 0.3 s of tolerance.
    assert found["hours"] == pytest.approx((3600 - 3.5 - 0.9) / 3600)
    assert found["false_alarms_per_hour"] == pytest.approx(3600 / 3595.6)
    assert found["kinds"] == {
        "hand": {"detected": 1, "missed": 0},
        "elbow": {"detected": 1, "missed": 0},
        "unnamed": {"detected": 0, "missed": 1},
    }


def test_several_events_in_a_label_count_once() -> None:
    found = scored([20.9, 20.2, 21.5, 22.1])
    assert (found["detected"], found["repeated"], found["false_alarms"]) == (1, 3, 0)
    assert found["delay_s"]["max"] == pytest.approx(0.2)  # type: ignore[index]


@pytest.mark.parametrize(
    ("event", "detected"), [(9.949, False), (9.951, True), (11.249, True), (11.251, False), (10.0, True), (11.0, True)]
)
def test_tolerance(event: float, detected: bool) -> None:
    found = scored([event])
    assert (found["detected"], found["false_alarms"]) == ((1, 0) if detected else (0, 1))
    if detected:
        assert found["delay_s"]["mean"] == pytest.approx(event - 10)  # type: ignore[index]
    assert scored([event], tolerance=Tolerance(0.2, 0.5))["detected"] == 1


def test_a_delay_of_rounding_is_none() -> None:
    """A row's time and a label's that are the same figure may differ in the last digits."""
    start = 0.1 + 0.2  # 0.30000000000000004
    found = score([start], (Label(0.3, 1.0),), (0, 10))
    assert start != 0.3
    assert found.delay_s.tolist() == [0.0]
    assert "delay, ms: mean 0," in str(found)
    # An event before its label keeps its sign.
    assert score([0.29], (Label(0.3, 1.0),), (0, 10)).delay_s.tolist() == [-0.01]


def test_event_between_two_labels_belongs_to_the_nearer() -> None:
    close = (Label(10, 11), Label(11.1, 12))
    wide = Tolerance(0.5, 0.5)
    first = score([11.04], close, (0, 100), tolerance=wide)
    assert np.isfinite(first.delay_s).tolist() == [True, False]
    second = score([11.06], close, (0, 100), tolerance=wide)
    assert np.isfinite(second.delay_s).tolist() == [False, True]
    # Inside one label it is that one's, however wide the tolerance of the other.
    assert np.isfinite(score([11.1], close, (0, 100), tolerance=wide).delay_s).tolist() == [False, True]


def test_time_without_data_costs_misses_and_hours() -> None:
    found = scored([10.1], no_data=[(19.5, 23.0), (22.5, 24.0), (3590.0, 4000.0)])
    assert (found["detected"], found["missed"], found["missed_without_data"]) == (1, 2, 1)
    assert found["no_data_s"] == pytest.approx(4.5 + 10)
    # Two labels and their tolerance lie outside time without data, the third inside.
    assert found["hours"] == pytest.approx((3600 - 14.5 - 1.3 - 0.8) / 3600)
    # An event in a label that was partly without data is a detection.
    assert scored([21.9], no_data=[(20.0, 21.8)])["missed_without_data"] == 0


def test_arming_costs_hours_but_no_label_its_data() -> None:
    found = scored([10.1], arming=[(19.5, 23.0), (22.5, 24.0)])
    assert (found["detected"], found["missed"], found["missed_without_data"], found["no_data_s"]) == (1, 2, 0, 0.0)
    always = scored([10.1])
    labels = scored([10.1], no_data=[(19.5, 24.0)])
    assert found["hours"] == pytest.approx(labels["hours"])
    assert found["hours"] < always["hours"]


def test_labels_outside_are_left_out_with_their_events() -> None:
    found = scored([10.1, 20.1], monitored=(10.05, 25.0))
    assert (found["detected"], found["missed"], found["labels_outside"], found["false_alarms"]) == (1, 0, 2, 0)


def test_nothing_to_compare() -> None:
    found = scored([], labels=())
    assert (found["detected"], found["missed"], found["false_alarms_per_hour"]) == (0, 0, 0.0)
    assert found["delay_s"] == {"mean": None, "p50": None, "p95": None, "max": None}
    low, high = found["false_alarms_per_hour_interval"]  # type: ignore[misc]
    # No event in an hour: the exact upper end is -log(0.025).
    assert (low, high) == (0.0, pytest.approx(-math.log(0.025)))
    whole = scored([5.0], labels=(Label(0.0, 100.0),), monitored=(0.0, 100.0))
    assert whole["hours"] == 0
    assert whole["false_alarms_per_hour"] is None


def test_refusals() -> None:
    for events, given, message in (
        ([-1.0], {}, "events: one is at -1 s; the recording is from 0 to 3600 s"),
        ([math.nan], {}, "events.0.: is nan"),
        ([], {"monitored": (5.0, 5.0)}, "monitored: 5 to 5 s is no time"),
        ([], {"monitored": (-1e308, 1e308)}, "monitored: -1e.308 to 1e.308 s is no time"),
        ([], {"labels": (Label(1, 3), Label(2, 4))}, "the contact at 2 s begins before that at 1 s ends"),
        ([], {"labels": (Label(3, 3),)}, "a contact from 3 to 3 s"),
        ([], {"no_data": [(5.0, 4.0)]}, "no_data: from 5 to 4 s"),
    ):
        with pytest.raises(bs.InputError, match=message):
            scored(events, **given)  # type: ignore[arg-type]
    with pytest.raises(bs.InputError, match="early_s: is -1"):
        Tolerance(-1, 0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "labels.csv: is empty"),
        ("start,end\n1,2\n", "has the header 'start,end'"),
        ("start_s,end_s\n1\n", "row 2: has 1 cells"),
        ("start_s,end_s\n1,2\nx,3\n", "row 3: 'x' is no time"),
        ("start_s,end_s\n1,inf\n", "row 2: 'inf' is no time"),
        ("start_s,end_s\n2,1\n", "from 2 to 1 s"),
        ("start_s,end_s,kind\n1,2,hand,3\n", "row 2: has 4 cells"),
        ('start_s,end_s,kind\n1,2,"' + 200_000 * "x", "labels.csv row 2: is not valid CSV"),
        # It swallowed the contacts after it.
        ('start_s,end_s,kind\n12.0,12.3,"arm\n2.0,3.0,hand\n5.0,6.0,hand\n', "row 2: has a cell that goes on"),
    ],
)
def test_label_files_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    path.write_text(text)
    with pytest.raises(bs.InputError, match=message):
        load_labels(path)


def test_label_files(tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    path.write_text("\ufeffstart_s, end_s, kind\r\n20,22, elbow\r\n\r\n10,11\r\n")
    assert load_labels(path) == (Label(10, 11), Label(20, 22, "elbow"))
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(bs.InputError, match="is not UTF-8 text"):
        load_labels(path)
    with pytest.raises(bs.InputError, match="cannot be read"):
        load_labels(tmp_path / "none.csv")


def test_roc_of_planted_contacts() -> None:
    """Contacts of known height over silence with known disturbances: every factor's counts are known."""
    t = np.arange(0, 60, 0.01)
    rows = np.zeros((t.size, 2))
    for start, height in ((10, 2.0), (20, 4.0), (30, 8.0)):
        ramp = (t >= start) & (t < start + 1)
        rows[ramp, 1] = -height * (t[ramp] - start)
    rows[np.isclose(t, 45), 0] = 3.0
    series = ResidualSeries(t, rows)
    labels = [Label(start, start + 1) for start in (10.0, 20.0, 30.0)]
    found = roc(series, [1.0, 1.0], labels, [1.0, 2.5, 5.0, 9.0])
    assert found.detected.tolist() == [3, 2, 1, 0]
    hours = (59.99 - 3.9) / 3600
    np.testing.assert_allclose(found.false_alarms_per_hour, [1 / hours, 1 / hours, 0, 0], rtol=1e-9)
    # Over 1 at 1/2, 1/4 and 1/8 of a second, seen at the row after.
    assert found.median_delay_s[0] == pytest.approx(0.26, abs=1e-9)
    assert math.isnan(found.median_delay_s[3])
    assert found.to_json()[3] == {
        "factor": 9.0,
        "detected": 0,
        "missed": 3,
        "false_alarms_per_hour": 0.0,
        "median_delay_s": None,
    }


def test_there_is_one_event_at_most_if_quiet_times_are_longer_than_the_recording() -> None:
    t = np.arange(0, 60, 0.01)
    rows = np.where(np.isin(np.arange(t.size), [100, 3000]), 2.0, 0.0)[:, None]
    series = ResidualSeries(t, rows)
    for rearm_s, events in ((28.9, [1.0, 30.0]), (29.1, [1.0]), (1e308, [1.0])):
        assert event_times(series, rows[:, 0], 1.0, rearm_s).tolist() == pytest.approx(events)
    for rearm_s in (-1e308, -0.001, math.inf, math.nan):
        with pytest.raises(bs.InputError, match=r"^rearm_s: is "):
            event_times(series, rows[:, 0], 1.0, rearm_s)


@pytest.mark.parametrize("seed", range(6))
def test_events_of_residuals_are_those_of_the_detector_that_made_them(seed: int) -> None:
    """With samples lost one by one, and many at a time: an alarm that stands is no new one behind them."""
    rng = np.random.default_rng(seed)
    t, q, _, _, tau = moving(UR5E, 3000)
    for first in rng.integers(0, 2900, 6):
        tau[first : first + rng.integers(1, 400), rng.integers(6)] += rng.choice([-1, 1]) * rng.uniform(6, 14)
    kept = rng.random(t.size) > 0.03
    for first in rng.integers(10, 2800, 3):
        kept[first : first + rng.integers(2, 200)] = False
    thresholds = np.full(6, 6.0)
    rearm_s = float(rng.choice([0.0, 0.02, 0.1, 0.5]))
    noisy = tau + rng.normal(0, 0.5, tau.shape)
    run = Detector(UR5E, None, thresholds).run_rows(t[kept], q[kept], noisy[kept], rearm_s=rearm_s)
    series = ResidualSeries(run.t[~run.no_data], run.residual[~run.no_data])
    # While an alarm stands, what comes after the pause is another event.
    found = event_times(series, scaled_residual(series, thresholds), 1.0, min(rearm_s, 0.1))
    assert len(found) >= 2
    assert found.tolist() == [event.t for event in run.events]
