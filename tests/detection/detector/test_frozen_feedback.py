"""Feedback that stands still while time goes on: told as a fault, at rest after a time, in motion at once."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bumpstop.arrays import FloatArray
from bumpstop.detection import Detector, DetectorSettings
from bumpstop.detection.detection_run import FAULTS
from bumpstop.model import inverse_dynamics
from detection.moving_arms import DT, FILLING, UR5E, moving

FROZEN = FAULTS.index("frozen")
STEP = 2 * math.pi / 2**17  # of an encoder


def standing(rows: int = 1000, noise: float = 0.5, seed: int = 3) -> tuple[FloatArray, ...]:
    """An arm at rest: constant positions, torques with noise."""
    t = DT * np.arange(rows)
    q = np.full((rows, 6), 0.4)
    held = inverse_dynamics(UR5E, q[0], 0 * q[0], 0 * q[0])
    return t, q, held + noise * np.random.default_rng(seed).normal(size=q.shape)


def test_a_push_that_feedback_hides_is_not_quiet() -> None:
    """A standing arm is pushed while its feedback repeats one row: the detector says that it knows nothing."""
    t, q, tau = standing()
    tau[400:600, 1] += 40
    assert Detector(UR5E, None, [15.0] * 6).run_rows(t, q, tau).events
    tau[390:700] = tau[390]
    run = Detector(UR5E, None, [15.0] * 6).run_rows(t, q, tau)
    assert run.events == ()
    told = np.flatnonzero(run.fault == FROZEN)
    # From the first row more than 0.1 s behind the first of its kind to the last of them.
    assert (told[0], told[-1]) == (390 + round(0.1 / DT) + 1, 699)
    assert run.stop[told].all()
    # What came before is forgotten, as behind any gap.
    assert run.no_data[700 : 700 + FILLING].all()
    assert not run.no_data[700 + FILLING :].any()
    (note,) = (note for note in run.notes if note.startswith("Frozen feedback"))
    assert f"in {told.size} rows, the first at {t[told[0]]:.4f} s" in note
    assert run.settings["frozen_s"] == 0.1


@pytest.mark.parametrize(("frozen_s", "rows"), [(0.05, 26), (0.2, 101), (1e-6, 4)])
def test_the_time_is_an_option_and_takes_five_rows_at_least(frozen_s: float, rows: int) -> None:
    t, q, tau = standing(600)
    tau[200:400] = tau[200]
    run = Detector(UR5E, None, [50.0] * 6, DetectorSettings(frozen_s=frozen_s)).run_rows(t, q, tau)
    assert int((run.fault == FROZEN).argmax()) == 200 + rows
    never = Detector(UR5E, None, [50.0] * 6, DetectorSettings(frozen_s=math.inf)).run_rows(t, q, tau)
    assert not never.no_data[FILLING:].any()
    assert never.settings["frozen_s"] is None


@pytest.mark.parametrize("alive", ["q", "tau"])
def test_one_channel_that_lives_is_no_frozen_feedback(alive: str) -> None:
    t, q, tau = standing(600)
    if alive == "q":
        tau[:] = tau[0]
        q[:, 5] += STEP * np.arange(600)  # one joint
    else:
        tau[:, 1:] = tau[0, 1:]
    assert not Detector(UR5E, None, [50.0] * 6).run_rows(t, q, tau).no_data[FILLING:].any()


@pytest.mark.parametrize("seed", range(5))
def test_coarse_sensors_of_a_standing_arm_may_repeat(seed: int) -> None:
    """Encoders of 17 bit that flicker now and then, torques in steps so coarse that most rows are the one before."""
    rng = np.random.default_rng(seed)
    t, q, tau = standing(3000, noise=0.0)
    flicker = np.cumsum(rng.random(q.shape) < 0.01, axis=0) % 2
    q = np.round(q / STEP + 0.4 * flicker + 0.3) * STEP
    tau = np.round((tau + 0.15 * rng.normal(size=tau.shape)) / 0.8) * 0.8
    same = (np.diff(q, axis=0) == 0).all(axis=1) & (np.diff(tau, axis=0) == 0).all(axis=1)
    assert same.mean() > 0.25
    run = Detector(UR5E, None, [50.0] * 6).run_rows(t, q, tau)
    assert not run.no_data[FILLING:].any()


@pytest.mark.parametrize("repeats", [1, 2, 4, 5, 40])
@pytest.mark.parametrize("kind", ["direct", "observer"])
def test_rows_that_repeat_in_motion_make_no_spike(kind: str, repeats: int) -> None:
    """They are not believed from the first on, nor missed if they are few: as lost ones."""
    t, q, _, _, tau = moving(UR5E, 700, pace=0.5)
    settings = DetectorSettings(residual=kind)  # type: ignore[arg-type]
    clean = Detector(UR5E, None, [1e3] * 6, settings).run_rows(t, q, tau)
    for at in (150, 333):
        q[at : at + repeats], tau[at : at + repeats] = q[at - 1], tau[at - 1]
    run = Detector(UR5E, None, [1e3] * 6, settings).run_rows(t, q, tau)
    told = np.flatnonzero(run.fault == FROZEN)
    np.testing.assert_array_equal(told, [*range(150, 150 + repeats), *range(333, 333 + repeats)])
    seen = ~(run.no_data | clean.no_data)
    assert np.abs(run.residual - clean.residual)[seen].max() < 1.0
    # Longer than five periods is a gap.
    filled = FILLING + (kind == "observer") if repeats >= 5 else 0
    assert np.count_nonzero(run.no_data[FILLING + 1 :]) == 2 * (repeats + filled)


def test_a_constant_speed_without_noise_is_known_by_its_rows() -> None:
    """Every step of the encoder is the same there; a row without one is none of them."""
    t = DT * np.arange(400)
    q = 0.1 + 0.2 * t[:, None] * np.ones(6)
    tau = inverse_dynamics(UR5E, q, np.full_like(q, 0.2), 0 * q)
    q[200], tau[200] = q[199], tau[199]
    run = Detector(UR5E, None, [20.0] * 6).run_rows(t, q, tau)
    np.testing.assert_array_equal(np.flatnonzero(run.fault == FROZEN), [200])
    assert run.events == ()
    assert np.nanmax(np.abs(run.residual)) < 1


def test_a_logger_that_is_faster_than_the_controller_leaves_every_second_row() -> None:
    t, q, _, _, tau = moving(UR5E, 600, pace=0.5)
    clean = Detector(UR5E, None, [1e3] * 6, DetectorSettings(period_s=DT)).run_rows(t, q, tau)
    fast = 0.5 * DT * np.arange(1200)
    run = Detector(UR5E, None, [1e3] * 6).run_rows(fast, np.repeat(q, 2, axis=0), np.repeat(tau, 2, axis=0))
    assert run.events == ()
    # Of 560 repeats nine in ten are told, once it is known how the arm moves.
    assert np.count_nonzero(run.fault[160:] == FROZEN) > 0.9 * 520
    assert np.nanmax(np.abs(run.residual)) < np.nanmax(np.abs(clean.residual)) + 3


def test_slow_motion_on_coarse_encoders_is_no_frozen_feedback() -> None:
    """A tenth of a step a row: nine rows in ten have the positions of the row before, and live torques."""
    t = DT * np.arange(2000)
    q = np.round((0.3 + 0.1 * STEP / DT * t[:, None] * np.ones(6)) / STEP) * STEP
    tau = np.random.default_rng(2).normal(size=q.shape)
    assert not Detector(UR5E, None, [500.0] * 6).run_rows(t, q, tau).no_data[FILLING:].any()
    # Even with torques that are all the same: it is as slow as rows repeat.
    tau[:] = 0.0
    assert not Detector(UR5E, None, [500.0] * 6).run_rows(t, q, tau).no_data[FILLING:].any()


def test_measured_rates_are_a_channel_too() -> None:
    t, q, tau = standing(400)
    tau[:] = tau[0]
    qd = 1e-6 * np.random.default_rng(1).normal(size=q.shape)
    settings = DetectorSettings(measured_rates=True)
    assert not Detector(UR5E, None, [50.0] * 6, settings).run_rows(t, q, tau, qd=qd).no_data[FILLING:].any()
    assert (Detector(UR5E, None, [50.0] * 6, settings).run_rows(t, q, tau, qd=0 * qd).fault == FROZEN).any()
