"""Rows of several recordings: filtered before they are thinned, and never across a seam or a gap."""

from __future__ import annotations

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.identification import Payload, identify_dynamics, with_payload
from bumpstop.identification.motion import lowpass
from bumpstop.identification.torque_rows import TorqueRows
from bumpstop.identification.validation import compare_dynamics
from bumpstop.model import inverse_dynamics
from bumpstop.recording import Recording
from identification.test_dynamics_fit import COULOMB, VISCOUS, excited, parameter, planted

NAMES = ("t", "q", "qd", "qdd")


def joined(log: Recording, other: Recording, gap: float) -> Recording:
    """Two recordings in one, with a gap between."""
    assert log.qd is not None
    assert other.qd is not None
    assert log.tau is not None
    assert other.tau is not None
    t = other.t - other.t[0] + log.t[-1] + gap
    return Recording(
        t=np.concatenate([log.t, t]),
        q=np.concatenate([log.q, other.q]),
        qd=np.concatenate([log.qd, other.qd]),
        tau=np.concatenate([log.tau, other.tau]),
    )


def test_stretches_never_mix() -> None:
    """Rows of two recordings are those of each, one after the other; so are those on both sides of a gap."""
    robot = bs.Robot.load("ur5e")
    logs = [planted(robot, seed, seconds=6.0) for seed in (1, 2)]
    alone = [TorqueRows.of([log], robot, 5.0) for log in logs]
    both = TorqueRows.of(logs, robot, 5.0)
    gap = TorqueRows.of([joined(*logs, 0.7)], robot, 5.0)
    assert [rows.stop - rows.start for rows in both.stretches] == [rows.motion.t.size for rows in alone]
    for rows in (both, gap):
        for name in NAMES[1:]:
            parts = [getattr(own.motion, name) for own in alone]
            np.testing.assert_allclose(getattr(rows.motion, name), np.concatenate(parts), rtol=1e-9, atol=1e-9)
        for cutoff in (5.0, 20.0):
            parts = [own.torque_below(cutoff) for own in alone]
            np.testing.assert_allclose(rows.torque_below(cutoff), np.concatenate(parts), rtol=1e-8, atol=1e-8)
            parts = [own.filtered(own.torque, cutoff) for own in alone]
            np.testing.assert_allclose(rows.filtered(rows.torque, cutoff), np.concatenate(parts), rtol=1e-8, atol=1e-8)
    # Without the gap the jump from one to the other is filtered as if the arm had made it.
    through = TorqueRows.of([joined(*logs, 0.01)], robot, 5.0)
    assert np.abs(through.motion.qdd).max() > 2 * np.abs(both.motion.qdd).max()


def test_torque_is_filtered_before_it_is_thinned() -> None:
    """A hum just above a multiple of the thinner rate would come back as a slow wave."""
    robot = bs.Robot.load("ur5e")
    t, q, qd, _ = excited(robot, 10.0, 1000.0, 1)
    hum = np.sin(2 * np.pi * 90.3 * t)
    log = Recording(t=t, q=q, qd=qd, tau=np.tile(hum[:, None], (1, robot.dof)))
    rows = TorqueRows.of([log], robot, 3.0)
    assert rows.motion.rate_hz == pytest.approx(30.3, rel=0.01)
    inside = slice(10, -10)
    assert np.abs(lowpass(rows.torque, rows.motion.rate_hz, 12.0)[inside]).max() > 0.5
    assert np.abs(rows.torque_below(12.0)[inside]).max() < 1e-3


def test_two_recordings_show_what_one_does_not() -> None:
    """Joints 1 to 3 move in one recording, the others in the next: together they show the friction of all."""
    robot = bs.Robot.load("ur10e")
    factor = 1 / (1 + np.arange(robot.dof))
    logs = []
    for seed, moves in ((1, slice(0, 3)), (2, slice(3, 6))):
        t, q, qd, qdd = excited(robot, 9.0, 100.0, seed)
        still = np.ones(robot.dof, dtype=bool)
        still[moves] = False
        q[:, still], qd[:, still], qdd[:, still] = q[0, still], 0.0, 0.0
        tau = inverse_dynamics(robot, q, qd, qdd) + factor * (COULOMB * np.sign(qd) + VISCOUS * qd)
        tau += 0.3 * factor * np.random.default_rng(seed).normal(size=tau.shape)
        logs.append(Recording(t=t, q=q, qd=qd, tau=tau))
    one = identify_dynamics(logs[0], robot, cutoff_hz=6.0)
    assert {"viscous_4", "viscous_5", "viscous_6"} <= set(one.unseen)
    fit = identify_dynamics(logs, robot, cutoff_hz=6.0)
    assert not any(name.startswith("viscous") for name in fit.unseen)
    for j in range(robot.dof):
        value, error = parameter(fit, f"viscous_{j + 1}")
        assert abs(value - factor[j] * VISCOUS) < 5 * error + 0.02 * factor[j], j
    assert max(score.rmse for score in fit.score(logs)) < 0.5
    assert fit.rows_used == 2 * one.rows_used


def test_a_declared_payload_is_no_part_of_the_arm() -> None:
    robot = bs.Robot.load("ur5e")
    center = (0.02, -0.01, 0.07)
    bare, carrying = planted(robot, 1, seconds=7.0), planted(with_payload(robot, 3.0, center), 2, seconds=7.0)
    payloads = [None, Payload(3.0, center)]
    fit = identify_dynamics([bare, carrying], robot, cutoff_hz=6.0, payloads=payloads)
    wrong = identify_dynamics([bare, carrying], robot, cutoff_hz=6.0)
    other = planted(robot, 3, noise=0.0, seconds=8.0)
    assert min(score.r2 for score in fit.score(other)) > 0.995
    errors = [np.mean([score.rmse**2 for score in own.score(other)]) for own in (fit, wrong)]
    assert errors[0] < 0.2 * errors[1]
    declared, silent = (fit.score(carrying, payloads=own)[1].rmse for own in ([payloads[1]], ()))
    assert declared < 0.2 * silent
    # On a page the recordings follow one another, whatever their clocks say.
    page = compare_dynamics(fit, [bare, carrying], payloads=payloads)
    assert (np.diff(page.t) >= 0).all()
    assert page.t[-1] > bare.duration + 0.9 * carrying.duration
    assert page.scores()[1].rmse < 0.2 * silent


def test_what_cannot_be_joined_is_refused() -> None:
    robot = bs.Robot.load("ur5e")
    log = planted(robot, 1, seconds=4.0)
    with pytest.raises(bs.InputError, match="recordings: there are none"):
        identify_dynamics([], robot)
    with pytest.raises(bs.InputError, match="payloads: 1 for 2 recordings"):
        identify_dynamics([log, log], robot, cutoff_hz=5.0, payloads=[None])
    with pytest.raises(bs.InputError, match="is -1"):
        Payload(-1.0)
    short = joined(log, log, 0.5).between(3.4, 5.0)
    with pytest.raises(bs.InputError, match="in 2 stretches too short to use"):
        identify_dynamics(short, robot, cutoff_hz=5.0)
