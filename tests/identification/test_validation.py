"""Validation: error by speed and acceleration, and the contact comparison, where the answer is planted."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.cli.main import main
from bumpstop.identification import identify_dynamics
from bumpstop.identification.comparison import binned_error
from bumpstop.identification.segments.rest import resting
from bumpstop.identification.validation import ContactComparison, compare_contact, contact_of
from bumpstop.recording import Recording
from cli.support import run, strict_json
from identification.test_friction_laws import stuck
from identification.test_gains_fit import GAINS, currents


def planted(robot: bs.Robot, seed: int, *, seconds: float, noise: float = 0.6) -> Recording:
    """A motion of four harmonics, torques of the robot's own inertia with friction, and noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, seconds, 0.01)
    q, qd, qdd = (np.zeros((t.size, robot.dof)) for _ in range(3))
    for harmonic in range(1, 5):
        w = 2 * np.pi * 0.13 * harmonic
        size, phase = 0.5 * rng.normal(size=robot.dof) / harmonic, rng.uniform(0, 6, size=robot.dof)
        angle = w * t[:, None] + phase
        q, qd, qdd = q + size * np.sin(angle), qd + w * size * np.cos(angle), qdd - w * w * size * np.sin(angle)
    tau = bs.model.inverse_dynamics(robot, q, qd, qdd) + 2.0 * np.tanh(qd / 0.02) + 1.5 * qd
    return Recording(t=t, q=q, qd=qd, tau=tau + noise * rng.normal(size=q.shape))


def test_statistics_are_those_of_the_error() -> None:
    """Of the fit's own score, and by numpy on the recorded rows."""
    robot = bs.Robot.load("ur5e")
    log = planted(robot, 1, seconds=10.0)
    fit = identify_dynamics(log, robot, cutoff_hz=6.0)
    found = fit.predict(log)
    assert [score.r2 for score in found.scores()] == [score.r2 for score in fit.score(log)]
    assert [score.mean for score in found.scores()] == [score.mean for score in fit.score(log)]
    error = found.predicted - found.measured
    np.testing.assert_allclose([score.sd for score in found.scores()], error.std(axis=0))


def test_error_that_a_model_lacks_shows_where_it_lacks_it() -> None:
    """A planted missing inertia is a slope over acceleration and nothing over speed."""
    rng = np.random.default_rng(1)
    speed, acceleration = rng.normal(size=(2, 40_000))
    error = -0.7 * acceleration + 0.1 * rng.normal(size=speed.size)
    by_acceleration, by_speed = (binned_error(x, error, 10) for x in (acceleration, speed))
    middle = by_acceleration.edges.mean(axis=1)
    assert np.polyfit(middle, by_acceleration.mean, 1)[0] == pytest.approx(-0.7, rel=0.03)
    assert np.abs(by_speed.mean[by_speed.rows > 500]).max() < 4 * 0.71 / np.sqrt(500)
    assert by_speed.rows.min() >= 20
    assert by_acceleration.rows.sum() > 0.99 * 0.998 * speed.size


def pressed(*, gain: float = 1.0, noise: float = 0.0) -> tuple[bs.Robot, ContactComparison]:
    """A press of up to 60 N along the tool, that turns the joints by gain times what it is."""
    robot = bs.Robot.load("sia5d")
    t = np.arange(0.0, 4.0, 0.01)
    q = np.tile(np.radians([0, 30, 0, -20, 0, -40, 0]), (t.size, 1)) + 0.01 * t[:, None]
    force = 60 * np.clip(np.minimum(t - 1, 3 - t), 0, None)
    wrench = np.zeros((t.size, 6))
    wrench[:, 0] = -force
    rotation = robot.pose(q)[:, :3, :3]
    in_base = np.einsum("nij,nj->ni", rotation, wrench[:, :3])
    torque = gain * np.einsum("nij,ni->nj", robot.jacobian(q)[:, :3], in_base)
    torque += noise * np.random.default_rng(2).normal(size=torque.shape)
    return robot, compare_contact(robot, t, q, torque, wrench)


