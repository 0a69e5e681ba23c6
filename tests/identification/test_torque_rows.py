"""Rows of several recordings: filtered before they are thinned, and never across a seam or a gap."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.detection import detect
from bumpstop.identification import (
    Payload,
    compare_currents,
    identify_dynamics,
    identify_gains,
    identify_joint_model,
    identify_payload,
    with_payload,
)
from bumpstop.identification.dynamics.dynamics_system import FIT_PER_CUTOFF, System
from bumpstop.identification.dynamics.regressor_columns import regressor_columns, speeds_of, torque_of
from bumpstop.identification.segments.drive_samples import split_at_gaps
from bumpstop.identification.segments.motion import REACH_SHARE, lowpass
from bumpstop.identification.segments.torque_samples import TorqueSamples
from bumpstop.joint import JointTorqueModel
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
    """Rows of two recordings are those of each, one after the other; on both sides of a gap a period is left away."""
    robot = bs.Robot.load("ur5e")
    logs = [planted(robot, seed, seconds=6.0) for seed in (1, 2)]
    alone = [TorqueSamples.of([log], robot, 5.0) for log in logs]
    both = TorqueSamples.of(logs, robot, 5.0)
    gap = TorqueSamples.of([joined(*logs, 0.7)], robot, 5.0)
    assert [rows.stop - rows.start for rows in both.segments] == [rows.motion.t.size for rows in alone]
    assert both.rows_beside_gaps == 0
    # A period of 5 Hz is left away at ends and beside gaps alike.
    sizes = [rows.stop - rows.start for rows in gap.segments]
    assert all(abs(own.motion.t.size - size) < 2 for own, size in zip(alone, sizes, strict=True))
    assert abs(gap.rows_beside_gaps - 2 * 0.2 * logs[0].rate_hz) <= 2
    for name in NAMES[1:]:
        parts = [getattr(own.motion, name) for own in alone]
        np.testing.assert_allclose(getattr(both.motion, name), np.concatenate(parts), rtol=1e-9, atol=1e-9)
    for cutoff in (5.0, 20.0):
        parts = [own.torque_below(cutoff) for own in alone]
        np.testing.assert_allclose(both.torque_below(cutoff), np.concatenate(parts), rtol=1e-8, atol=1e-8)
    # Without the gap the jump from one to the other is filtered as if the arm had made it.
    through = TorqueSamples.of([joined(*logs, 0.01)], robot, 5.0)
    assert np.abs(through.motion.qdd).max() > 2 * np.abs(both.motion.qdd).max()


def test_no_spikes_beside_gaps() -> None:
    """A motion that goes on through lost seconds: what is kept beside them errs no more than elsewhere."""
    robot = bs.Robot.load("ur5e")
    t, q, _, qdd = excited(robot, 40.0, 100.0, 3)
    kept = np.ones(t.size, dtype=bool)
    for lost in range(3, 39, 3):
        kept[(t > lost) & (t < lost + 0.5)] = False
    log = Recording(t=t[kept], q=q[kept], tau=np.zeros_like(q[kept]))
    rows = TorqueSamples.of([log], robot, 5.0)
    assert len(rows.segments) == 13
    error = np.stack([np.interp(rows.motion.t, t, qdd[:, j]) - rows.motion.qdd[:, j] for j in range(6)])
    middle = (rows.motion.t > 3) & (rows.motion.t < 39)
    # With nothing left away it is wrong by 2.4 times its root mean square beside a gap, with a period by half of it.
    assert np.abs(error[:, middle]).max() < 0.6 * np.sqrt((qdd**2).mean())


def test_torque_is_filtered_before_it_is_thinned() -> None:
    """A hum just above a multiple of the thinner rate would come back as a slow wave."""
    robot = bs.Robot.load("ur5e")
    t, q, qd, _ = excited(robot, 10.0, 1000.0, 1)
    hum = np.sin(2 * np.pi * 90.3 * t)
    log = Recording(t=t, q=q, qd=qd, tau=np.tile(hum[:, None], (1, robot.dof)))
    rows = TorqueSamples.of([log], robot, 3.0)
    assert rows.motion.rate_hz == pytest.approx(30.3, rel=0.01)
    inside = slice(10, -10)
    assert np.abs(lowpass(rows.torque, rows.motion.rate_hz, 12.0)[inside]).max() > 0.5
    assert np.abs(rows.torque_below(12.0)[inside]).max() < 1e-3


def test_blocks_are_spread_over_all() -> None:
    """Blocks reach over a recording, and no recording goes without."""
    robot = bs.Robot.load("ur5e")
    logs = [planted(robot, 1, seconds=120.0), planted(robot, 2, seconds=8.0)]
    whole, blocks = (TorqueSamples.of(logs, robot, 5.0, limit=limit) for limit in (None, 2000))
    assert blocks.rows_whole == whole.rows_whole == whole.motion.t.size
    assert 1900 < blocks.motion.t.size <= 4000
    ends = [rows.stop for rows in blocks.segments]
    assert blocks.motion.t[0] == whole.motion.t[0]
    # Blocks of the first recording reach its end; the second follows.
    assert blocks.motion.t.max() > 119.7  # but for a period of the cut-off at its end
    assert (np.diff(blocks.motion.t) < 0).sum() == 1
    first = blocks.motion.t[: ends[-2]]
    assert np.diff(first).max() < 120 / (len(ends) - 2)
    # A limit that all rows keep changes nothing, and very many segments cost no more rows than twice the limit.
    assert np.array_equal(TorqueSamples.of(logs, robot, 5.0, limit=10_000).torque, whole.torque)
    t = logs[0].t + 0.7 * np.floor(logs[0].t / 1.5)
    short = replace(logs[0], t=t)
    assert 500 < TorqueSamples.of([short], robot, 5.0, limit=1000).motion.t.size <= 2000


@pytest.mark.parametrize(("cutoff", "measured", "shaken"), [(5.0, True, 0.0), (2.0, False, 0.3), (12.5, False, 0.3)])
def test_rows_in_blocks_are_those_of_the_whole(cutoff: float, measured: bool, shaken: float) -> None:
    """Motion, torque and columns of blocks, filtered or not, beside the same rows of the recording in one piece.

    In steps of the recorded rate, of every second and of every fifth row; with measured velocities and without; at even
    times and at shaken ones; across a gap.
    """
    robot = bs.Robot.load("ur5e")
    log = joined(planted(robot, 1, seconds=80.0), planted(robot, 2, seconds=70.0), 0.7)
    rng = np.random.default_rng(5)
    log = replace(log, t=log.t + shaken * 0.01 * rng.uniform(-1, 1, log.t.size), qd=log.qd if measured else None)
    payloads = [Payload(2.0, (0.02, 0.0, 0.05))]
    filters = (FIT_PER_CUTOFF * cutoff, cutoff, 20.0)
    whole = TorqueSamples.of([log], robot, cutoff, payloads)
    blocks = TorqueSamples.of([log], robot, cutoff, payloads, limit=1000, filters_hz=filters)
    assert blocks.motion.t.size < 0.7 * whole.motion.t.size
    assert len(blocks.segments) > 2 == len(whole.segments)
    # The very same times: a block has no grid of its own.
    places = np.searchsorted(whole.motion.t, blocks.motion.t)
    assert np.array_equal(whole.motion.t[places], blocks.motion.t)
    assert np.array_equal(whole.torque[places], blocks.torque)

    def alike(own: np.ndarray, other: np.ndarray, size: float) -> None:
        assert np.abs(own - other[places]).max() <= REACH_SHARE * size

    # What is beyond the margins moves a filtered value by a share of its range, and at the cut-off's frequency.
    turn = 2 * np.pi * cutoff
    size = float(np.ptp(whole.motion.q, axis=0).max())
    alike(blocks.motion.q, whole.motion.q, size)
    size = float(np.ptp(whole.motion.qd, axis=0).max()) if measured else size * turn
    alike(blocks.motion.qd, whole.motion.qd, size)
    alike(blocks.motion.qdd, whole.motion.qdd, size * turn)
    around = blocks.reach
    for filter_hz in filters:
        alike(blocks.torque_below(filter_hz), whole.torque_below(filter_hz), float(np.ptp(whole.torque)))
        for reach in (around, around.trimmed(filter_hz)):
            filtered = reach.filtered(reach.carried, filter_hz)
            alike(filtered, whole.reach.filtered(whole.reach.carried, filter_hz), float(np.ptp(whole.carried)))
    system, other = (System.of(rows, robot, cutoff, (), 0.03) for rows in (blocks, whole))
    inertial = slice(0, 10 * robot.dof)
    for column in range(inertial.stop):
        size = float(np.abs(other.raw[:, :, column]).max())
        alike(system.columns[:, :, column], other.columns[:, :, column], 10 * size)
    alike(system.wanted, other.wanted, 2 * float(np.ptp(whole.torque)))


def test_a_long_recording_gives_the_parameters_of_all_its_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fitted in blocks and as a whole: parameters agree within what the rows that are left out can move them."""
    robot = bs.Robot.load("ur10e")
    log = planted(robot, 1, seconds=45.0)
    whole = identify_dynamics(log, robot, cutoff_hz=8.0)
    monkeypatch.setattr("bumpstop.identification.dynamics.dynamics_fit.ENOUGH_TO_FIT", 1500)
    few = identify_dynamics(log, robot, cutoff_hz=8.0)
    # Twelve rows at either end, a period of the cut-off, are left away.
    assert few.rows_whole == whole.rows_whole == whole.rows_used == 4475
    assert 1450 < few.rows_used <= 3000
    distances = []
    for j in range(robot.dof):
        for name in ("coulomb", "viscous"):
            (own, error), (other, other_error) = (parameter(fit, f"{name}_{j + 1}") for fit in (few, whole))
            assert other_error < error
            # The whole is the best of both: their difference has the variance that the whole has less.
            distances.append((own - other) / np.sqrt(error**2 - other_error**2))
    # 12 differences at four standard deviations: one chance in 1300 by the normal law.
    assert np.abs(distances).max() < 4
    scores = [[score.rmse for score in fit.score(log)] for fit in (few, whole)]
    # Some ten parameters a joint, and noise of 1500 / 9 independent rows: predictions are worse by 3 %, give or take.
    np.testing.assert_allclose(scores[0], scores[1], rtol=0.05)
    # The fit's own rows: those of the recording without its ends, which a comparison keeps.
    own = whole.model.compare_rows(whole.model.rows(log, ends=False)).scores()
    assert [score.rmse for score in whole.score()] == [score.rmse for score in own]


