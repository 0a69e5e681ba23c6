"""Alarms of the detector: when a contact is detected, and how long an alarm stays."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bumpstop.arrays import FloatArray
from bumpstop.detection import Detector, DetectorSettings, Thresholds
from bumpstop.detection.detection_run import STATES
from bumpstop.model import inverse_dynamics
from detection.moving_arms import DT, FILLING, UR5E, live, parabola


def pressed(
    size: float, rows: int = 600, *, ramp_s: float = 0.0, noise: float = 0.0, seed: int = 0
) -> tuple[FloatArray, ...]:
    """Rows of an arm at a constant speed that a force of ``size`` times (20, 10, 0 ..) Nm presses from 0.4 s on."""
    t = DT * np.arange(rows)
    q = 0.1 + 0.2 * t[:, None] * np.ones(6)
    tau = inverse_dynamics(UR5E, q, np.full_like(q, 0.2), np.zeros_like(q))
    share = np.clip((t - 0.4) / ramp_s, 0, 1) if ramp_s else (t >= 0.4 - 1e-9).astype(float)
    tau = tau + size * share[:, None] * np.array([20.0, 10, 0, 0, 0, 0])
    return t, q, tau + noise * np.random.default_rng(seed).normal(size=q.shape)


@settings(deadline=None, max_examples=40)
@given(
    weak=st.floats(0.3, 5),
    more=st.floats(0, 5),
    ramp_s=st.just(0.0) | st.floats(1e-3, 0.3),
    kind=st.sampled_from(["direct", "observer"]),
)
def test_a_larger_force_is_never_noticed_later(weak: float, more: float, ramp_s: float, kind: str) -> None:
    thresholds = Thresholds(np.full(6, 12.0), fast=np.full(6, 9.0), speed=np.full(6, 1.0))
    detector = Detector(UR5E, None, thresholds, DetectorSettings(residual=kind))  # type: ignore[arg-type]
    times = []
    for size in (weak, weak + more):
        t, q, tau = pressed(size, ramp_s=ramp_s)
        events = detector.run_rows(t, q, tau).events
        times.append(events[0].t if events else math.inf)
    assert times[1] <= times[0]


def test_with_noise_the_distribution_of_delays_is_ordered() -> None:
    """At every time at least as many of the stronger contacts are detected: the same noise, run by run, up to
    chance."""
    detector = Detector(UR5E, None, [12.0] * 6)
    delays = []
    for size in (0.5, 0.6, 0.8):
        found = []
        for seed in range(60):
            t, q, tau = pressed(size, 500, noise=1.5, seed=1000 + seed)
            events = detector.run_rows(t, q, tau).events
            found.append(events[0].t if events else 9.0)
        delays.append(np.sort(found))
    assert (delays[1] <= delays[0]).all()
    assert (delays[2] <= delays[1]).all()
    assert delays[2].mean() < delays[0].mean()


def test_a_slow_clamp_and_a_blow_are_both_noticed() -> None:
    thresholds = Thresholds(np.full(6, 15.0), fast=np.full(6, 4.0))
    t, q, clamp = pressed(1.0, 8000, ramp_s=12.0)  # 20 Nm in 12 s, far slower than the band
    (event,) = Detector(UR5E, None, thresholds).run_rows(t, q, clamp).events
    assert event.joints == (0,)
    assert event.fast_joints == ()
    assert event.t == pytest.approx(0.4 + 12 * 15 / 20, abs=2 * DT)
    t, q, blow = pressed(0.5)  # 10 Nm at once, below the absolute threshold
    (event,) = Detector(UR5E, None, thresholds).run_rows(t, q, blow).events
    assert event.joints == ()
    assert 0 in event.fast_joints
    assert Detector(UR5E, None, thresholds.constant).run_rows(t, q, blow).events == ()


def test_arming_costs_what_it_says() -> None:
    t, q, tau = pressed(1.0)
    late = Detector(UR5E, None, [12.0] * 6, DetectorSettings(arming_delay_s=0.5)).run_rows(t, q, tau)
    # The motion begins for the detector where its window is full.
    assert late.events[0].t == pytest.approx(0.5 + FILLING * DT, abs=1.5 * DT)
    assert late.masked_while_arming.sum() == pytest.approx((late.events[0].t - 0.4) / DT, abs=1)
    assert late.arming_s == pytest.approx(0.5, abs=2 * DT)
    # At rest there is nothing to arm for.
    q[:] = q[0]
    tau = inverse_dynamics(UR5E, q, 0 * q, 0 * q) + np.where(t >= 0.4, 20.0, 0.0)[:, None]
    held = Detector(UR5E, None, [12.0] * 6, DetectorSettings(arming_delay_s=0.5)).run_rows(t, q, live(tau))
    assert held.events[0].t == pytest.approx(0.4)


def test_an_alarm_stays_and_ends_after_quiet() -> None:
    t, q, tau = pressed(1.0)
    tau[300:] = pressed(0.0)[2][300:]
    tau[500] += 30
    detector = Detector(UR5E, None, [12.0] * 6)
    run = detector.run_rows(t, q, tau, rearm_s=0.2)
    assert [round(event.t, 3) for event in run.events] == [0.4, 1.0]
    latched = detector.run_rows(t, q, tau, rearm_s=math.inf)
    assert len(latched.events) == 1
    assert latched.stop[200:].all()
    assert not latched.stop[FILLING:200].any()


@pytest.mark.parametrize("time", [math.nan, -math.inf, math.inf, 0.0, -5.0])
def test_a_row_without_a_time_of_its_own_does_not_end_an_alarm_nor_keep_it(time: float) -> None:
    """Quiet from 0.6 s on, but for a row at 0.65 s: whatever its time, the alarm ends 0.2 s after the next row."""
    t, q, tau = pressed(1.0)
    tau[300:] = pressed(0.0)[2][300:]
    t[325] = time
    run = Detector(UR5E, None, [12.0] * 6).run_rows(t, q, tau, rearm_s=0.2)
    (over,) = np.flatnonzero(np.diff((run.state == STATES.index("alarm")).astype(int)[326:]) < 0) + 327
    assert run.no_data[325]
    assert t[over] == pytest.approx(326 * DT + 0.2 + DT, abs=1.5 * DT)


def test_thresholds_grow_with_motion() -> None:
    thresholds = Thresholds(np.full(6, 5.0), speed=np.full(6, 10.0), acceleration=np.full(6, 2.0), rest=np.full(6, 3.0))
    t, q, qd, qdd, tau = parabola(UR5E)
    run = Detector(UR5E, None, thresholds).run_rows(t, q, tau)
    fast = np.abs(qd) > 0.02
    wanted = 5 + 10 * np.abs(qd) + 2 * np.abs(qdd)
    np.testing.assert_allclose(run.threshold[FILLING:][fast[FILLING:]], wanted[FILLING:][fast[FILLING:]], rtol=1e-6)
    t, q = DT * np.arange(50), np.full((50, 6), 0.2)
    resting = Detector(UR5E, None, thresholds).run_rows(t, q, 0 * q)
    np.testing.assert_allclose(resting.threshold[FILLING:], 8.0, atol=1e-6)


@pytest.mark.parametrize("grows", [{}, {"speed": np.full(6, 10.0)}, {"acceleration": np.ones(6), "rest": np.ones(6)}])
def test_the_fast_channel_passes_a_band_and_its_threshold_grows_with_motion_too(grows: dict[str, FloatArray]) -> None:
    """A blow of 10 Nm through two filters of first order, written out; the arm goes on at 0.2 rad/s."""
    t, q, tau = pressed(0.5)
    smooth = slow = peak = 0.0
    for now in 10.0 * (t >= 0.4 - 1e-9):
        smooth = now + math.exp(-2 * math.pi * 30 * DT) * (smooth - now)
        slow = smooth + math.exp(-2 * math.pi * 0.5 * DT) * (slow - smooth)
        peak = max(peak, smooth - slow)
    assert 8 < peak < 10
    # In even motion far from rest only the speed adds anything.
    added = 10.0 * 0.2 if "speed" in grows else 0.0
    for beside, noticed in ((-0.01, True), (0.01, False)):
        fast = np.array([peak - added + beside, *[math.inf] * 5])
        thresholds = Thresholds(np.full(6, 50.0), fast=fast, **grows)
        events = Detector(UR5E, None, thresholds).run_rows(t, q, tau).events
        assert [event.fast_joints for event in events] == ([(0,)] if noticed else [])


def test_what_standstill_adds_fades_between_one_and_two_rest_speeds() -> None:
    rest = 0.02
    thresholds = Thresholds(np.full(6, 5.0), rest=np.full(6, 3.0))
    t = DT * np.arange(60)
    for times, share in ((0.0, 1.0), (0.99, 1.0), (1.25, 0.75), (1.5, 0.5), (1.9, 0.1), (2.01, 0.0)):
        for way in (-1, 1):
            q = 0.2 + way * times * rest * t[:, None] * np.ones(6)
            run = Detector(UR5E, None, thresholds, DetectorSettings(rest_speed=rest)).run_rows(t, q, np.zeros_like(q))
            np.testing.assert_allclose(run.threshold[FILLING:], 5 + 3 * share, atol=1e-6)


@pytest.mark.parametrize(("pause_s", "arms_anew"), [(0.05, False), (0.2, True)])
def test_a_motion_begins_anew_after_a_rest_and_not_after_a_short_stop(pause_s: float, arms_anew: bool) -> None:
    """The arm rests when it has stood for 0.1 s. It is pushed 0.04 s after it goes on."""
    t = DT * np.arange(1200)
    goes_on = 1.0 + pause_s
    moved = np.minimum(t, 1.0) + np.maximum(t - goes_on, 0.0)
    q = 0.2 + 0.1 * moved[:, None] * np.ones(6)
    tau = inverse_dynamics(UR5E, q, 0 * q, 0 * q) + np.where(t >= goes_on + 0.04, 300.0, 0.0)[:, None]
    # What a sudden start and stop looks like to a filter is less than a third of the push.
    settings = DetectorSettings(arming_delay_s=0.4, window_s=7 * DT)
    (event,) = Detector(UR5E, None, [100.0] * 6, settings).run_rows(t, q, live(tau)).events
    assert event.t == pytest.approx(goes_on + (0.4 if arms_anew else 0.04), abs=3 * DT)