def test_contact_force_is_the_measured_one_times_the_planted_gain() -> None:
    for gain in (1.0, 1.2):
        _, found = pressed(gain=gain)
        np.testing.assert_allclose(found.estimated[found.judged], gain * found.force[found.judged])
        np.testing.assert_allclose(found.all_joints[found.judged], gain * found.force[found.judged])
        np.testing.assert_allclose(found.error[found.judged], (gain - 1) * found.force[found.judged], atol=1e-9)


def test_small_torques_are_not_judged() -> None:
    """Eq 3.8 divides by the torque of the measured force: rows below three of its standard deviations are left out."""
    _, found = pressed(noise=0.5)
    own = np.abs(found.torque_expected)
    assert found.min_torque == pytest.approx(1.5, rel=0.3)
    assert (own[found.judged] > found.min_torque).all()
    assert np.isnan(found.estimated[~found.judged]).all()
    assert 0 < found.not_judged < 0.2 * found.t.size
    # What is judged errs by at most noise over lever arm, here at four standard deviations.
    lever = own[found.judged] / found.force[found.judged]
    assert np.abs(found.error[found.judged] * lever).max() < 4.5 * 0.5


def test_contact_by_the_base_frame_and_what_is_refused() -> None:
    robot = bs.Robot.load("ur5e")
    rng = np.random.default_rng(4)
    q = rng.uniform(-1, 1, size=(30, 6))
    wrench = np.zeros((30, 6))
    wrench[:, 2] = np.linspace(0, 50, 30)
    torque = np.einsum("nij,ni->nj", robot.jacobian(q), wrench)
    found = compare_contact(robot, np.arange(30.0), q, torque, wrench, in_base_frame=True, joint=1, min_torque=0.5)
    np.testing.assert_allclose(found.estimated[found.judged], found.force[found.judged])
    with pytest.raises(bs.InputError, match="has no force"):
        compare_contact(robot, np.arange(30.0), q, torque, 0 * wrench)
    with pytest.raises(bs.InputError, match="9 is none of ur5e"):
        compare_contact(robot, np.arange(30.0), q, torque, wrench, joint=8)


def test_contact_is_not_judged_where_the_recording_has_gaps() -> None:
    """Two seconds of a long push were lost: neither they nor a period of the cut-off beside them or the ends count."""
    robot = bs.Robot.load("ur5e")
    log = planted(robot, 2, seconds=12.0, noise=0.1)
    fit = identify_dynamics(log, robot, cutoff_hz=6.0)
    wrench = np.zeros((log.t.size, 6))
    wrench[:, 2] = -40.0
    kept = (log.t <= 4) | (log.t >= 6)
    assert log.tau is not None
    torn = Recording(t=log.t[kept], q=log.q[kept], tau=log.tau[kept], wrench=wrench[kept])
    contact = contact_of(fit.model, torn)
    assert contact is not None
    before, after = contact.t[contact.t < 5], contact.t[contact.t > 5]
    step = float(np.median(np.diff(contact.t)))
    assert before[-1] == pytest.approx(torn.t[torn.t < 5][-1] - 1 / 6, abs=1.01 * step)
    assert after[0] == pytest.approx(torn.t[torn.t > 5][0] + 1 / 6, abs=1.01 * step)
    assert before[0] == pytest.approx(log.t[0] + 1 / 6, abs=1.01 * step)
    assert after[-1] == pytest.approx(log.t[-1] - 1 / 6, abs=1.01 * step)


