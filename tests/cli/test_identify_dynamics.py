"""``bumpstop identify`` and ``validate`` with several recordings of joint torques, and what they carried."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.identification import with_payload
from bumpstop.model import inverse_dynamics, write_urdf
from bumpstop.recording import Recording
from cli.support import run, strict_json
from identification.test_dynamics_fit import COULOMB, VISCOUS, planted
from identification.test_gains_fit import GAINS, LOAD, currents
from model.urdf_cases import scaled

ROBOT = "ur5e"
CENTER = (0.02, -0.01, 0.07)


def test_several_recordings_make_one_fit(tmp_path: Path) -> None:
    """Planted friction is found from two recordings, one with a declared payload, and a third is predicted."""
    robot = bs.Robot.load(ROBOT)
    loaded = with_payload(robot, 2.0, CENTER)
    files = []
    for number, (arm, seconds) in enumerate(((robot, 6.0), (loaded, 8.0), (robot, 6.0)), start=1):
        files.append(tmp_path / f"{number}.parquet")
        planted(arm, number, seconds=seconds).save(files[-1])
    options = ("--robot", ROBOT, "--cutoff", 6, "--payload", "2:2.0,0.02,-0.01,0.07")
    result = run("identify", *files[:2], *options, "-o", tmp_path / "arm.toml", "--json")
    assert result.status == 0, result.err
    found = strict_json(result.out)
    one = strict_json(run("identify", files[0], "--robot", ROBOT, "--cutoff", 6, "--json").out)
    assert found["rows_used"] > 2 * one["rows_used"]
    for j, joint in enumerate(found["joints"], start=1):
        for name, truth in (("coulomb", COULOMB), ("viscous", VISCOUS)):
            own = joint["parameters"][name]
            assert abs(own["value"] - truth / j) < 5 * own["standard_error"] + 0.02 * truth / j
    model = tmp_path / "arm.toml"
    again = strict_json(run("validate", model, files[2], "--json").out)["joints"]
    assert min(joint["r2"] for joint in again) > 0.98
    both = ("validate", model, files[2], files[1], "--json")
    declared = strict_json(run(*both, "--payload", "2:2.0,0.02,-0.01,0.07").out)["joints"]
    silent = strict_json(run(*both).out)["joints"]
    assert declared[1]["rmse"] < 0.5 * silent[1]["rmse"]
    assert np.isclose(declared[1]["rmse"], again[1]["rmse"], rtol=0.25)
    # The second of both is one of the fit's.
    (note,) = strict_json(run(*both).out)["notes"]
    assert note.startswith(f"{files[1]}: the model was fitted to this recording, or to a part of it; ")
    assert strict_json(run("validate", model, files[2], "--json").out)["notes"] == []
    assert f"note: {note}" in run(*both[:-1]).out
    tune = ("tune", "--model", model, "--from", 1, "--json")
    for file, told in ((files[0], True), (files[2], False)):
        done = run(*tune, file)
        notes = strict_json(done.out)["notes"] if done.status == 0 else [done.err]
        assert any("the model was fitted to this recording" in one for one in notes) is told, done.err


def test_what_several_recordings_cannot_be(tmp_path: Path) -> None:
    robot = bs.Robot.load(ROBOT)
    planted(robot, 1, seconds=4.0).save(tmp_path / "a.parquet")
    planted(bs.Robot.load("panda"), 1, seconds=4.0).save(tmp_path / "b.parquet")
    for options, message in (
        ((tmp_path / "b.parquet",), "7 joints"),
        (("--payload", "2:1.5"), "recordings are 1 to 1"),
        (("--known", "elbow_joint.B=3"), "--known: is for drives, and torques were recorded"),
        *(
            (("--shared-motor", group), "--shared-motor: ")
            for group in ("5", "5,5", "5,7", "0,5", "5,6:0", "5,6:nan", "5,x", "")
        ),
    ):
        result = run("identify", tmp_path / "a.parquet", *options, "--robot", ROBOT, "--cutoff", 6)
        assert result.status == 2
        assert result.err.startswith("error: ")
        assert result.err.count("\n") == 1
        assert message in result.err


def test_gains_and_dynamics_from_currents(tmp_path: Path) -> None:
    """A load that one recording carries gives the scale; the model then predicts the torque behind other currents."""
    robot = bs.Robot.load(ROBOT)
    unpadded, loaded = tmp_path / "bare.parquet", tmp_path / "loaded.parquet"
    currents(robot, 1).save(unpadded)
    currents(with_payload(robot, LOAD.mass, LOAD.center), 2).save(loaded)
    options = ("--robot", ROBOT, "--model", "dynamics", "--cutoff", 10)
    told = ("--payload", "2:3.0,0.03,0,0.08")
    result = run("identify", unpadded, loaded, *options, *told, "-o", tmp_path / "arm.toml", "--json")
    assert result.status == 0, result.err
    found = strict_json(result.out)
    for joint, truth in zip(found["joints"], GAINS, strict=True):
        gain = joint["parameters"]["B"]
        assert abs(gain["value"] - truth) < 4.5 * gain["standard_error"]
    compared = strict_json(run("validate", tmp_path / "arm.toml", loaded, "--payload", "3,0.03,0,0.08", "--json").out)
    assert min(joint["r2"] for joint in compared["joints"][:4]) > 0.98
    words = run("identify", unpadded, *options, "--known", f"elbow_joint.B={GAINS[2]}").out
    assert "elbow_joint: 10 (given) Nm/A" in words
    assert "wrist_3_joint: not identifiable" in words
    for more, message in (
        ((), "gains: their scale is not identifiable: nothing known is carried"),
        (("--payload", "3"), "gains: their scale is not identifiable: all recordings carry the same"),
        (("--known", "elbow_joint.inertia=3"), "--known: elbow_joint.inertia is no gain"),
        (("--known", "elbow.B=3"), "'elbow' is no joint of ur5e"),
        (("--shared-motor", "5,6"), "--shared-motor: is for torques"),
    ):
        refused = run("identify", unpadded, *options, *more)
        assert refused.status == 2
        assert refused.err.count("\n") == 1
        assert message in refused.err


def at_rest(moving: tuple[int, ...], *, noise: float) -> Recording:
    """An arm of which only some joints move (from 0), with noise of encoders and torques; the last has no torque."""
    robot = bs.Robot.load(ROBOT)
    rng = np.random.default_rng(4)
    t = np.arange(0, 12, 0.008)
    q, qd, qdd = (np.zeros((t.size, robot.dof)) for _ in range(3))
    q += [0.1, -1.0, 1.2, -0.4, 1.0, 0.3]
    for j in moving:
        w = 2.0 + 0.3 * j
        q[:, j] += 0.5 * np.sin(w * t)
        qd[:, j], qdd[:, j] = 0.5 * w * np.cos(w * t), -0.5 * w * w * np.sin(w * t)
    tau = inverse_dynamics(robot, q, qd, qdd) + 2.0 * np.sign(qd)
    tau += noise * rng.normal(size=q.shape)
    tau[:, -1] = 0.0
    return Recording(t=t, q=q + 1e-4 * noise * rng.normal(size=q.shape), tau=tau)


def test_joints_that_hardly_move_are_named(tmp_path: Path) -> None:
    robot = bs.Robot.load(ROBOT)
    names = [joint.name for joint in robot.joints]
    at_rest((1, 2), noise=0.1).save(tmp_path / "two.parquet")
    result = run("identify", tmp_path / "two.parquet", "--robot", ROBOT, "--cutoff", 5)
    warned = [line.split()[1] for line in result.out.splitlines() if line.startswith("warning: ")]
    assert warned == [names[j] for j in (0, 3, 4, 5)]
    found = strict_json(run("identify", tmp_path / "two.parquet", "--robot", ROBOT, "--cutoff", 5, "--json").out)
    assert found["hardly_moved"] == warned


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_an_arm_at_rest_shows_no_dynamics(noise: float, tmp_path: Path) -> None:
    at_rest((), noise=noise).save(tmp_path / "rest.parquet")
    result = run("identify", tmp_path / "rest.parquet", "--robot", ROBOT)
    assert result.status == 2
    assert "no joint moves by as much as 0.01 rad or m; wanted a motion" in result.err


def test_a_torque_that_never_changes_has_no_share_predicted(tmp_path: Path) -> None:
    """Neither a figure of thirty digits, nor a NaN that JSON has not."""
    at_rest((1, 2), noise=0.1).save(tmp_path / "two.parquet")
    at_rest((), noise=0.0).save(tmp_path / "rest.parquet")
    model = tmp_path / "arm.toml"
    made = run("identify", tmp_path / "two.parquet", "--robot", ROBOT, "--cutoff", 5, "-o", model, "--json")
    assert strict_json(made.out)["joints"][-1]["r2"] is None
    scores = strict_json(run("validate", model, tmp_path / "rest.parquet", "--json").out)["joints"]
    assert [score["r2"] for score in scores] == [None] * 6
    assert [score["r2_raw"] for score in scores] == [None] * 6
    rows = run("validate", model, tmp_path / "rest.parquet").out.splitlines()
    (row,) = (row for row in rows if row.startswith("shoulder_lift_joint"))
    assert row.split()[1:3] == ["rests", "rests"]


@pytest.mark.usefixtures("unsaved_pictures")
def test_pages_carry_parameters_with_errors_and_what_reading_found(tmp_path: Path) -> None:
    planted(bs.Robot.load(ROBOT), 1, seconds=6.0).save(tmp_path / "run.parquet")
    fitted = run("identify", tmp_path / "run.parquet", "--robot", ROBOT, "--cutoff", 6, "-o", tmp_path / "fit")
    checked = run("validate", tmp_path / "fit/model.toml", tmp_path / "run.parquet", "--from", 1, "-o", tmp_path / "on")
    assert (fitted.status, checked.status) == (0, 0), fitted.err + checked.err
    errors = re.findall(r"^ +(-?[\d.]+) \+- ([\d.e-]+) (?:kg|N).*?  (.*?)(?:  \(|$)", fitted.out, flags=re.MULTILINE)
    assert len(errors) > 40
    for folder in ("fit", "on"):
        page = (tmp_path / folder / "report.html").read_text(encoding="utf-8")
        cells = re.findall(r'<th scope="row">([^<]*)</th><td>([^<]*)</td><td>([^<]*)</td>', page)
        rows = {name: figures for name, *figures in cells}
        for value, error, name in errors:
            assert rows[name] == [value, error], name
        assert "speed and acceleration" in page
    assert "part: " in page
    assert "s from its beginning" in page


def test_a_constant_torque_of_a_moving_joint_has_no_held_out_error(tmp_path: Path) -> None:
    """A wrong column: of the variance of rounding 1e26 % was unexplained."""
    recording = planted(bs.Robot.load(ROBOT), 1, seconds=6.0)
    assert recording.tau is not None
    tau = recording.tau.copy()
    tau[:, 1] = 3.0
    replace(recording, tau=tau).save(tmp_path / "run.parquet")
    fitted = run("identify", tmp_path / "run.parquet", "--robot", ROBOT, "--cutoff", 6, "-o", tmp_path / "arm.toml")
    assert "the torque of shoulder_lift_joint is constant while the joint moves" in " ".join(fitted.out.split())
    assert not re.search(r"e\+\d", fitted.out)


def test_figures_have_four_digits_at_most_and_no_digits_of_rounding(tmp_path: Path) -> None:
    """Means of errors that a fit makes zero are 0, not 3.525e-09; parameters have no fifth digit."""
    planted(bs.Robot.load(ROBOT), 1, seconds=6.0).save(tmp_path / "run.parquet")
    fitted = run("identify", tmp_path / "run.parquet", "--robot", ROBOT, "--cutoff", 6, "-o", tmp_path / "arm.toml")
    assert fitted.status == 0, fitted.err
    told = run("validate", tmp_path / "arm.toml", tmp_path / "run.parquet").out
    errors = re.findall(r"^\w+_joint +(\S+) +(\S+) +(\S+) +(\S+) +(\S+)$", fitted.out, flags=re.MULTILINE)
    assert len(errors) == 6
    assert not re.search(r"\de-0[789]|\de-1\d", fitted.out + told)
    parameters = re.findall(r"^ +(-?[\d.]+) \+- ", fitted.out, flags=re.MULTILINE)
    assert len(parameters) > 40
    assert [text for text in parameters if len(text.lstrip("-0.").replace(".", "")) > 4] == []


NOT_USABLE = "the model comes of a fit that was judged not usable"


def test_a_fit_that_is_not_usable_is_not_used_without_a_word(tmp_path: Path) -> None:
    robot = bs.Robot.load("ur10e")
    log = planted(robot, 3, seconds=12.0)
    log.save(tmp_path / "run.parquet")
    model = tmp_path / "model.toml"
    assert run("identify", tmp_path / "run.parquet", "--robot", "ur10e", "--cutoff", 6, "-o", model).status == 0
    text = model.read_text(encoding="utf-8")
    limits = "90,90,90,30,30,30"
    uses: list[tuple[object, ...]] = [
        ("tune", tmp_path / "run.parquet", "--model", model),
        ("detect", tmp_path / "run.parquet", "--model", model, "--thresholds", limits),
        ("detect", tmp_path / "run.parquet", "--model", model, "--thresholds", limits, "--causal"),
        ("detector", tmp_path / "arm.det", "--model", model, "--thresholds", limits, "--period", 0.01),
        ("sensitivity", "ur10e", "--pose-deg", "0,-60,60,0,90,0", "--model", model, "--thresholds", limits),
        ("validate", model, tmp_path / "run.parquet"),
    ]
    fit = ("identify", tmp_path / "run.parquet", "--robot", "ur10e", "--model", "payload", "--dynamics", model)
    for verdict, told in (("not usable", True), ("usable", False), (None, False)):
        line = f'verdict = "{verdict}"\n' if verdict else ""
        model.write_text(text.replace('verdict = "usable"\n', line), encoding="utf-8")
        for use in uses:
            result = run(*use)
            assert result.status == 0, result.err
            assert (NOT_USABLE in result.out) == told, use
        result = run(*fit)
        assert (f"not usable: {NOT_USABLE}" in result.out) == told
        assert result.status == 3 or not told
    model.write_text(text.replace('"usable"', '"not usable"'), encoding="utf-8")
    labels = tmp_path / "labels.csv"
    labels.write_text("start_s,end_s\n2,3\n", encoding="utf-8")
    for use in (*uses[:3], ("score", tmp_path / "run.parquet", "--labels", labels, *uses[1][2:])):
        found = strict_json(run(*use, "--json", "-o", tmp_path / "page").out)
        assert any(NOT_USABLE in note for note in found["notes"]), use
        assert NOT_USABLE in (tmp_path / "page/report.html").read_text(encoding="utf-8"), use
    assert strict_json(run(*fit, "--json").out)["verdict"]["status"] == "not usable"


def test_page_and_terminal_of_a_fit_show_the_same_rows(tmp_path: Path) -> None:
    """Of more than 10 000 rows blocks are fitted; the page's errors were those of all rows, under the same words."""
    planted(bs.Robot.load(ROBOT), 1, seconds=130.0).save(tmp_path / "long.parquet")
    done = run("identify", tmp_path / "long.parquet", "--robot", ROBOT, "--cutoff", 6, "-o", tmp_path / "fit")
    assert done.status == 0, done.err
    assert "in blocks spread over the time" in done.out
    page = (tmp_path / "fit" / "report.html").read_text(encoding="utf-8")
    told = re.search(r"^elbow_joint +[\d.]+ +[\d.]+ +(\S+) +(\S+) +(\S+)", done.out, re.MULTILINE)
    (shown,) = re.findall(r"<th[^>]*>elbow_joint</th>(?:<td[^>]*>[^<]*</td>){2}((?:<td[^>]*>[^<]*</td>){3})", page)
    assert told is not None
    assert re.findall(r">([^<]+)</td>", shown) == list(told.groups())


def test_what_is_doubted_of_a_urdf_is_said_in_json_and_of_predictions(tmp_path: Path) -> None:
    arm, model, log = (tmp_path / name for name in ("arm.urdf", "arm.toml", "log.parquet"))
    robot = scaled(bs.Robot.load(ROBOT), 10.0)
    write_urdf(robot, arm)
    planted(robot, 1, seconds=6.0).save(log)
    said = "do not look like metres"
    done = run("identify", log, "--robot", arm, "--cutoff", 6, "--json", "-o", model)
    assert any(said in note for note in strict_json(done.out)["notes"]), done.err
    assert any(said in note for note in strict_json(run("validate", model, log, "--json").out)["notes"])
    assert said in run("validate", model, log).out
