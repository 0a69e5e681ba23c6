"""Friction that bends with the speed or grows with the load, joint by joint; rows at rest and at ends stay out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.identification import DynamicsFit, Payload, identify_dynamics, identify_gains
from bumpstop.identification.segments.rest import resting, used_rows
from bumpstop.identification.segments.torque_samples import TorqueSamples
from bumpstop.model import inverse_dynamics
from bumpstop.recording import Recording
from identification.test_dynamics_fit import COULOMB, ROTOR, VISCOUS, excited, parameter, planted
from identification.test_gains_fit import ALL_GAINS

BENT, LOADED, SHARE = (
    1,
    2,
    0.15,
)  # a joint whose friction bends, one whose friction grows with the load, and by how much


def with_laws(log: Recording, robot: bs.Robot) -> Recording:
    """The same arm with friction of joint 2 that bends, and of joint 3 that grows with the load."""
    assert log.qd is not None
    assert log.tau is not None
    load = inverse_dynamics(robot, log.q, log.qd, np.gradient(log.qd, log.t, axis=0))
    tau = log.tau.copy()
    tau[:, BENT] += 12.0 * np.sign(log.qd[:, BENT]) * np.sqrt(np.abs(log.qd[:, BENT]))
    tau[:, LOADED] += SHARE * np.sign(log.qd[:, LOADED]) * np.abs(load[:, LOADED])
    return replace(log, tau=tau)


def laws_of(fit: DynamicsFit) -> tuple[list[int], list[int]]:
    bent = [] if fit.model.top_speed is None else np.flatnonzero(np.isfinite(fit.model.top_speed)).tolist()
    return bent, list(fit.model.loaded)


def test_each_joint_takes_its_own_law(tmp_path: Path) -> None:
    """Planted laws of two joints are found there and nowhere else, their values too; the file keeps them."""
    robot = bs.Robot.load("ur10e")
    fit = identify_dynamics(with_laws(planted(robot, 3, seconds=12.0), robot), robot, cutoff_hz=6.0)
    assert laws_of(fit) == ([BENT], [LOADED])
    value, error = parameter(fit, f"load_{LOADED + 1}")
    assert abs(value - SHARE) < 4 * error
    assert error < 0.1 * SHARE
    other = with_laws(planted(robot, 4, noise=0.0, seconds=10.0), robot)
    assert min(score.r2 for score in fit.score(other)) > 0.99
    path = tmp_path / "model.toml"
    fit.save(path)
    again = DynamicsFit.load(path)
    assert laws_of(again) == laws_of(fit)
    assert again.model.predicted_by_all == fit.model.predicted_by_all
    assert [score.rmse for score in again.score(other)] == [score.rmse for score in fit.score(other)]
    text = path.read_text(encoding="utf-8")
    for spoil in ("loaded = [9] #", "loaded = [3, 3] #"):
        path.write_text(text.replace("loaded = ", spoil), encoding="utf-8")
        with pytest.raises(bs.InputError, match="loaded is no list of joints from 1 to 6"):
            DynamicsFit.load(path)


def test_each_joint_takes_its_own_law_from_currents() -> None:
    """The same from currents with one known gain: laws, the load's share, and currents of another motion.

    Laws are chosen without the ends of a recording, and each must be two standard errors better: in 20 s of this motion
    the load's is 1.97 better, so there are 30 s.
    """
    robot = bs.Robot.load("ur5e")
    gains = ALL_GAINS[:6]

    def log(seed: int, noise: float) -> Recording:
        made = with_laws(planted(robot, seed, noise=0.0, seconds=30.0), robot)
        assert made.tau is not None
        rng = np.random.default_rng(seed)
        return replace(made, tau=None, current=made.tau / gains + noise * rng.normal(size=made.q.shape))

    known = {robot.joints[1].name: float(gains[1])}
    fit = identify_gains(log(3, 0.05), robot, known=known, cutoff_hz=6.0)
    bent, loaded = laws_of(fit)
    assert BENT in bent
    assert LOADED in loaded
    assert len(bent) + len(loaded) < 5
    value, error = parameter(fit, f"load_{LOADED + 1}")
    assert abs(value - SHARE) < 4 * error
    # Essential parameters predict where they are clearly better, which they need not be; predictions are good anyhow.
    assert min(score.r2 for score in fit.score(log(4, 0.0))) > 0.995


def test_a_load_of_the_hand_loads_the_gears() -> None:
    """Friction that grows with the load is predicted for an arm that carries what it did not in the fit."""
    robot = bs.Robot.load("ur10e")
    fit = identify_dynamics(with_laws(planted(robot, 3, seconds=12.0), robot), robot, cutoff_hz=6.0)
    load = Payload(6.0, (0.0, 0.0, 0.1))
    carrying = bs.identification.with_payload(robot, load.mass, load.center)
    log = with_laws(planted(carrying, 5, noise=0.0, seconds=8.0), carrying)
    assert fit.score(log, payloads=[load])[LOADED].r2 > 0.997


def stuck(robot: bs.Robot, seed: int, *, seconds: float = 24.0) -> Recording:
    """An arm that rests for a third of the time; stiction holds it there with three quarters of Coulomb friction."""
    from identification.drives import fourier

    t, q, qd, qdd = fourier(robot, seconds, 100.0, seed, rests=6)
    factor = 1 / (1 + np.arange(robot.dof))
    still = np.abs(qd).max(axis=1) < 1e-9
    # While the arm rests, time is stretched: it stands where it is for two seconds and more.
    kept = np.repeat(np.arange(t.size), np.where(still, 6, 1))
    q, qd, qdd, still = q[kept], qd[kept], qdd[kept], still[kept]
    last = np.array([np.sign(qd[max(0, np.flatnonzero(~still[: k + 1])[-1])]) if still[k] else np.sign(qd[k])
                     for k in range(len(kept))])  # fmt: skip
    tau = inverse_dynamics(robot, q, qd, qdd) + factor * (VISCOUS * qd + ROTOR * qdd)
    tau += factor * COULOMB * np.where(still[:, None], 0.75 * np.abs(last), last)
    return Recording(
        t=0.01 * np.arange(len(kept)), q=q, tau=tau + 0.1 * np.random.default_rng(seed).normal(size=q.shape)
    )


def test_rows_at_rest_stay_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stiction all one way would be taken for offset and gravity: friction and offset are those of the motion."""
    robot = bs.Robot.load("ur10e")
    log = stuck(robot, 2)
    fit = identify_dynamics(log, robot, cutoff_hz=6.0)
    assert fit.rows_at_rest is not None
    assert (fit.rows_at_rest > 0.2 * fit.rows_used).all()
    monkeypatch.setattr(TorqueSamples, "used", property(lambda rows: np.ones_like(rows.rests)))
    every = identify_dynamics(log, robot, cutoff_hz=6.0)
    found: dict[str, list[float]] = {"own": [], "every": []}
    for name, own in (("own", fit), ("every", every)):
        found[name] = [abs(parameter(own, f"coulomb_{j + 1}")[0] * (1 + j) - COULOMB) for j in range(robot.dof)]
        found[name] += [abs(parameter(own, f"offset_{j + 1}")[0] * (1 + j)) for j in range(2, robot.dof)]
    assert np.median(found["own"]) < 0.3 * np.median(found["every"])


