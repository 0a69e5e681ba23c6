"""Coulomb friction that builds up over a presliding travel after a reversal: its state, in fits and in their files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.identification import DynamicsFit, identify_dynamics
from bumpstop.identification.dynamics.coulomb_sign import coulomb_signs
from bumpstop.identification.segments.motion import UniformMotion
from bumpstop.recording import Recording
from identification.test_dynamics_fit import COULOMB, parameter, planted

GRADUAL, TRAVEL = 3, 0.03  # a joint whose friction builds up, and the travel over which it does


def to_and_fro(rows: int, dt: float) -> tuple[UniformMotion, np.ndarray, np.ndarray]:
    """One joint whose speed is a line up and down; with the turning points of its speed's sign, as times and ways."""
    t = dt * np.arange(rows)
    period = 0.7
    phase = (t / period + 0.13) % 1.0
    speed = np.where(phase < 0.5, 4 * phase - 1, 3 - 4 * phase)  # from -1 to 1 rad/s and back
    return UniformMotion(t, np.zeros((rows, 1)), speed[:, None], np.zeros((rows, 1)), 1 / dt), t, speed


def test_the_state_is_that_of_the_law() -> None:
    """Against small steps of dz/dx, where the speed is a straight line from row to row."""
    dt, travel, fine = 0.0175, 0.05, 2000
    motion, t, speed = to_and_fro(160, dt)
    wanted = [np.tanh(speed[0] / 0.01)]
    for k in range(t.size - 1):
        z = wanted[-1]
        v = speed[k] + (speed[k + 1] - speed[k]) * (np.arange(fine) + 0.5) / fine
        for way in v * dt / fine:
            z += (np.sign(way) - z) * abs(way) / travel
        wanted.append(z)
    found = coulomb_signs(motion, (), np.array([0.01]), np.array([travel]))[:, 0]
    # Of steps h = 0.0175 / 0.05 / 2000 Euler's error stays below h / e.
    np.testing.assert_allclose(found, wanted, atol=6.5e-5)
    assert np.abs(found).max() <= 1
    # It is behind the sign of the speed, and does not creep away: every round is the last one.
    rounds = found[40:].reshape(3, 40)
    np.testing.assert_allclose(rounds[1:], rounds[:-1], atol=1e-4)
    assert np.abs(rounds[0] - np.sign(speed[40:80])).max() > 1


def test_a_short_travel_is_the_sign_of_the_speed() -> None:
    """Within a row, too: a reversal between two rows is behind the second."""
    motion, _, speed = to_and_fro(400, 0.01307)
    found = coulomb_signs(motion, (), np.array([1e-9]), np.array([1e-12]))[:, 0]
    np.testing.assert_allclose(found, np.sign(speed), atol=1e-9)


def test_every_segment_begins_anew() -> None:
    """Behind a gap, and where another recording begins: with the sign of its own speed, as alone."""
    motion, t, _ = to_and_fro(300, 0.01)
    for behind in (t[149] + 5.0, t[0]):
        parts = [motion.part(slice(0, 150)), motion.part(slice(150, 300))]
        parts[1] = replace(parts[1], t=parts[1].t - parts[1].t[0] + behind)
        both = UniformMotion(
            *(np.concatenate([getattr(part, name) for part in parts]) for name in ("t", "q", "qd", "qdd")),
            motion.rate_hz,
        )
        shape = (), np.array([0.02]), np.array([0.3])
        alone = np.concatenate([coulomb_signs(part, *shape) for part in parts])
        np.testing.assert_array_equal(coulomb_signs(both, *shape), alone)
        assert np.abs(alone - coulomb_signs(motion, *shape)).max() > 0.1


def gradual(log: Recording) -> Recording:
    """The same arm, its joint 4 with friction that builds up, by the positions alone."""
    assert log.tau is not None
    assert log.qd is not None
    q, z = log.q[:, GRADUAL], np.sign(log.qd[:, GRADUAL])
    for k in range(1, q.size):
        way = q[k] - q[k - 1]
        z[k] = np.sign(way) + (z[k - 1] - np.sign(way)) * np.exp(-abs(way) / TRAVEL)
    tau = log.tau.copy()
    tau[:, GRADUAL] += COULOMB / (1 + GRADUAL) * (z - np.sign(log.qd[:, GRADUAL]))
    return replace(log, tau=tau)


def test_a_joint_takes_its_travel_and_files_keep_it(tmp_path: Path) -> None:
    """The planted joint and no other; what it predicts elsewhere; values that no file may have are refused."""
    robot = bs.Robot.load("ur10e")
    fit = identify_dynamics(gradual(planted(robot, 3)), robot, cutoff_hz=6.0)
    assert fit.model.presliding is not None
    np.testing.assert_array_equal(fit.model.presliding, [np.nan] * 3 + [TRAVEL] + [np.nan] * 2)
    value, error = parameter(fit, "coulomb_4")
    assert abs(value - COULOMB / 4) < 4 * error
    assert f"friction builds up after a reversal: {robot.joints[GRADUAL].name} over 0.03 rad" in str(fit)
    other = gradual(planted(robot, 4, noise=0.0))
    lacks = replace(fit, model=replace(fit.model, presliding=None))
    left, without = (1 - own.score(other)[GRADUAL].r2 for own in (fit, lacks))
    assert left < 0.2 * without
    path = tmp_path / "model.toml"
    fit.save(path)
    again = DynamicsFit.load(path)
    assert [score.rmse for score in again.score(other)] == [score.rmse for score in fit.score(other)]
    text = path.read_text(encoding="utf-8")
    for spoil, message in (
        ("presliding = [-0.1, 0, 0, 0, 0, 0] #", "presliding is not one of 0 or above for each joint"),
        ("presliding = [0.1] #", "presliding is not one of 0 or above for each joint"),
        ("presliding = [0, 0, inf, 0, 0, 0] #", "a figure is not finite"),
    ):
        path.write_text(text.replace("presliding = ", spoil), encoding="utf-8")
        with pytest.raises(bs.InputError, match=message):
            DynamicsFit.load(path)


def test_where_the_sign_turns_at_once_no_travel_is_taken() -> None:
    robot = bs.Robot.load("ur10e")
    for seed in (1, 5):
        assert identify_dynamics(planted(robot, seed), robot, cutoff_hz=6.0).model.presliding is None
