"""Planted parameters recovered from simulated torques, and real arms predicted on data not used in the fit."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.identification import (
    DynamicsFit,
    identify_dynamics,
    inertial_names,
    inertial_regressor,
)
from bumpstop.identification.statistics.essential_parameters import essential_values
from bumpstop.model import inverse_dynamics
from bumpstop.recording import Recording
from identification.recorded import TX40_COLUMNS
from model.urdf_cases import scaled

ROOT = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("BUMPSTOP_SHARED", ROOT.parent / "shared"))
COULOMB, VISCOUS, ROTOR, OFFSET = 4.0, 2.5, 0.3, 0.7  # of every joint, times what makes joints differ


def excited(robot: bs.Robot, seconds: float, rate: float, seed: int) -> tuple[np.ndarray, ...]:
    """A smooth motion with five harmonics in every joint: t, q, qd, qdd."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, seconds, 1 / rate)
    middle = np.where(np.isfinite(robot.lower + robot.upper), (robot.lower + robot.upper) / 2, 0.0)
    q, qd, qdd = (np.zeros((t.size, robot.dof)) for _ in range(3))
    for harmonic in range(1, 6):
        w = 2 * np.pi * 0.11 * harmonic
        a, b = rng.normal(size=(2, robot.dof)) * 0.5 / harmonic
        q += a * np.sin(np.outer(t, [w] * robot.dof)) + b * np.cos(np.outer(t, [w] * robot.dof))
        qd += w * (a * np.cos(np.outer(t, [w] * robot.dof)) - b * np.sin(np.outer(t, [w] * robot.dof)))
        qdd -= w * w * (a * np.sin(np.outer(t, [w] * robot.dof)) + b * np.cos(np.outer(t, [w] * robot.dof)))
    return t, q + middle, qd, qdd


def planted(robot: bs.Robot, seed: int, *, noise: float = 0.6, seconds: float = 25.0) -> Recording:
    """Torques of a robot with its own inertia and known friction; noise correlated by 0.8 from sample to sample."""
    t, q, qd, qdd = excited(robot, seconds, 100.0, seed)
    factor = 1 / (1 + np.arange(robot.dof))
    tau = inverse_dynamics(robot, q, qd, qdd)
    tau += factor * (COULOMB * np.sign(qd) + VISCOUS * qd + ROTOR * qdd + OFFSET)
    rng = np.random.default_rng(1000 + seed)
    white, coloured = rng.normal(size=tau.shape), np.zeros_like(tau)
    for k in range(1, t.size):
        coloured[k] = 0.8 * coloured[k - 1] + 0.6 * white[k]
    return Recording(t=t, q=q, qd=qd, tau=tau + noise * factor * coloured)


def parameter(fit: DynamicsFit, name: str) -> tuple[float, float]:
    place = [own.split()[0] for own in fit.names].index(name)
    return float(fit.model.values[place]), float(fit.errors[place])


def test_regressor_times_parameters_is_newton_euler() -> None:
    robot = bs.Robot.load("panda")
    rng = np.random.default_rng(3)
    q, qd, qdd = rng.normal(size=(3, 40, robot.dof))
    values = []
    for joint in robot.joints:
        link = joint.inertia
        assert link is not None
        c, m = np.array(link.center), link.mass
        about_origin = np.array(link.tensor) + m * (c @ c * np.eye(3) - np.outer(c, c))
        values += [m, *(m * c), *about_origin.diagonal(), *about_origin[[0, 0, 1], [1, 2, 2]]]
    columns = inertial_regressor(robot, q, qd, qdd, (0.0, 0.0, -9.80665))
    assert len(inertial_names(robot)) == columns.shape[2] == 70
    unpadded = inverse_dynamics(robot, q, qd, qdd) - [joint.rotor_inertia for joint in robot.joints] * qdd
    np.testing.assert_allclose(columns @ values, unpadded, rtol=1e-9, atol=1e-9)


def test_planted_friction_is_recovered_and_unseen_motion_predicted() -> None:
    robot = bs.Robot.load("ur10e")
    fit = identify_dynamics(planted(robot, 1), robot, cutoff_hz=8.0)
    for j in range(robot.dof):
        for name, truth in (("viscous", VISCOUS), ("coulomb", COULOMB)):
            value, error = parameter(fit, f"{name}_{j + 1}")
            assert abs(value - truth / (1 + j)) < 5 * error + 0.02 * truth / (1 + j), (name, j)
    other = planted(robot, 2, noise=0.0)
    assert min(score.r2 for score in fit.score(other)) > 0.995
    # A vertical first axis: gravity does not act about it, and only one of its moments can be seen.
    assert {"m_1", "mx_1", "Ixx_1", "Ixy_1"} <= set(fit.unobservable)