def test_rest_is_told_from_slow_motion() -> None:
    """A joint that stands for a second rests, one that turns back or creeps by 5 mrad/s does not."""
    t = np.arange(0, 10, 0.01)
    waits = 0.3 * np.clip(np.abs(t - 5) - 1, 0, None)
    turns, creeps = 0.5 * np.cos(0.6 * t), 0.005 * t
    q = np.stack([waits, turns, creeps], axis=1) + 2e-5 * np.random.default_rng(1).normal(size=(t.size, 3))
    rests = resting(q, 100.0)
    assert not rests[:, 1:].any()
    np.testing.assert_allclose(t[rests[:, 0]][[0, -1]], [4.0, 6.0], atol=0.02)
    assert rests[:, 0].sum() == pytest.approx(200, abs=4)
    # A joint that hardly ever moves has nothing else to be fitted to.
    mostly = np.ones((100, 2), dtype=bool)
    mostly[:40, 0] = mostly[:5, 1] = False
    assert used_rows(mostly).sum(axis=0).tolist() == [40, 100]


def test_ends_stay_out() -> None:
    """Ends of a recording, where the filter knows one side of the motion only, are neither fitted nor scored."""
    robot = bs.Robot.load("ur5e")
    t, q, _, qdd = excited(robot, 20.0, 100.0, 3)
    log = Recording(t=t, q=q, tau=np.zeros_like(q))
    rows = TorqueSamples.of([log], robot, 2.0, filters_hz=(8.0,))
    assert rows.motion.t[0] == pytest.approx(0.5, abs=0.06)
    assert rows.motion.t[-1] == pytest.approx(t[-1] - 0.5, abs=0.06)
    assert rows.rows_at_ends == pytest.approx(100, abs=2)
    # Accelerations within half a second of an end are off by up to two fifths of their size, others by a seventh.
    slow = np.stack([np.interp(rows.motion.t, t, qdd[:, j]) for j in range(6)], axis=1)
    assert np.abs(slow - rows.motion.qdd).max() < 0.15 * np.abs(qdd).max()
    around = rows.reach.motion
    slow = np.stack([np.interp(around.t, t, qdd[:, j]) for j in range(6)], axis=1)
    assert np.abs(slow - around.qdd).max() > 0.35 * np.abs(qdd).max()
    # Of a short one no more than a twentieth at either end.
    short = TorqueSamples.of([log.between(3.0, 5.0)], robot, 2.0)
    assert short.rows_at_ends == pytest.approx(20, abs=2)


def test_cut_offs_are_compared_on_the_same_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a long recording, too: every candidate is judged at the same times, and by as much of them."""
    robot = bs.Robot.load("ur5e")
    monkeypatch.setattr("bumpstop.identification.dynamics.dynamics_model_selection.ENOUGH_TO_CHOOSE", 1500)
    seen: list[Any] = []
    made = TorqueSamples.of.__func__  # type: ignore[attr-defined]

    def of(cls: type, *args: Any, **options: Any) -> TorqueSamples:
        rows: TorqueSamples = made(cls, *args, **options)
        if "rate_hz" in options:
            seen.append(rows)
        return rows

    monkeypatch.setattr(TorqueSamples, "of", classmethod(of))
    fit = identify_dynamics(planted(robot, 1, seconds=40.0), robot)
    assert len(seen) == len(fit.held_out) > 3
    assert all(np.array_equal(rows.motion.t, seen[0].motion.t) for rows in seen)
    assert all(rows.rows_whole > 3000 > rows.motion.t.size for rows in seen)
    assert fit.held_out[fit.model.cutoff_hz] <= 1.01 * min(fit.held_out.values())
