"""Residuals of fitted dynamics over recordings with gaps: what was made up between samples is not judged."""

from __future__ import annotations

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.arrays import FloatArray
from bumpstop.detection import DetectorSettings, Thresholds, detect
from bumpstop.detection.detection_run import FAULTS, STATES
from bumpstop.identification import DynamicsModel, identify_dynamics
from bumpstop.model import inverse_dynamics
from bumpstop.recording import Recording
from detection.moving_arms import UR5E, moving

DT = 0.004
CUTOFF_HZ = 25.0  # at which every row is kept
THETA = 8.0
AT_ENDS = 10  # rows within a period of the cut-off of an end, which are not judged where the arm moves there


def log(seed: int, rows: int, lost: tuple[tuple[int, int], ...] = (), push: FloatArray | None = None) -> Recording:
    """A motion without contact, but for ``push`` (rows,) on every joint, some rows of which were lost."""
    t, q, _, _, tau = moving(UR5E, rows, DT, seed, pace=0.4)
    tau = tau + np.random.default_rng(seed).normal(0, 0.2, tau.shape)
    if push is not None:
        tau = tau + push[:, None]
    kept = np.ones(rows, dtype=bool)
    for first, end in lost:
        kept[first:end] = False
    return Recording(t=t[kept], q=q[kept], tau=tau[kept])


@pytest.fixture(scope="module")
def fit() -> DynamicsModel:
    return identify_dynamics([log(1, 4000), log(2, 4000)], UR5E, cutoff_hz=CUTOFF_HZ).model


def test_a_gap_has_no_data_and_makes_no_alarm(fit: DynamicsModel) -> None:
    """A lost second: straight lines across it and the filter beside it leave more than the thresholds."""
    whole = detect(log(3, 3000), UR5E, fit, [THETA] * 6)
    assert whole.no_data_rows() == {"filling": 2 * AT_ENDS}
    assert whole.events == ()
    run = detect(log(3, 3000, ((1000, 1250),)), UR5E, fit, [THETA] * 6)
    assert run.events == ()
    # From a period of the cut-off before the last row to as much after the next.
    dark = (run.t > 999 * DT - 1 / CUTOFF_HZ) & (run.t < 1250 * DT + 1 / CUTOFF_HZ)
    np.testing.assert_array_equal(run.no_data, dark | whole.no_data)
    assert run.no_data_rows() == {"filling": 2 * AT_ENDS, "gap": int(dark.sum())}
    assert np.isnan(run.residual[dark]).all()
    np.testing.assert_allclose(run.residual[~run.no_data], whole.residual[~run.no_data], atol=0.5)


def quick(seed: int, rows: int, noise_rad: float = 3e-6) -> Recording:
    """A motion with accelerations at its ends, as of a recording that begins and ends in the middle of a program."""
    t, q, _, _, tau = moving(UR5E, rows, DT, seed)
    random = np.random.default_rng(seed)
    return Recording(t=t, q=q + random.normal(0, noise_rad, q.shape), tau=tau + random.normal(0, 0.2, tau.shape))


def test_ends_in_motion_are_not_judged_and_counted(fit: DynamicsModel) -> None:
    """The filter has no acceleration at an end: twenty of forty ends of quiet motions made an alarm."""
    inside = np.abs(detect(quick(3, 3000), UR5E, fit, [1e6] * 6).residual[AT_ENDS:-AT_ENDS])
    thresholds = 1.6 * inside.max(axis=0)
    for seed in range(4, 24):
        run = detect(quick(seed, 500), UR5E, fit, thresholds)
        assert run.events == ()
        np.testing.assert_array_equal(run.fault[:AT_ENDS], FAULTS.index("filling"))
        np.testing.assert_array_equal(run.fault[-AT_ENDS:], FAULTS.index("filling"))
        assert run.no_data_rows() == {"filling": 2 * AT_ENDS}
        said = "begins or ends in motion: 20 rows within 0.04 s of an end are not judged"
        assert sum(said in note for note in run.notes) == 1


def test_ends_at_rest_are_judged(fit: DynamicsModel) -> None:
    """There the filter knows that nothing moves, and a push at rest is found to the last row."""
    t = DT * np.arange(1000)
    share = np.clip((t - 1) / 2, 0, 1)
    q = 0.4 * np.sin(np.pi * share[:, None]) ** 4 * np.ones(6)
    qd, qdd = np.gradient(q, DT, axis=0), np.gradient(np.gradient(q, DT, axis=0), DT, axis=0)
    tau = inverse_dynamics(UR5E, q, qd, qdd)
    tau[-5:] += 30.0
    run = detect(Recording(t=t, q=q, tau=tau), UR5E, fit, [THETA] * 6, DetectorSettings(frozen_s=np.inf))
    assert not run.no_data.any()
    assert [round(event.t / DT) for event in run.events] == [995]
    # Of an end in motion and one at rest the first alone is left away.
    half = Recording(t=t[500:], q=q[500:], tau=tau[500:])
    found = detect(half, UR5E, fit, [THETA] * 6, DetectorSettings(frozen_s=np.inf))
    np.testing.assert_array_equal(np.flatnonzero(found.no_data), np.arange(AT_ENDS))