def test_intervals_hold_under_correlated_noise() -> None:
    """Pooled over joints and seeds, 95 % intervals of viscous friction hold the truth about that often."""
    robot = bs.Robot.load("ur10e")
    inside = []
    for seed in range(4):
        fit = identify_dynamics(planted(robot, seed, seconds=20.0), robot, cutoff_hz=6.0)
        for j in range(robot.dof):
            value, error = parameter(fit, f"viscous_{j + 1}")
            inside.append(abs(value - VISCOUS / (1 + j)) < 1.96 * error)
    # 24 intervals: fewer than 20 inside has one chance in 300, by the binomial law.
    assert sum(inside) >= 20


def test_the_cut_off_is_chosen_by_held_out_error() -> None:
    robot = bs.Robot.load("ur5e")
    fit = identify_dynamics(planted(robot, 4, seconds=8.0), robot)
    assert fit.held_out[fit.model.cutoff_hz] <= 1.01 * min(fit.held_out.values())
    assert len(fit.held_out) > 3


def test_essential_parameters_are_those_told_from_zero() -> None:
    """Three planted columns stay and noise columns leave; what stays is the least squares on what stayed."""
    rng = np.random.default_rng(11)
    matrix = rng.normal(size=(4000, 12)) * 10.0 ** rng.uniform(-3, 3, 12)
    truth = np.zeros(12)
    truth[[1, 4, 9]] = 1 / np.linalg.norm(matrix[:, [1, 4, 9]], axis=0) * np.array([40.0, -60.0, 50.0])
    target = matrix @ truth + rng.normal(size=4000)
    blocks = [slice(part[0], part[-1] + 1) for part in np.array_split(np.arange(4000), 40)]
    values = essential_values(matrix, target, blocks, telling=4.0)  # one of 9 beyond 4: once in 1700
    assert list(np.flatnonzero(values)) == [1, 4, 9]
    own, *_ = np.linalg.lstsq(matrix[:, [1, 4, 9]], target, rcond=None)
    np.testing.assert_allclose(values[[1, 4, 9]], own, rtol=1e-9)
    assert not essential_values(matrix, rng.normal(size=4000), blocks, telling=6.0).any()


def test_predictions_leave_out_what_is_not_told_from_zero(tmp_path: Path) -> None:
    """On unseen noiseless motion the essential values predict better; intervals are of all base parameters."""
    robot = bs.Robot.load("ur10e")
    fit = identify_dynamics(planted(robot, 24, noise=3.0, seconds=10.0), robot, cutoff_hz=6.0)
    assert fit.model.predicting is not None
    assert 0 < np.count_nonzero(fit.model.predicting) < fit.model.values.size
    every = replace(fit, model=replace(fit.model, predicting=None))
    other = planted(robot, 8, noise=0.0)
    errors = [np.mean([score.rmse**2 for score in own.score(other)]) for own in (fit, every)]
    assert errors[0] < errors[1]
    path = tmp_path / "model.toml"
    fit.save(path)
    assert np.array_equal(DynamicsFit.load(path).model.predicting, fit.model.predicting)
    # Files from before hold no such values; those with some of them are damaged.
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(line for line in lines if not line.startswith("predicting")), encoding="utf-8")
    assert DynamicsFit.load(path).model.predicting is None
    lines.pop(next(i for i, line in enumerate(lines) if line.startswith("predicting")))
    path.write_text("".join(lines), encoding="utf-8")
    with pytest.raises(bs.InputError, match="only some parameters"):
        DynamicsFit.load(path)


def test_files_repeat_the_fit(tmp_path: Path) -> None:
    robot = bs.Robot.load("ur5e")
    log = planted(robot, 5, seconds=12.0)
    fit = identify_dynamics(log, robot, cutoff_hz=6.0, couplings=[[(4, 1.0), (5, 1.0)]])
    path = tmp_path / "model.toml"
    fit.save(path)
    again = DynamicsFit.load(path)
    assert again.names == fit.names
    assert "metres" not in str(fit)
    doubtful = replace(fit.model, robot=scaled(robot, 1e3))
    assert "note: The lengths of ur5e do not look like metres" in str(replace(fit, model=doubtful))
    assert [score.rmse for score in again.score(log)] == [score.rmse for score in fit.score(log)]
    for spoil, message in (
        (lambda text: text.replace('kind = "dynamics"', 'kind = "other"'), "no file of fitted dynamics"),
        (lambda text: text.replace("rows_used", "rows"), "unknown key 'rows'"),
        (lambda text: text.replace('column = "', 'column = "x'), "cannot be used"),
        (lambda text: text.replace("value = ", "value = nan # "), "cannot be used"),
        (lambda text: text.replace("value = ", f"value = {10**400} # "), "cannot be used"),
        (lambda text: text.replace("value = ", "value = 1e308 # "), r"1e\+308 is beyond 1e\+12"),
        (lambda text: text.replace("rows_used = ", "rows_used = inf # "), "cannot be used"),
        (lambda text: text.replace("cutoff_hz = ", "cutoff_hz = -"), "no frequency above 0"),
        (lambda text: text.replace("sign_speed = [", "sign_speed = [-"), "sign_speed is not one above 0"),
        (lambda text: text.replace("sign_speed = ", "sign_speed = [0.1, 0.1] # "), "sign_speed is not one above 0"),
        (lambda text: text.replace("couplings = [[[5,", "couplings = [[[0,"), "joints are 1 to 6"),
        (lambda text: text.replace("couplings = [[[5,", "couplings = [[[7,"), "joints are 1 to 6"),
        (lambda text: text[:40], "is not valid TOML"),
    ):
        path.write_text(spoil(path.read_text(encoding="utf-8")), encoding="utf-8")
        with pytest.raises(bs.InputError, match=message):
            DynamicsFit.load(path)
        fit.save(path)


