"""Events: where they begin and end, how large they get, and that none hides behind another."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as testing
from hypothesis import strategies as st

from bumpstop.arrays import FloatArray
from bumpstop.detection import DetectionRun, Detector, DetectorSettings, Thresholds
from bumpstop.model import inverse_dynamics
from detection.moving_arms import DT, FILLING, UR5E

THETA = 12.0


def noticed(push: FloatArray, rearm_s: float = 0.5, **settings: float) -> DetectionRun:
    """A detector over an arm at a constant speed that is pushed at joint 2 by so much in each row."""
    t = DT * np.arange(push.size)
    q = 0.1 + 0.2 * t[:, None] * np.ones(6)
    tau = inverse_dynamics(UR5E, q, np.full_like(q, 0.2), np.zeros_like(q))
    tau[:, 1] += push
    given = DetectorSettings(**settings)  # type: ignore[arg-type]
    return Detector(UR5E, None, [THETA] * 6, given).run_rows(t, q, tau, rearm_s=rearm_s)


@pytest.mark.parametrize("after", [60, 100, 200])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_false_alarm_hides_no_contact_behind_it(after: int, sign: int) -> None:
    """One row over the threshold, and a push within the 0.5 s in which the alarm stands."""
    push = np.zeros(800)
    push[200] = sign * 13.0
    push[200 + after : 300 + after] = sign * np.linspace(20, 40, 100)
    first, second = noticed(push).events
    assert (first.t, first.end) == (pytest.approx(200 * DT), pytest.approx(200 * DT))
    assert first.largest_residual[1] == pytest.approx(sign * 13, abs=1e-5)
    assert second.t == pytest.approx((200 + after) * DT)
    assert second.end == pytest.approx((299 + after) * DT)
    assert second.residual[1] == pytest.approx(sign * 20, abs=1e-5)
    assert second.largest_residual[1] == pytest.approx(sign * 40, abs=1e-5)
    assert second.largest_t == pytest.approx((299 + after) * DT)
    assert second.largest_joint == 1


def test_a_contact_that_flickers_about_its_threshold_is_one_event() -> None:
    push = np.zeros(600)
    push[200:400:20] = 15.0  # 40 ms apart
    (event,) = noticed(push).events
    assert (event.t, event.end) == (pytest.approx(0.4), pytest.approx(380 * DT))
    assert len(noticed(push, event_pause_s=0.03).events) == 10
    # An alarm that stands for good is the last event.
    push[550] = 50.0
    assert len(noticed(push).events) == 2
    (whole,) = noticed(push, rearm_s=math.inf).events
    assert whole.end == pytest.approx(550 * DT)
    assert whole.largest_residual[1] == pytest.approx(50, abs=1e-5)


def test_time_without_data_is_no_pause() -> None:
    """Pushed before and behind a gap of half a second: nobody knows whether it was quiet in there."""
    t = DT * np.arange(600)
    q = 0.1 + 0.2 * t[:, None] * np.ones(6)
    tau = inverse_dynamics(UR5E, q, np.full_like(q, 0.2), np.zeros_like(q))
    tau[200:, 1] += 20
    kept = np.r_[0:250, 500:600]
    run = Detector(UR5E, None, [THETA] * 6).run_rows(t[kept], q[kept], tau[kept])
    assert run.no_data[250 : 250 + FILLING].all()
    (event,) = run.events
    assert event.end == pytest.approx(t[-1])


def test_the_largest_is_that_of_its_threshold() -> None:
    """40 Nm of 50 are less than 14 of 12; joints that are not monitored count for nothing."""
    t = DT * np.arange(400)
    q = 0.1 + 0.2 * t[:, None] * np.ones(6)
    tau = inverse_dynamics(UR5E, q, np.full_like(q, 0.2), np.zeros_like(q))
    tau[200:300] += [40.0, 0, 14, 0, 0, 900]
    (event,) = Detector(UR5E, None, [50.0, 50, 12, 9, 9, math.inf]).run_rows(t, q, tau).events
    assert event.largest_joint == 2
    np.testing.assert_allclose(event.largest_residual, [40, 0, 14, 0, 0, 900], atol=1e-4)
    fast = Thresholds(np.full(6, math.inf), fast=np.full(6, 5.0))
    (event, *_) = Detector(UR5E, None, fast).run_rows(t, q, tau).events
    assert event.largest_joint is None
    assert event.to_json()["largest_joint"] is None


@testing(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(st.integers(60, 560), st.integers(1, 60), st.sampled_from([-30.0, 13.0, 20.0])), max_size=6),
    st.sampled_from([0.0, 0.05, 0.5, 2.0]),
)
def test_every_row_over_a_threshold_is_in_some_event(bursts: list[tuple[int, int, float]], rearm_s: float) -> None:
    """And no event spans a pause, whatever the re-arm time: written out, row by row."""
    push = np.zeros(700)
    for first, rows, size in bursts:
        push[first : first + rows] = size
    events = noticed(push, rearm_s=rearm_s).events
    loud = np.flatnonzero(np.abs(push) > THETA)
    # Rows from one loud row to the next that begin another event: with the pause, or when the alarm had ended between.
    apart = max(min(0.1, rearm_s) / DT, 1) + 1
    starts = [int(row) for k, row in enumerate(loud) if k == 0 or row - loud[k - 1] > apart - 1e-6]
    assert [round(event.t / DT) for event in events] == starts
    for event, nxt in zip(events, [*starts[1:], push.size][: len(starts)], strict=True):
        mine = loud[(loud >= round(event.t / DT)) & (loud < nxt)]
        assert round(event.end / DT) == mine[-1]
        largest = np.abs(push[mine]).max()
        assert abs(event.largest_residual[1]) == pytest.approx(largest, abs=1e-4)
