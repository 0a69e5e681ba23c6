"""Planted gains, friction and inertia recovered from currents alone; scales that is not identifiable are refused by
name."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.identification import DynamicsFit, Payload, identify_gains, with_payload
from bumpstop.model import inverse_dynamics
from bumpstop.recording import Recording
from identification.drives import fourier

ALL_GAINS = np.array([11.0, 11.5, 10.0, 8.0, 7.5, 7.0, 6.0])  # Nm/A
GAINS = ALL_GAINS[:6]
FACTOR = 1 / (1 + np.arange(6))
COULOMB, VISCOUS, ROTOR, OFFSET = 4.0, 2.5, 0.3, 0.7  # times the factor
LOAD = Payload(3.0, (0.03, 0.0, 0.08))
ROBOT = "ur5e"


def currents(robot: bs.Robot, seed: int, *, seconds: float = 10.0, noise: float = 0.1) -> Recording:
    """Currents of known gains at 94 Hz, uneven by 10 %, their noise correlated by 0.8 from sample to sample."""
    from scipy.signal import lfilter

    t, q, qd, qdd = fourier(robot, seconds, 94.0, seed)
    rng = np.random.default_rng(seed)
    tau = inverse_dynamics(robot, q, qd, qdd)
    factor = 1 / (1 + np.arange(robot.dof))
    tau += factor * (COULOMB * np.sign(qd) + VISCOUS * qd + ROTOR * qdd + OFFSET)
    current = tau / ALL_GAINS[: robot.dof] + noise * lfilter([0.6], [1, -0.8], rng.normal(size=tau.shape), axis=0)
    shift = rng.uniform(-0.05, 0.05, t.size) / 94.0
    return Recording(t=t + shift, q=q + shift[:, None] * qd, current=current)


@cache
def with_and_without() -> tuple[Recording, Recording]:
    robot = bs.Robot.load(ROBOT)
    return currents(robot, 1), currents(with_payload(robot, LOAD.mass, LOAD.center), 2)


@cache
def fitted() -> DynamicsFit:
    return identify_gains(with_and_without(), bs.Robot.load(ROBOT), payloads=[None, LOAD], cutoff_hz=10.0)


def errors_in_sd(fit: DynamicsFit) -> np.ndarray:
    assert fit.model.gains is not None
    assert fit.gain_errors is not None
    return np.abs(fit.model.gains - GAINS) / fit.gain_errors


def test_a_known_load_gives_the_scale() -> None:
    """Gains and friction are the planted ones, and the torque of another motion is predicted in Nm."""
    fit = fitted()
    assert not any(name.startswith("gain") for name in fit.unobservable)
    assert errors_in_sd(fit).max() < 4.5
    np.testing.assert_allclose(fit.model.gains, GAINS, rtol=0.15)  # type: ignore[arg-type]
    np.testing.assert_allclose(fit.model.gains[1:3], GAINS[1:3], rtol=0.03)  # type: ignore[index]
    names = [name.split()[0] for name in fit.names]
    for j in range(6):
        place = names.index(f"viscous_{j + 1}")
        truth = VISCOUS * FACTOR[j]
        assert abs(fit.model.values[place] - truth) < 5 * fit.errors[place] + 0.02 * truth, j
    robot = bs.Robot.load(ROBOT)
    t, q, qd, qdd = fourier(robot, 8.0, 94.0, 7)
    tau = inverse_dynamics(robot, q, qd, qdd)
    tau += FACTOR * (COULOMB * np.sign(qd) + VISCOUS * qd + ROTOR * qdd + OFFSET)
    assert min(score.r2 for score in fit.score(Recording(t=t, q=q, tau=tau))[:5]) > 0.97


def test_gains_scale_with_the_currents() -> None:
    """Currents in other units, and of the other sign, have gains in those units, and all else is the same."""
    units = np.array([1.0, -1.0, 1000.0, 1.0, 0.01, 1.0])
    turned = [Recording(t=log.t, q=log.q, current=log.current * units) for log in with_and_without()]  # type: ignore[operator]
    fit, usual = identify_gains(turned, bs.Robot.load(ROBOT), payloads=[None, LOAD], cutoff_hz=10.0), fitted()
    assert fit.model.gains is not None
    np.testing.assert_allclose(fit.model.gains * units, usual.model.gains, rtol=1e-4)  # type: ignore[arg-type]
    assert fit.names == usual.names
    far = np.abs(fit.model.values - usual.model.values) / usual.errors
    assert far.max() < 0.05


def test_a_known_gain_gives_the_scale_as_far_as_joints_share_links() -> None:
    """The wrist's last joint shares nothing that shows: its gain is named, the others are found."""
    robot = bs.Robot.load(ROBOT)
    log = currents(robot, 3, seconds=15.0, noise=0.02)
    fit = identify_gains(log, robot, known={"shoulder_lift_joint": GAINS[1]}, cutoff_hz=10.0)
    assert fit.model.gains is not None
    assert fit.gain_errors is not None
    assert fit.model.gains[1] == GAINS[1]
    assert fit.gain_errors[1] == 0
    assert "gain_6" in fit.unobservable
    seen = np.isfinite(fit.gain_errors) & (fit.gain_errors > 0)
    assert seen.sum() >= 3
    assert (np.abs(fit.model.gains - GAINS)[seen] < 4.5 * fit.gain_errors[seen]).all()
    # What has no scale in Nm is told in currents, and its R2 whatever the gain is.
    hidden = np.isinf(fit.gain_errors)
    found = fit.predict(log)
    assert found.names == tuple(joint.name for joint in robot.joints)
    assert found.units == tuple(np.where(hidden, "A", "Nm").tolist())
    assert [score.free_gain for score in found.scores()] == hidden.tolist()
    assert log.current is not None
    np.testing.assert_allclose(found.measured[:, 5].std(), log.current[:, 5].std(), rtol=0.05)
    assert min(score.r2 for score in found.scores()) > 0.9


