"""The very tick, interval or sample at which something changes: not one later, not one earlier.

Times are whole numbers of 1/512 s, so that sums and differences of them are exact.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from bumpstop.arrays import FloatArray
from bumpstop.detection import Detector, DetectorSettings, gaps
from bumpstop.detection.detection_run import FAULTS, STATES
from bumpstop.detection.scoring.labels import Label
from bumpstop.detection.scoring.score import Score
from bumpstop.detection.tuning.residual_file import ResidualSeries
from bumpstop.model import inverse_dynamics
from detection.moving_arms import UR5E

DT = 1 / 512
ABOVE = 1 + 1e-12


def rows(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """An arm at a constant speed that a force far above every threshold presses from the beginning."""
    q = 0.1 + 0.2 * t[:, None] * np.ones(6)
    tau = inverse_dynamics(UR5E, q, np.full_like(q, 0.2), np.zeros_like(q))
    return t, q, tau + np.array([50.0, 0, 0, 0, 0, 0])


@pytest.mark.parametrize(
    ("delay", "ticks"), [(0.0, 0), (DT, 1), (50 * DT, 50), (50 * DT / ABOVE, 50), (50 * DT * ABOVE, 51)]
)
def test_the_first_armed_tick(delay: float, ticks: int) -> None:
    """So many after the motion began for the detector, which is its first tick with data."""
    run = Detector(UR5E, None, [12.0] * 6, DetectorSettings(arming_delay_s=delay)).run_rows(*rows(DT * np.arange(200)))
    begun = int(np.flatnonzero(run.state != STATES.index("no_data"))[0])
    assert run.events[0].t == run.t[begun + ticks]
    assert np.flatnonzero(run.state == STATES.index("arming")).tolist() == list(range(begun, begun + ticks))
    assert int(run.masked_while_arming.sum()) == ticks


@pytest.mark.parametrize(("periods", "fault"), [(5.0, "none"), (5.0 * ABOVE, "gap"), (4.0, "none"), (6.0, "gap")])
def test_an_interval_longer_than_five_periods_is_a_gap(periods: float, fault: str) -> None:
    t = DT * np.arange(200)
    t[100:] = t[99] + periods * DT + DT * np.arange(100)
    run = Detector(UR5E, None, [12.0] * 6).run_rows(*rows(t))
    assert FAULTS[run.fault[100]] == fault
    # After a gap the window fills again.
    no_data = run.state[100:] == STATES.index("no_data")
    assert no_data.any() == (fault == "gap")


@pytest.mark.parametrize(
    ("given", "periods", "fault"), [(8.0, 8.0, "none"), (8.0, 8.0 * ABOVE, "gap"), (2.0, 3.0, "gap")]
)
def test_so_is_one_longer_than_was_asked_for(given: float, periods: float, fault: str) -> None:
    t = DT * np.arange(200)
    t[100:] = t[99] + periods * DT + DT * np.arange(100)
    run = Detector(UR5E, None, [12.0] * 6, DetectorSettings(longest_periods=given)).run_rows(*rows(t))
    assert FAULTS[run.fault[100]] == fault


@pytest.mark.parametrize(("periods", "late"), [(1.0, False), (1.5, False), (1.5 * ABOVE, True), (2.0, True)])
def test_an_interval_longer_than_one_and_a_half_periods_is_late(periods: float, late: bool) -> None:
    t = DT * np.arange(200)
    t[100:] = t[99] + periods * DT + DT * np.arange(100)
    run = Detector(UR5E, None, [12.0] * 6).run_rows(*rows(t))
    assert bool(run.late[100]) is late
    assert not run.late[101:].any()


@pytest.mark.parametrize(("periods", "parts"), [(4.0, 1), (5.0, 1), (5.0 * ABOVE, 2), (6.0, 2)])
def test_residuals_have_the_same_gaps(periods: float, parts: int) -> None:
    t = DT * np.arange(100)
    t[60:] += (periods - 1) * DT
    series = ResidualSeries(t, np.zeros((100, 2)))
    assert series.period == DT
    assert len(series.segments()) == parts
    assert gaps(series) == [(float(t[59]), float(t[60]))][: parts - 1]
    assert series.monitored_s == 100 * DT


@pytest.mark.parametrize(
    ("count", "p50", "p95"), [(1, 1, 1), (2, 1, 2), (3, 2, 3), (19, 10, 19), (20, 10, 19), (21, 11, 20), (100, 50, 95)]
)
def test_quantiles_of_delays_are_the_smallest_that_so_many_do_not_exceed(count: int, p50: float, p95: float) -> None:
    late = np.append(np.random.default_rng(count).permutation(np.arange(1.0, count + 1)), math.nan)
    label = Label(0.0, 1.0)
    none = np.zeros(late.size, dtype=bool)
    score = Score((label,) * late.size, late, none, np.empty(0), repeated=0, hours=1.0, no_data_s=0.0, outside=0)
    delay = score.to_json()["delay_s"]
    assert (delay["p50"], delay["p95"], delay["max"]) == (p50, p95, count)


@pytest.mark.parametrize(("quiet", "events"), [(18, 1), (19, 1), (20, 2), (21, 2)])
def test_quiet_for_the_pause_ends_an_event(quiet: int, events: int) -> None:
    """Quiet counts from the last row over a threshold to the last row below it: twenty intervals of 1/512 s."""
    t = DT * np.arange(300)
    _, q, tau = rows(t)
    tau = tau - np.array([50.0, 0, 0, 0, 0, 0])
    second = 150 + quiet + 1
    tau[150, 0] += 30.0
    tau[second:, 0] += 40.0
    settings = DetectorSettings(event_pause_s=20 * DT)
    found = Detector(UR5E, None, [12.0] * 6, settings).run_rows(t, q, tau, rearm_s=10.0).events
    assert [event.t for event in found] == [t[150], t[second]][:events]
    assert [event.end for event in found] == [t[150], t[-1]][2 - events :]