@pytest.mark.usefixtures("unsaved_pictures")
def test_pages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The page, its figures, and the contact comparison of a recording with a wrench."""
    robot = bs.Robot.load("ur5e")
    log = planted(robot, 2, seconds=12.0, noise=0.1)
    fit = identify_dynamics(log, robot, cutoff_hz=6.0)
    fit.save(tmp_path / "model.toml")
    wrench = np.zeros((log.t.size, 6))
    wrench[:, 2] = -40 * np.clip(np.sin(log.t - 4), 0, None) * (log.t > 4) * (log.t < 7.1)
    in_base = np.einsum("nij,nj->ni", robot.pose(log.q)[:, :3, :3], wrench[:, :3])
    assert log.tau is not None
    touched = log.tau - np.einsum("nij,ni->nj", robot.jacobian(log.q)[:, :3], in_base)
    pressed_log = Recording(t=log.t, q=log.q, qd=log.qd, tau=touched, wrench=wrench)
    contact = contact_of(fit.model, pressed_log)
    assert contact is not None
    assert np.nanmean(np.abs(contact.error)) < 3.0
    assert contact_of(fit.model, log) is None
    pressed_log.save(tmp_path / "log.parquet")
    arguments = [
        "validate",
        str(tmp_path / "model.toml"),
        str(tmp_path / "log.parquet"),
        "--out",
        str(tmp_path / "page"),
    ]
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 0
    assert "contact force by" in capsys.readouterr().out
    page = (tmp_path / "page" / "report.html").read_text()
    for title in ("Error by joint", "Measured and predicted", "Where the model is weak", "Contact force"):
        assert f">{title}</h2>" in page
    assert "<script" not in page
    assert len(list((tmp_path / "page").glob("*.png"))) == 3 * 6 + 1
    with pytest.raises(SystemExit) as ended:
        main([*arguments, "--contact-joint", "9"])
    assert ended.value.code == 2
    assert "9 is none of ur5e" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        main([*arguments[:3], "--contact-joint", "2"])
    assert ended.value.code == 2
    assert "--contact-joint: has no effect without --out" in capsys.readouterr().err
    log.save(tmp_path / "log.parquet")  # without a wrench
    with pytest.raises(SystemExit) as ended:
        main([*arguments, "--contact-joint", "2"])
    assert ended.value.code == 2
    assert "log.parquet has no wrench; leave it out" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        main(["tune", *arguments[2:3], "--model", *arguments[1:2], "--tip", "tool0"])
    assert ended.value.code == 2
    assert "--tip: has no meaning with fitted dynamics, which know their robot" in capsys.readouterr().err


def test_a_joint_is_scored_where_it_moves() -> None:
    """Stiction of three quarters of the friction, in rows that no model of motion predicts, is no error of one."""
    robot = bs.Robot.load("ur10e")
    fit = identify_dynamics(stuck(robot, 2), robot, cutoff_hz=6.0)
    other = stuck(robot, 3)
    found = fit.predict(other, filter_hz=6.0)
    rests = resting(other.q, other.rate_hz)[: len(found.t)]
    for j, score in enumerate(found.scores()):
        assert score.rest_share == pytest.approx(rests[:, j].mean(), abs=0.01)
        assert 0.2 < score.rest_share < 0.8
        moves = ~rests[:: round(other.rate_hz / found.rate_hz), j][: len(found.t)]
        measured, predicted = found.measured[moves, j], found.predicted[moves, j]
        own = 1 - ((predicted - measured) ** 2).sum() / ((measured - measured.mean()) ** 2).sum()
        assert score.r2_raw == pytest.approx(own, abs=2e-3)
        assert score.r2 > 0.98


def test_a_joint_that_rests_has_no_score(tmp_path: Path) -> None:
    """Its torque hardly varies: a share of that would be a number far below zero beside a sound fit."""
    robot = bs.Robot.load("ur10e")
    log = planted(robot, 1, seconds=12.0)
    held = log.q.copy()
    held[:, 3] = held[0, 3]
    still = np.gradient(held, log.t, axis=0)
    tau = bs.model.inverse_dynamics(robot, held, still, np.gradient(still, log.t, axis=0)) + 2.0 * np.tanh(still / 0.02)
    tau += 0.1 * np.random.default_rng(5).normal(size=held.shape)
    # Held by stiction, which turns over from one rest to the next.
    tau[:, 3] += 40.0 * np.sign(log.t - 6)
    file = tmp_path / "log.parquet"
    Recording(t=log.t, q=held, qd=still, tau=tau).save(file)
    model = tmp_path / "arm.toml"
    for command in (("identify", file, "--robot", "ur10e", "-o", model), ("validate", model, file)):
        said = run(*command).out
        assert re.search(r"^wrist_1_joint +rests +rests +\S+ +\S+ +\S+$", said, re.MULTILINE), said
        assert "note: R2 leaves out the rows at which a joint rests: wrist_1_joint 100 %" in said
    assert "warning: wrist_1_joint rests: its torque is not judged" in said
    joint = strict_json(run("validate", model, file, "--json").out)["joints"][3]
    assert (joint["r2"], joint["r2_raw"], joint["rest_share"]) == (None, None, 1.0)


@pytest.mark.usefixtures("unsaved_pictures")
def test_contact_is_judged_by_currents_where_gains_are_known(tmp_path: Path) -> None:
    """A push that a sensor measures shows in the currents times their gains; the joint of unknown gain is not used."""
    robot = bs.Robot.load("ur5e")
    log = currents(robot, 3, seconds=15.0, noise=0.02)
    t = log.t - log.t[0]
    wrench = np.zeros((t.size, 6))
    wrench[:, 2] = -60 * np.clip(np.sin(t - 4), 0, None) * (t < 7.1)
    in_base = np.einsum("nij,nj->ni", robot.pose(log.q)[:, :3, :3], wrench[:, :3])
    torque = np.einsum("nij,ni->nj", robot.jacobian(log.q)[:, :3], in_base)
    assert log.current is not None
    touched = replace(log, current=log.current - torque / GAINS, wrench=wrench)
    free, pushed, folder = tmp_path / "free.parquet", tmp_path / "pushed.parquet", tmp_path / "fit"
    log.save(free)
    touched.save(pushed)
    known = ("--robot", "ur5e", "--model", "dynamics", "--known", f"shoulder_lift_joint.B={GAINS[1]}", "--cutoff", 10)
    fitted = run("identify", free, *known, "-o", tmp_path / "model.toml")
    assert "wrist_3_joint: not identifiable" in fitted.out, fitted.err
    done = run("validate", tmp_path / "model.toml", pushed, "--out", tmp_path / "page")
    told = re.search(r"contact force by (\w+): error ([\d.]+) N on average", done.out)
    assert told is not None, done.err
    assert re.search(r"warning: the gain of .*wrist_3_joint is not known: currents are judged up to a free", done.out)
    assert told[1] != "wrist_3_joint"
    assert float(told[2]) < 3.0
    refused = run("validate", tmp_path / "model.toml", pushed, "--out", tmp_path / "page", "--contact-joint", 6)
    assert "--contact-joint: the gain of wrist_3_joint is not known; wanted one of 1, 2, 3, 4, 5\n" in refused.err
    assert "model: " in run("identify", pushed, *known, "-o", folder).out
    assert "Contact force</h2>" in (folder / "report.html").read_text()


@pytest.mark.usefixtures("unsaved_pictures")
def test_a_fit_is_not_lost_where_its_page_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> None:
        raise bs.InputError("recording", "nothing of it can be drawn", "")

    monkeypatch.setattr("bumpstop.report.identification.validation.write_validation_report", fails)
    planted(bs.Robot.load("ur5e"), 2, seconds=12.0, noise=0.1).save(tmp_path / "log.parquet")
    done = run("identify", tmp_path / "log.parquet", "--robot", "ur5e", "--cutoff", 6, "-o", tmp_path / "fit")
    assert "nothing of it can be drawn" in done.err
    assert (tmp_path / "fit" / "model.toml").exists()