def test_predictions_are_columns_times_values() -> None:
    """Torque by Newton-Euler of two chains, and the sum of the columns, are two routes to one number."""
    robot = bs.Robot.load("ur10e")
    couplings = [[(4, 1.0), (5, -0.5)]]
    motion = TorqueSamples.of([planted(robot, 3, seconds=5.0)], robot, 8.0).motion
    tops, signs = np.full(7, 1.0), np.tanh(speeds_of(motion, couplings) / 0.2)
    columns = regressor_columns(robot, motion, signs, couplings, tops)
    values = np.random.default_rng(5).normal(size=columns.shape[2])
    torque = torque_of(robot, motion, values, signs, couplings, tops)
    np.testing.assert_allclose(torque, columns @ values, rtol=1e-9, atol=1e-9 * np.abs(torque).max())


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
    assert {"viscous_4", "viscous_5", "viscous_6"} <= set(one.unobservable)
    fit = identify_dynamics(logs, robot, cutoff_hz=6.0)
    assert not any(name.startswith("viscous") for name in fit.unobservable)
    for j in range(robot.dof):
        value, error = parameter(fit, f"viscous_{j + 1}")
        assert abs(value - factor[j] * VISCOUS) < 5 * error + 0.02 * factor[j], j
    assert max(score.rmse for score in fit.score(logs)) < 0.5
    assert fit.rows_used == 2 * one.rows_used