def test_scales_that_cannot_be_seen_are_refused() -> None:
    robot = bs.Robot.load(ROBOT)
    one, loaded = with_and_without()
    with pytest.raises(bs.InputError, match="gains: their scale is not identifiable: nothing known is carried"):
        identify_gains(one, robot)
    with pytest.raises(bs.InputError, match="all recordings carry the same"):
        identify_gains([one, loaded], robot, payloads=[LOAD, LOAD])
    with pytest.raises(bs.InputError, match="'elbow' is no joint of ur5e"):
        identify_gains(one, robot, known={"elbow": 3.0})
    with pytest.raises(bs.InputError, match=r"the gain of elbow_joint is 0\.0"):
        identify_gains(one, robot, known={"elbow_joint": 0.0})
    with pytest.raises(bs.InputError, match="has no motor current"):
        identify_gains(Recording(t=one.t, q=one.q), robot, known={"elbow_joint": 3.0})
    # A straw is a known load, too, but shows nothing against the noise.
    short = [currents(robot, seed, seconds=4.0) for seed in (1, 5)]
    with pytest.raises(bs.InputError, match="not identifiable: shoulder_pan_joint, shoulder_lift_joint"):
        identify_gains(short, robot, payloads=[None, Payload(1e-4)], cutoff_hz=5.0)


def test_files_keep_the_gains(tmp_path: Path) -> None:
    fit, path = fitted(), tmp_path / "model.toml"
    fit.save(path)
    again = DynamicsFit.load(path)
    assert np.array_equal(again.model.gains, fit.model.gains)  # type: ignore[arg-type]
    assert np.array_equal(again.gain_errors, fit.gain_errors)  # type: ignore[arg-type]
    one, _ = with_and_without()
    assert [score.rmse for score in again.score(one)] == [score.rmse for score in fit.score(one)]
    path.write_text(path.read_text(encoding="utf-8").replace('joint = "elbow', 'joint = "knee'), encoding="utf-8")
    with pytest.raises(bs.InputError, match="not those of the robot's joints"):
        DynamicsFit.load(path)


def test_the_search_finds_the_deepest_of_several_valleys() -> None:
    """A quarter of an hour of a swinging arm: linear least squares begin at gains of a twentieth and stay in a valley
    there, fourteen standard errors and more from what was planted."""
    robot, rate, rows = bs.Robot.load("sia5d"), 100.0, 100_000
    rng = np.random.default_rng(6)
    t = np.arange(rows) / rate
    q, qd, qdd = np.zeros((3, rows, robot.dof))
    for j in range(robot.dof):
        for wave in range(1, 6):
            w, size, phase = 0.2 * np.pi * wave * (1 + 0.013 * j), 0.25 * rng.normal(), 2 * np.pi * rng.random()
            q[:, j] += size * np.sin(w * t + phase)
            qd[:, j] += size * w * np.cos(w * t + phase)
            qdd[:, j] -= size * w * w * np.sin(w * t + phase)
    gains = np.array([20.0, 20.0, 15.0, 10.0, 8.0, 8.0, 5.0])
    current = inverse_dynamics(robot, q, qd, qdd) / gains + 0.8 * np.tanh(qd / 0.01) + 0.3 * qd + 0.05 * qdd
    log = Recording(t=t, q=q + 1e-5 * rng.normal(size=q.shape), current=current + 0.05 * rng.normal(size=q.shape))
    fit = identify_gains(log, robot, known={robot.joints[1].name: gains[1]}, cutoff_hz=2.0)
    assert fit.model.gains is not None
    assert fit.gain_errors is not None
    # The torque of the last joint is small, and friction makes it up.
    assert [name for name in fit.unobservable if name.startswith("gain")] == ["gain_7"]
    found = [0, 2, 3, 4, 5]
    assert (np.abs(fit.model.gains - gains)[found] < 4 * fit.gain_errors[found]).all()
