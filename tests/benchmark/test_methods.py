"""Each method's lag as theory has it, and two routes to what bumpstop has itself."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.benchmark import (
    METHODS,
    BandPass,
    KalmanObserver,
    MomentumObserver,
    SecondOrderObserver,
    SlidingModeObserver,
    planted_runs,
    signals_of_motion,
    signals_of_residual,
)
from bumpstop.benchmark.signals import Signals, direct_residual

DT = 0.001
T = DT * np.arange(3000)


def answer_to(torque: np.ndarray, method: object) -> np.ndarray:
    """What a method makes of an external torque on one joint at rest, whose momentum it integrates to."""
    force = np.zeros((1, T.size, 1))
    momentum = np.concatenate([[0.0], np.cumsum((torque[1:] + torque[:-1]) / 2) * DT])[None, :, None]
    signals = Signals(DT, momentum, force, -torque[None, :, None], -torque[None, :, None])
    return -method.residual(signals)[0, :, 0]  # type: ignore[attr-defined]


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_the_lag_behind_an_even_growth_is_that_of_theory(method: object) -> None:
    """A ramp of 100 Nm/s from 0.2 s on: in the end the answer is the ramp of a lag ago, to a sample."""
    ramp = 100 * np.maximum(T - 0.2, 0.0)
    found = answer_to(ramp, method)
    settled = T > 1.5
    if math.isnan(method.lag_s):  # type: ignore[attr-defined]
        # A ramp ends as a constant: its slope over the lower corner, less what the upper takes away.
        assert found[settled].std() < 1e-6
        assert found[-1] == pytest.approx(100 / (2 * math.pi * 2.0), rel=0.01)
        return
    lag = (ramp[settled] - found[settled]).mean() / 100
    assert lag == pytest.approx(method.lag_s, abs=1.5 * DT)  # type: ignore[attr-defined]
    chatter = 1.1 * 200 * DT if isinstance(method, SlidingModeObserver) else 0.01
    assert np.abs(ramp[settled] - found[settled] - 100 * lag).max() < 2 * chatter


def test_steps_rise_as_theory_says() -> None:
    step = np.where(T >= 1.0, 10.0, 0.0)
    rows = np.arange(1001, 1200)
    after = T[rows] - 1.0
    observer = answer_to(step, MomentumObserver(50.0))
    np.testing.assert_allclose(observer[rows], 10 * -np.expm1(-50 * after), atol=0.3)
    damped = answer_to(step, SecondOrderObserver(80.0, 0.5))
    assert damped.max() == pytest.approx(10 * (1 + math.exp(-math.pi * 0.5 / math.sqrt(0.75))), rel=0.01)
    sliding = answer_to(step, SlidingModeObserver(200.0))
    # No faster than k2 allows.
    assert np.all(sliding[rows] <= 1.1 * 200 * (after + 2 * DT))
    band = answer_to(step, BandPass(2.0, 20.0))
    assert T[band.argmax()] - 1.0 == pytest.approx(BandPass(2.0, 20.0).peak_s, abs=1.5 * DT)


def test_the_steady_kalman_filter_is_a_butterworth_filter() -> None:
    """In continuous time its poles lie at omega exp(+-i 3/4 pi): gains sqrt(2) omega dt and omega^2 dt."""
    on_momentum, on_torque = KalmanObserver(60.0).gains(1e-5)
    assert on_momentum == pytest.approx(math.sqrt(2) * 60 * 1e-5, rel=1e-3)
    assert on_torque == pytest.approx(60**2 * 1e-5, rel=1e-3)


def test_the_momentum_observer_is_that_of_the_detector() -> None:
    robot = bs.Robot.load("ur5e")
    runs = planted_runs(robot, 1, 8.0, stiffness_N_m=20_000, seed=4)
    signals = signals_of_motion(robot, runs.q, runs.torque, runs.dt)
    ours = direct_residual(robot, runs.q, runs.torque, runs.dt, "observer")
    theirs = MomentumObserver(50.0).residual(signals)
    assert np.abs(ours[:, 250:] - theirs[:, 250:]).max() < 1e-3 * np.abs(ours).max()


def test_recordings_whose_residual_is_known_are_seen_alike_by_observers() -> None:
    external = 10 * np.sin(2 * np.pi * 0.5 * T)
    known = signals_of_residual(-external[None, :, None], np.zeros((1, T.size, 1)), DT)
    for method in (MomentumObserver(), SecondOrderObserver(), KalmanObserver()):
        by_momentum = answer_to(external, method)
        np.testing.assert_allclose(-method.residual(known)[0, 500:, 0], by_momentum[500:], atol=0.02)