def test_a_declared_payload_is_no_part_of_the_arm() -> None:
    robot = bs.Robot.load("ur5e")
    center = (0.02, -0.01, 0.07)
    # Seven seconds, and a period of the cut-off at either end, which a fit leaves away.
    seconds = 7.0 + 2 / 6.0
    unpadded, carrying = (
        planted(robot, 1, seconds=seconds),
        planted(with_payload(robot, 3.0, center), 2, seconds=seconds),
    )
    payloads = [None, Payload(3.0, center)]
    fit = identify_dynamics([unpadded, carrying], robot, cutoff_hz=6.0, payloads=payloads)
    wrong = identify_dynamics([unpadded, carrying], robot, cutoff_hz=6.0)
    other = planted(robot, 3, noise=0.0, seconds=8.0)
    assert min(score.r2 for score in fit.score(other)) > 0.99
    errors = [np.mean([score.rmse**2 for score in own.score(other)]) for own in (fit, wrong)]
    assert errors[0] < 0.2 * errors[1]
    declared, silent = (fit.score(carrying, payloads=own)[1].rmse for own in ([payloads[1]], ()))
    assert declared < 0.2 * silent
    # On a page the recordings follow one another, whatever their clocks say.
    page = fit.predict([unpadded, carrying], payloads=payloads)
    assert (np.diff(page.t) >= 0).all()
    assert page.t[-1] > unpadded.duration + 0.9 * carrying.duration
    assert page.scores()[1].rmse < 0.2 * silent