def test_a_recording_of_two_periods_in_motion_has_no_data(fit: DynamicsModel) -> None:
    slow = identify_dynamics([log(1, 4000), log(2, 4000)], UR5E, cutoff_hz=2.0).model
    run = detect(quick(3, 240), UR5E, slow, [THETA] * 6)
    assert run.no_data.all()
    assert run.inactive


def test_nothing_is_noticed_inside_a_short_gap(fit: DynamicsModel) -> None:
    """Five lost rows after one that was pushed: what is interpolated from it is no second push."""
    push = np.zeros(3000)
    push[1000] = 60.0
    run = detect(log(3, 3000, ((1001, 1006),), push), UR5E, fit, [THETA] * 6, rearm_s=0.0)
    assert [round(event.t / DT) for event in run.events] == [1000]
    np.testing.assert_array_equal(np.flatnonzero(run.fault == FAULTS.index("gap")), np.arange(1001, 1006))
    # The alarm lasts until the first row after the gap, which is quiet, and begins no second time.
    assert (run.state[1007:] != run.state[1000]).all()
    # Made of the last row that was recorded: a push inside the gap that nobody recorded raises nothing either.
    later = detect(log(3, 3000, ((999, 1006),), push), UR5E, fit, [THETA] * 6)
    assert later.events == ()


def test_a_recording_of_nothing_but_gaps_has_no_data_at_all(fit: DynamicsModel) -> None:
    lost = tuple((first, first + 60) for first in range(5, 3000, 65))
    run = detect(log(3, 3000, lost), UR5E, fit, [0.1] * 6)
    assert run.no_data.all()
    assert run.events == ()


def test_a_day_between_two_motions_is_refused(fit: DynamicsModel) -> None:
    """An even grid across it would have twenty million rows."""
    whole = log(3, 3000)
    later = np.where(np.arange(3000) < 1500, whole.t, whole.t + 86_400)
    with pytest.raises(bs.InputError, match=r"recording: needs 2\.16e\+07 even rows; .* cut the gaps out"):
        detect(Recording(t=later, q=whole.q, tau=whole.tau), UR5E, fit, [THETA] * 6)


def test_a_gap_is_no_quiet_time(fit: DynamicsModel) -> None:
    """Pushed into a gap of a second: nobody knows whether it was quiet in there, and quiet counts from its end."""
    push = np.zeros(3000)
    push[900:1000] = 60.0
    run = detect(log(3, 3000, ((1000, 1250),), push), UR5E, fit, [THETA] * 6, rearm_s=2.0)
    first = int(np.flatnonzero(run.fault == FAULTS.index("gap"))[-1]) + 1
    (alarm,) = np.flatnonzero(np.diff((run.state[first:] == STATES.index("alarm")).astype(int))) + first
    assert run.t[alarm] == pytest.approx(run.t[first] + 2.0, abs=1.5 * DT)


def test_the_fast_channel_begins_anew_behind_a_gap(fit: DynamicsModel) -> None:
    """A constant error that comes in a gap looks like no blow behind it, as at the beginning of a recording."""
    push = np.zeros(3000)
    push[1020:] = 6.0
    law = Thresholds(np.full(6, 20.0), fast=np.full(6, 1.5))
    assert detect(log(3, 3000, (), push), UR5E, fit, law).events != ()
    assert detect(log(3, 3000, ((1000, 1050),), push), UR5E, fit, law).events == ()


def test_what_was_found_at_another_rate_is_refused(fit: DynamicsModel) -> None:
    recording = log(3, 3000)
    with pytest.raises(bs.InputError, match=r"a row every 0\.004 s; the detector is made for thresholds period_s"):
        detect(recording, UR5E, fit, Thresholds(np.full(6, THETA), period_s=0.02))
    assert detect(recording, UR5E, fit, Thresholds(np.full(6, THETA), period_s=DT)).events == ()
    with pytest.raises(bs.InputError, match="largest_signal: is not available with fitted dynamics"):
        detect(recording, UR5E, fit, [THETA] * 6, DetectorSettings(largest_signal=(9.0,) * 6))


def test_feedback_frozen_in_motion_is_a_gap_and_makes_no_alarm(fit: DynamicsModel) -> None:
    """An arm that seems to stand, and then is elsewhere, was found to be hit by thousands of newtonmetres."""
    whole = log(3, 3000)
    q, tau = whole.q.copy(), whole.tau.copy()
    q[1000:1160], tau[1000:1160] = q[1000], tau[1000]
    run = detect(Recording(t=whole.t, q=q, tau=tau), UR5E, fit, [THETA] * 6)
    assert run.events == ()
    rows = run.no_data_rows()
    assert rows["frozen"] == 159
    assert run.no_data[1001:1160].all()
    assert run.no_data.sum() == pytest.approx(159 + 2 / CUTOFF_HZ / DT + 2 * AT_ENDS, abs=3)
    assert any("Frozen feedback in 159 rows" in note for note in run.notes)
    # A standing arm of a simulator repeats itself, and may be allowed to.
    allowed = detect(Recording(t=whole.t, q=q, tau=tau), UR5E, fit, [1e9] * 6, DetectorSettings(frozen_s=np.inf))
    assert "frozen" not in allowed.no_data_rows()
