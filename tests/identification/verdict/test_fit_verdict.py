"""A verdict on every fit: what hides behind a good R2 is said, and what is sound is left alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.identification import (
    DynamicsFit,
    FitVerdict,
    Quantity,
    identify_dynamics,
    identify_gains,
    identify_payload,
    judge_dynamics,
    judge_payload,
    judge_predictions,
    with_payload,
)
from bumpstop.identification.segments.motion import UniformMotion
from bumpstop.identification.segments.recorded_columns import clipped_share
from bumpstop.identification.segments.seen_motion import SeenMotion
from bumpstop.joint import Parameter
from bumpstop.model import inverse_dynamics, write_urdf
from bumpstop.recording import Recording
from cli.support import run, strict_json
from identification.drives import driven, fourier
from identification.drives import planted as with_drives
from identification.test_dynamics_fit import planted
from identification.test_gains_fit import GAINS, LOAD, fitted, with_and_without
from identification.verdict_cases import good, sweeps


def test_a_sound_fit_is_usable_without_a_word() -> None:
    _, log, fit = good()
    verdict = judge_dynamics(fit, [log])
    assert verdict.status == "usable", verdict.reasons()
    assert verdict.condition is not None
    assert 5 < verdict.condition < 100
    assert verdict.held_out is not None
    assert 0 < verdict.held_out < 0.05
    assert verdict.line().startswith("verdict: usable (condition number ")


@pytest.mark.parametrize(("name", "noise"), [("ur5e", 0.02), ("panda", 0.5)])
def test_single_joint_sweeps_are_not_usable(name: str, noise: float) -> None:
    """They explain what they were fitted to, to 99 %, and say nothing of motions of several joints."""
    robot = bs.Robot.load(name)
    log = sweeps(robot, noise=noise)
    fit = identify_dynamics(log, robot, cutoff_hz=6.0)
    # A joint is not fitted to rows at which it rests, which ``score`` has too.
    assert fit.unexplained is not None
    assert max(fit.unexplained) < 0.01
    verdict = judge_dynamics(fit, [log])
    assert verdict.status == "not usable"
    assert verdict.condition is not None
    assert verdict.condition > 5000
    assert any("condition number" in fault for fault in verdict.faults)


@pytest.mark.parametrize("joint", [1, 5])
def test_torques_of_the_opposite_sign_are_not_usable(joint: int) -> None:
    robot, log, _ = good()
    assert log.tau is not None
    sign = np.ones(robot.dof)
    sign[joint] = -1
    turned = replace(log, tau=log.tau * sign)
    verdict = judge_dynamics(identify_dynamics(turned, robot, cutoff_hz=6.0), [turned])
    name = robot.joints[joint].name
    assert any(f" {name} is negative" in fault and "opposite sign" in fault for fault in verdict.faults)


def test_negative_inertia_is_told() -> None:
    robot, log, _ = good()
    assert log.tau is not None
    assert log.qd is not None
    less = log.tau.copy()
    less[:, 4] -= 2.0 * np.gradient(log.qd[:, 4], log.t)
    turned = replace(log, tau=less)
    warnings = judge_dynamics(identify_dynamics(turned, robot, cutoff_hz=6.0), [turned]).warnings
    assert any("inertia about wrist_2_joint is negative in 100 % of poses" in warning for warning in warnings)


def test_columns_that_stand_still_or_at_an_end_are_told() -> None:
    robot, log, _ = good()
    assert log.tau is not None
    tau = log.tau.copy()
    tau[:, 3] = 1.7
    top = 0.7 * np.abs(tau[:, 1]).max()
    tau[:, 1] = np.clip(tau[:, 1], -top, top)
    spoilt = replace(log, tau=tau)
    said = judge_dynamics(identify_dynamics(spoilt, robot, cutoff_hz=6.0), [spoilt]).reasons()
    assert any("torque of wrist_1_joint is constant while the joint moves" in reason for reason in said)
    assert any("torque of shoulder_lift_joint stands at an end" in reason and "clipped" in reason for reason in said)


def test_what_is_quantized_or_rests_is_not_clipped() -> None:
    rng = np.random.default_rng(2)
    t = np.arange(0, 20, 0.01)
    assert clipped_share(np.round(5 * np.sin(t) + 0.3 * rng.normal(size=t.size), 1)) == 0
    assert clipped_share(np.where((t > 5) & (t < 15), np.sin(t), 0.0)) == 0
    assert clipped_share(np.repeat([1.0, 2.0, 1.5, 2.0, 0.5], 400)) < 0.9
    assert clipped_share(np.clip(5 * np.sin(t), -3, 3)) > 0.3


def test_joints_that_rest_are_told() -> None:
    robot, log, _ = good()
    q = log.q.copy()
    q[:, 3] = q[0, 3]
    rested = Recording(t=log.t, q=q, tau=log.tau)
    verdict = judge_dynamics(identify_dynamics(rested, robot, cutoff_hz=6.0), [rested])
    assert any("wrist_1_joint hardly moves" in warning for warning in verdict.warnings)


def test_validation_says_what_lies_outside_the_fit(tmp_path: Path) -> None:
    robot, log, fit = good()
    path = tmp_path / "model.toml"
    fit.save(path)
    again = DynamicsFit.load(path)
    assert again.seen is not None
    assert fit.seen is not None
    np.testing.assert_array_equal(again.seen.low, fit.seen.low)

    def judged(other: Recording) -> FitVerdict:
        rows = again.model.rows(other)
        return judge_predictions(again, rows, again.model.compare_rows(rows).scores(), again.model.cutoff_hz)

    assert not [warning for warning in judged(log).warnings if "outside" in warning]
    assert log.tau is not None
    assert log.qd is not None
    far = log.q + np.array([0, 0, 2.0, 0, 0, 0])
    told = [warning for warning in judged(replace(log, q=far)).reasons() if "outside" in warning]
    assert len(told) == 1
    assert "elbow_joint" in told[0]
    assert "the positions of the fit" in told[0]
    fast = replace(log, t=log.t / 1.5, qd=1.5 * log.qd)
    told = [warning for warning in judged(fast).reasons() if "outside the speeds of the fit" in warning]
    assert len(told) == robot.dof
    assert judged(replace(log, tau=-log.tau)).status == "not usable"


def test_a_range_is_left_by_more_than_its_margin() -> None:
    low, high = np.array([-1.0]), np.array([1.0])
    seen = SeenMotion(low, high, np.array([2.0]), np.array([3.0]))

    def told(q: float, qd: float, rows: int) -> list[str]:
        position, rate = np.zeros((100, 1)), np.zeros((100, 1))
        position[:rows], rate[:rows] = q, qd
        return seen.outside(UniformMotion(np.arange(100.0), position, rate, 0 * rate, 1.0), ["a"])

    assert told(1.09, 2.09, 100) == []  # within 5 % of a width of 2, and of a speed of 2
    assert told(-1.2, 0.0, 1) == []  # one row of a hundred
    assert told(-1.2, 0.0, 2)
    assert told(1.2, 0.0, 2)
    assert told(0.0, -2.2, 2)


def test_validation_of_dynamics_tells_columns_that_stand_still_or_at_an_end() -> None:
    _, log, fit = good()
    assert log.tau is not None
    tau = log.tau.copy()
    tau[:, 3] = 1.7
    top = 0.6 * np.abs(tau[:, 1]).max()
    tau[:, 1] = np.clip(tau[:, 1], -top, top)
    spoilt = replace(log, tau=tau)
    rows = fit.model.rows(spoilt)
    verdict = judge_predictions(fit, rows, fit.model.compare_rows(rows).scores(), fit.model.cutoff_hz, [spoilt])
    assert any("torque of wrist_1_joint is constant while" in fault for fault in verdict.faults)
    assert any("shoulder_lift_joint stands at an end" in warning for warning in verdict.warnings)


def test_gains_are_judged() -> None:
    robot = bs.Robot.load("ur5e")
    logs = with_and_without()
    verdict = judge_dynamics(fitted(), logs)
    assert verdict.usable, verdict.reasons()
    sign = np.array([1.0, 1, -1, 1, 1, 1])
    turned = [replace(log, current=log.current * sign) for log in logs if log.current is not None]
    fit = identify_gains(turned, robot, payloads=[None, LOAD], cutoff_hz=10.0, known={"shoulder_lift_joint": GAINS[1]})
    said = judge_dynamics(fit, turned).reasons()
    assert any("gain of elbow_joint is negative, unlike the others" in reason for reason in said), said


def test_payloads_are_judged() -> None:
    robot = bs.Robot.load("ur5e")
    motion = fourier(robot, 10.0, 94.0, 3)
    truth, _ = with_drives(robot, motion, 3)
    # Drives that were seen under as much current, with gains whose errors are known.
    joints = []
    for joint in truth.joints:
        gain = Parameter(joint.value("B"), 0.01 * joint.value("B"))
        joints.append(replace(joint, parameters={**joint.parameters, "B": gain}, current_range=(-1e5, 1e5)))
    truth = replace(truth, joints=tuple(joints))
    log = driven(with_payload(robot, 2.0, (0.02, -0.01, 0.08)), motion, truth, 3)
    found = identify_payload(log, robot, model=truth)
    verdict = judge_payload(found, log, robot)
    assert verdict.status == "usable", verdict.reasons()
    assert verdict.condition is not None
    assert verdict.held_out is not None
    less = judge_payload(replace(found, parameters={**found.parameters, "m": Quantity(-1.0, "kg")}), log, robot)
    assert any("mass comes out as -1 kg" in fault for fault in less.faults)
    unobservable = judge_payload(replace(found, parameters={**found.parameters, "m": Quantity(None, "kg")}), log, robot)
    assert unobservable.status == "not usable"
    assert log.current is not None
    lying = replace(log, current=log.current.copy(), q=np.tile(log.q[:1], (log.t.size, 1)))
    still = judge_payload(identify_payload(lying, robot, model=truth), lying, robot)
    assert still.status != "usable"


@pytest.mark.usefixtures("unsaved_pictures")
def test_the_verdict_comes_first_and_ends_with_its_status(tmp_path: Path) -> None:
    robot = bs.Robot.load("ur5e")
    bad, fine = tmp_path / "bad.parquet", tmp_path / "fine.parquet"
    sweeps(robot).save(bad)
    planted(robot, 1, seconds=8.0).save(fine)
    options = ("--robot", "ur5e", "--cutoff", 6)
    result = run("identify", bad, *options, "--out", tmp_path / "bad")
    assert result.status == 3
    lines = result.out.splitlines()
    assert lines[0].startswith("verdict: not usable (condition number ")
    assert lines[1].startswith("not usable: ")
    page = (tmp_path / "bad" / "report.html").read_text(encoding="utf-8")
    assert page.index('id="verdict"') < page.index("<table")
    assert "Not usable (condition number" in page
    told = strict_json(run("identify", bad, *options, "--json").out)["verdict"]
    assert told["status"] == "not usable"
    assert told["condition_number"] > 5000
    result = run("identify", fine, *options, "--out", tmp_path / "fine.toml")
    assert result.status == 0
    assert result.out.startswith("verdict: usable (condition number ")
    # What a model was worth goes with it.
    result = run("validate", tmp_path / "bad" / "model.toml", fine)
    assert "warning: the model comes of a fit that was judged not usable" in result.out
    assert run("validate", tmp_path / "fine.toml", fine).out.startswith("verdict: usable\n")


@pytest.mark.parametrize("quantity", ["tau", "current"])
def test_a_recording_of_another_robot_is_told(quantity: str, tmp_path: Path) -> None:
    """Twice the mass can come out as a fit that is sound in itself: its verdict says whose recording it was."""
    robot = bs.Robot.load("ur5e")
    log = planted(robot, 1, seconds=8.0)
    if quantity == "current":
        log = replace(log, tau=None, current=log.tau / 12.0)
    replace(log, robot="ur10e").save(tmp_path / "run.parquet")
    result = run("identify", tmp_path / "run.parquet", "--robot", "ur5e", "--out", tmp_path / "model.toml", "--json")
    told = "the file names robot 'ur10e', and 'ur5e' is taken"
    verdict = strict_json(result.out)["verdict"]
    assert verdict["status"] != "usable"
    assert any(told in warning for warning in verdict["warnings"])
    assert told in run("validate", tmp_path / "model.toml", tmp_path / "run.parquet").out
    log.save(tmp_path / "own.parquet")
    assert "names robot" not in run("identify", tmp_path / "own.parquet", "--robot", "ur5e").out


def test_a_base_that_moves_is_told(tmp_path: Path) -> None:
    """A bag with the joints below the chain says whether the base stood; what hangs beyond the tip is noted."""
    whole = bs.Robot.load("ur5e")
    write_urdf(whole, tmp_path / "arm.urdf")
    base, tip = whole.joints[0].link, whole.joints[4].link
    arm = bs.Robot.from_urdf(tmp_path / "arm.urdf", base, tip)
    assert (arm.base_joints, arm.other_joints) == ((whole.joints[0].name,), (whole.joints[5].name,))
    t, q, qd, qdd = fourier(whole, 16.0, 100.0, 1)
    after = np.clip((t - 8.0) / 0.5, 0.0, 1.0)[:, None]
    names = tuple(joint.name for joint in whole.joints)
    for joint, what in ((0, "fault"), (5, "note"), (None, "nothing")):
        moving = q.copy()
        for still in {0, 5} - {joint}:
            moving[:, still] = 0.3
        if joint == 0:  # stands in the first half
            moving[:, :1] = moving[0, 0] + after * (moving[:, :1] - moving[0, 0])
        tau = inverse_dynamics(whole, moving, qd, qdd) + 2.0 * np.sign(qd)
        Recording(t=t, q=moving, tau=tau, joint_names=names).save(tmp_path / f"{what}.mcap")
        log = Recording.load(tmp_path / f"{what}.mcap", robot=arm)
        assert list(log.report.base_motion) == ([whole.joints[0].name] if what == "fault" else [])
        assert any("leaves out move" in note for note in log.report.notes) == (what == "note")
        faults = judge_dynamics(identify_dynamics(log, arm, cutoff_hz=6.0), [log]).faults
        assert any("is moved by 'shoulder_pan_joint'" in fault for fault in faults) == (what == "fault")
        assert not log.between(0.0, 7.9).report.base_motion
    options = (tmp_path / "fault.mcap", "--robot", tmp_path / "arm.urdf", "--base", base, "--tip", tip)
    tuned = strict_json(run("tune", *options, "--json").out)
    assert any("is moved by 'shoulder_pan_joint'" in note for note in tuned["notes"])
    found = strict_json(run("detect", *options, "--thresholds", "50,50,50,50", "--json").out)
    assert any("is moved by 'shoulder_pan_joint'" in note for note in found["notes"])