def test_what_cannot_be_joined_is_refused() -> None:
    robot = bs.Robot.load("ur5e")
    log = planted(robot, 1, seconds=4.0)
    with pytest.raises(bs.InputError, match="recordings: there are none"):
        identify_dynamics([], robot)
    with pytest.raises(bs.InputError, match="payloads: 1 for 2 recordings"):
        identify_dynamics([log, planted(robot, 2, seconds=4.0)], robot, cutoff_hz=5.0, payloads=[None])
    # One recording twice would halve the variance of every parameter.
    for call in (identify_dynamics, identify_joint_model):
        with pytest.raises(
            bs.InputError, match=r"recordings: number 1 and number 2 are the same; give each recording once"
        ):
            call([log, replace(log)], robot)
    with pytest.raises(bs.InputError, match="is -1"):
        Payload(-1.0)
    short = joined(log, log, 0.5).between(3.4, 5.0)
    with pytest.raises(bs.InputError, match="in 2 segments too short to use"):
        identify_dynamics(short, robot, cutoff_hz=5.0)


def test_joints_in_a_drivers_order_are_refused_everywhere() -> None:
    """A bag that was read without its robot has the driver's order; by place it would be another motion."""
    robot = bs.Robot.load("ur10e")
    names = tuple(sorted(joint.name for joint in robot.joints))
    t = 0.01 * np.arange(500)
    wave = np.sin(t)[:, None] * np.arange(1, 7)
    log = Recording(t=t, q=0.1 * wave, current=wave, tau=wave, joint_names=names)
    model = JointTorqueModel.load("sia5d")
    model = replace(
        model,
        joints=tuple(replace(own, name=joint.name) for own, joint in zip(model.joints, robot.joints, strict=True)),
    )
    calls: list[Callable[[], object]] = [
        lambda: identify_dynamics(log, robot),
        lambda: identify_gains([log, replace(log, t=t + 9)], robot, known={"elbow_joint": 10.0}),
        lambda: identify_joint_model(log, robot),
        lambda: identify_payload(log, robot),
        lambda: compare_currents(model, log, robot),
        lambda: detect(log, robot, model, [1.0] * 6),
    ]
    for call in calls:
        with pytest.raises(bs.InputError, match=r"joint_names: are those of ur10e in another order: elbow_joint"):
            call()


@pytest.mark.parametrize(
    ("period", "interval", "parts"),
    [(0.005, 0.0999, 1), (0.005, 0.1001, 2), (0.02, 0.1999, 1), (0.02, 0.2001, 2)],
)
def test_a_gap_is_longer_than_a_tenth_of_a_second_and_ten_median_intervals(
    period: float, interval: float, parts: int
) -> None:
    t = period * np.arange(100.0)
    t[60:] += interval - period
    assert split_at_gaps(t) == ([slice(0, 60), slice(60, 100)] if parts == 2 else [slice(0, 100)])