def test_what_cannot_be_fitted_is_refused() -> None:
    robot = bs.Robot.load("ur5e")
    log = planted(robot, 6, seconds=5.0)
    with pytest.raises(bs.InputError, match="has no joint torque"):
        identify_dynamics(Recording(t=log.t, q=log.q), robot)
    with pytest.raises(bs.InputError, match="has 6 joints"):
        identify_dynamics(log, bs.Robot.load("panda"))
    with pytest.raises(bs.InputError, match="wanted at least 50"):
        identify_dynamics(Recording(t=log.t[:20], q=log.q[:20], tau=log.tau[:20]), robot, cutoff_hz=5.0)


def test_friction_bends_where_it_does() -> None:
    """Friction that grows with the root of the speed is found and told; friction that is straight stays straight."""
    robot = bs.Robot.load("ur10e")
    log, other = planted(robot, 3, seconds=15.0), planted(robot, 4, noise=0.0, seconds=10.0)
    straight = identify_dynamics(log, robot, cutoff_hz=6.0)
    assert straight.model.top_speed is None

    def with_root(one: Recording) -> Recording:
        assert one.qd is not None
        assert one.tau is not None
        return replace(one, tau=one.tau + 8.0 * np.sign(one.qd) * np.sqrt(np.abs(one.qd)) / (1 + np.arange(robot.dof)))

    fit = identify_dynamics(with_root(log), robot, cutoff_hz=6.0)
    assert fit.model.top_speed is not None
    bent = np.flatnonzero(np.isfinite(fit.model.top_speed))
    assert bent.size >= 3  # joints whose motion shows it beyond chance
    for j in bent:
        top = fit.model.top_speed[j]
        value, error = parameter(fit, f"bend_{j + 1}")
        assert abs(value - 8.0 * np.sqrt(top) / (1 + j)) < 4 * error, j
    assert min(score.r2 for score in fit.score(with_root(other))) > 0.99


REAL = {
    "ur10": ("ur10_ros2/ur10_exciting_trajectory.db3", 8.0, [0.977, 0.991, 0.995, 0.988, 0.972, 0.969]),
    "panda": ("panda_ros2/panda_exciting_trajectory.db3", 4.0, [0.80, 0.999, 0.997, 0.996, 0.955, 0.996, 0.973]),
    "tx40": ("staubli_tx40/pos_read_data.csv", 20.0, [0.995, 0.995, 0.989, 0.986, 0.899, 0.957]),
}
MOTORS = {"tx40": [[(4, 1.0), (5, 1.0)]]}


@pytest.mark.parametrize("name", list(REAL))
def test_real_arms_on_the_last_quarter(name: str) -> None:
    """R2 on data not used in the fit, beside that of a generic least-squares fit of others: 5.25 of 7 s of the TX40."""
    file, filter_hz, others = REAL[name]
    if not (SHARED / "data" / file).exists():
        pytest.skip(f"{SHARED / 'data' / file} is absent: set BUMPSTOP_SHARED")
    if name == "tx40":
        robot = bs.Robot.from_urdf(SHARED / "data/staubli_tx40/tx40_mdh_modified.urdf")
        log = Recording.load(SHARED / "data" / file, columns=TX40_COLUMNS, robot=robot).between(0.0, 7.0)
    else:
        robot, log = bs.Robot.load(name), Recording.load(SHARED / "data" / file)
    split = log.t[0] + 0.75 * (log.t[-1] - log.t[0])
    fit = identify_dynamics(log.between(log.t[0], split), robot, couplings=MOTORS.get(name, ()))
    found = np.array([score.r2 for score in fit.score(log.between(split, log.t[-1]), filter_hz=filter_hz)])
    assert np.all(found > np.array(others) - 0.01)
    assert found.mean() > np.mean(others)
