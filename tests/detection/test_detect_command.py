"""``bumpstop detect`` and ``bumpstop detector``: what they print and write, what they refuse, and real arms."""

from __future__ import annotations

import json
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bumpstop.cli.main import main
from bumpstop.detection import DetectorSettings, detect, undetectable_forces
from bumpstop.identification import DynamicsFit
from bumpstop.model import Robot, inverse_dynamics, write_urdf
from bumpstop.recording import Recording
from identification.test_dynamics_fit import planted

SHARED = Path(os.environ.get("BUMPSTOP_SHARED", Path(__file__).resolve().parents[3] / "shared"))


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


@pytest.fixture
def pushed(tmp_path: Path) -> Path:
    robot, t = Robot.load("ur5e"), 0.004 * np.arange(400)
    q = 0.2 + 0.3 * t[:, None] * np.ones(6)
    tau = inverse_dynamics(robot, q, np.full_like(q, 0.3), 0 * q)
    tau[200:250, 1] += 30
    path = tmp_path / "log.parquet"
    Recording(t=t, q=q, tau=tau).save(path)
    return path


def test_a_doubt_that_is_a_question_has_no_full_stop(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot, t = Robot.load("ur5e"), 0.004 * np.arange(2000)
    phase = t[:, None] + np.arange(6)
    q, qd, qdd = 0.3 * np.sin(phase), 0.3 * np.cos(phase), -0.3 * np.sin(phase)
    log, labels = tmp_path / "log.parquet", tmp_path / "labels.csv"
    Recording(t=t, q=q, qd=qd / 2, tau=inverse_dynamics(robot, q, qd, qdd)).save(log)
    labels.write_text("start_s,end_s\n1,2\n")
    for command in (("detect",), ("score", "--labels", labels)):
        _, out, _ = run(capsys, *command, log, "--robot", "ur5e", "--thresholds", "20,20,20,9,9,9")
        (note,) = [line for line in out.splitlines() if "times as fast as" in line]
        assert note.endswith("does time run so much too slow or too fast?")


@pytest.mark.parametrize(
    "command",
    [
        ("detect", "--thresholds", "20,20,20,9,9,9"),
        ("tune", "--save", "th.toml"),
        ("score", "--labels", "labels.csv", "--thresholds", "20,20,20,9,9,9"),
    ],
)
def test_a_recording_whose_name_is_no_text(
    pushed: Path,
    command: tuple[str, ...],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Pages and files of thresholds show it with escapes, as errors do."""
    monkeypatch.chdir(tmp_path)
    Path("labels.csv").write_text("start_s,end_s\n0.8,1\n")
    path = os.fsdecode(b"n\xff.csv")
    Recording.load(pushed).save(path)
    lines = Path(path).read_text().splitlines()
    lines[10] = "nan" + lines[10][lines[10].index(",") :]
    Path(path).write_text("\n".join(lines) + "\n")
    status, _, said = run(capsys, command[0], path, "--robot", "ur5e", *command[1:], "-o", "out")
    assert (status, said) == (0, "")
    assert r"n\udcff.csv" in Path("out/report.html").read_text(encoding="utf-8")
    if command[0] == "tune":
        assert r"n\udcff.csv: 1 of 400 rows dropped" in Path("th.toml").read_text(encoding="utf-8")


def test_events_and_files(pushed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    status, text, _ = run(
        capsys, "detect", pushed, "--robot", "ur5e", "--thresholds", "20,20,20,9,9,inf", "--json", "--out", out
    )
    found = json.loads(text)
    assert status == 0
    (event,) = found["events"]
    assert event["joints"] == [2]
    assert event["t"] == pytest.approx(0.8)
    assert event["residual_Nm"][1] == pytest.approx(30, abs=1e-6)
    assert event["threshold_Nm"][5] is None
    # The first and the last row that was pushed, and by how much.
    assert (event["begin_s"], event["end_s"]) == (pytest.approx(0.8), pytest.approx(0.996))
    assert event["largest_residual_Nm"][1] == pytest.approx(30, abs=1e-6)
    assert event["largest_joint"] == 2
    assert 0.8 - 1e-9 <= event["largest_s"] <= 0.996 + 1e-9
    assert found["rows"] == 400
    assert found["no_data_rows"] == {"filling": 17}  # 70 ms
    assert json.loads((out / "events.json").read_text(encoding="utf-8")) == found
    assert {path.name for path in out.iterdir()} == {
        "events.json",
        "report.html",
        "residuals.svg",
        "residuals.png",
        "residuals.parquet",
    }
    page = (out / "report.html").read_text(encoding="utf-8")
    for text in ("1 alarm in 1.596 s, 400 rows", "30 Nm at joint 2", "ur5e", "window_samples", "log.parquet"):
        assert text in page
    assert "at the first row, at flange along 0 0 -1." in page
    assert page.index("1 alarm in") < page.index("<table") < page.index("window_samples")
    # Only the joint that is not monitored has no threshold to be drawn, and none is drawn where there was none yet.
    drawn = (out / "residuals.svg").read_text(encoding="utf-8")
    assert re.findall(r">(\w+): not monitored<", drawn) == ["wrist_3_joint"]


def test_poses_with_large_undetectable_forces(pushed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ("detect", pushed, "--robot", "ur5e", "--thresholds", "20,20,20,20,20,inf", "--undetectable-force")
    log = Recording.load(pushed)
    largest = undetectable_forces(Robot.load("ur5e"), log.q, [20, 20, 20, 20, 20, np.inf]).largest
    _, text, _ = run(capsys, *given, 0.9 * largest.min(), "--json")
    (stretch,) = json.loads(text)["undetectable_poses"]
    assert stretch == {"start_s": 0.0, "end_s": pytest.approx(1.596), "largest_N": pytest.approx(largest.max())}
    _, text, _ = run(capsys, *given, 0.9 * largest.min())
    assert f"from 0.0000 to 1.5960 s up to {largest.max():.4g} N could stay undetected" in text
    _, text, _ = run(capsys, *given, 1.1 * largest.max())
    assert "at no time could more than" in text
    status, _, err = run(capsys, *given, 0)
    assert (status, err.startswith("error: --undetectable-force: is 0")) == (2, True)


def test_forces_count_what_thresholds_have_at_rest(
    pushed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, q = Robot.load("ur5e"), [0.0, -60, 90, -120, -90, 0]
    pose = ",".join(str(x) for x in q)
    file = tmp_path / "thresholds.toml"
    file.write_text("thresholds_Nm = [20, 20, 20, 20, 20, 20]\nat_rest_Nm = [40, 30, 40, 10, 10, 10]\n")
    given = ("sensitivity", "ur5e", "--pose-deg", pose, "--thresholds", file, "--json")
    _, text, _ = run(capsys, *given)
    found = json.loads(text)
    wide = undetectable_forces(robot, np.radians(q), [60, 50, 60, 30, 30, 30]).largest
    assert found["standing"]["largest_force_N"] == pytest.approx(float(wide))
    assert found["standing"]["dead_zone_Nm"] == [0.0] * 6
    assert found["notes"] == []
    file.write_text("thresholds_Nm = [20, 20, 20, 20, 20, 20]\nper_speed_Nm_s = [5, 5, 5, 5, 5, 5]\n")
    _, text, _ = run(capsys, *given)
    assert "grow with speed" in json.loads(text)["notes"][0]
    # An arm that stands still through a recording.
    log = Recording.load(pushed)
    still = replace(log, q=np.tile(log.q[:1], (len(log.t), 1)), qd=None)
    still.save(tmp_path / "still.parquet")
    file.write_text("thresholds_Nm = [20, 20, 20, 20, 20, 20]\nat_rest_Nm = [40, 30, 40, 10, 10, 10]\n")
    _, text, _ = run(
        capsys, "detect", tmp_path / "still.parquet", "--robot", "ur5e", "--thresholds", file,
        "--undetectable-force", 10, "--json",
    )  # fmt: skip
    (stretch,) = json.loads(text)["undetectable_poses"]
    wide = undetectable_forces(robot, log.q[:1], [60, 50, 60, 30, 30, 30]).largest
    assert stretch["largest_N"] == pytest.approx(float(wide.max()))


def test_the_force_where_and_along_what_is_asked_for(pushed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """30 Nm at joint 2 alone: what the columns of the Jacobian there make of it by weighted least squares."""
    robot, at = Robot.load("ur5e"), (0.1, 0.0, 0.0)
    link = robot.joints[2].link
    options = ("--thresholds", "20,20,20,20,20,20", "--direction", "0,3,-4", "--link", link, "--point-m", "0.1,0,0")
    _, text, _ = run(capsys, "detect", pushed, "--robot", "ur5e", *options, "--json")
    found = json.loads(text)
    (event,) = found["events"]
    assert found["undetectable_poses"] is None
    lever = robot.jacobian(np.full(6, 0.2 + 0.3 * 0.8), link, at)[:3].T @ [0, 0.6, -0.8]
    # All noise alike, a third of the threshold: plain least squares over the joints before the link.
    assert event["force_N"] == pytest.approx(30 * lever[1] / (lever @ lever), rel=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--robot", "ur5e", "--thresholds", "20,20"], "--thresholds: 2 of them; the robot has 6 joints: wanted 6"),
        (["--robot", "ur5e", "--thresholds", "20,0,20,20,20,20"], "is 0 for shoulder_lift_joint; wanted one number"),
        (["--robot", "ur5e", "--thresholds", "20,x"], "--thresholds: '20,x' cannot be read"),
        (["--thresholds", "1,1,1,1,1,1"], "--robot: is missing"),
        (["--robot", "panda", "--thresholds", "1,1,1,1,1,1,1"], "holds 6 joints, panda has 7"),
        (["--robot", "ur5e", "--model", "sia5d", "--thresholds", "1,1,1,1,1,1"], "is for a joint 'joint_s'"),
        (["--robot", "ur5e", "--thresholds", "1,1,1,1,1,1", "--residual", "other"], "--residual: 'other' is no kind"),
        (["--robot", "ur5e", "--thresholds", "9,9,9,9,9,9", "--observer-gain", "0"], "--observer-gain: is 0.0; wanted"),
        (
            ["--robot", "ur5e", "--thresholds", "9,9,9,9,9,9", "--payload", "-1"],
            "--payload: is -1.0 kg; wanted 0 to 100000",
        ),
        (
            ["--robot", "ur5e", "--thresholds", "9,9,9,9,9,9", "--payload", "1,2"],
            "--payload: '1,2' cannot be used; for example 1.5, or 1.5,0,0,0.06",
        ),
        (["--robot", "ur5e", "--thresholds", "9,9,9,9,9,9", "--arming-delay", "nan"], "--arming-delay: "),
        (["--robot", "ur5e", "--thresholds", "9,9,9,9,9,9", "--out", "/dev/null/x"], "--out: '/dev/null/x' cannot be"),
        (["--robot", "ur5e", "--thresholds", "9,9,9,9,9,9", "--direction", "0,0,0"], "--direction: has no length"),
        (["--robot", "ur5e", "--thresholds", "9,9,9,9,9,9", "--point-m", "0,0"], "--point-m: '0,0' cannot be used"),
        (
            ["--robot", "ur5e", "--thresholds", "9,9,9,9,9,9", "--point-m", "1e300,0,0"],
            "--point-m: is 1e+300,0,0; wanted from -100 to 100 m along each axis",
        ),
        (["--robot", "ur5e", "--thresholds", "9,9,9,9,9,9", "--link", "hand"], "--link: ur5e has no link 'hand'"),
        (["--robot", "ur5e", "--thresholds", "9,9,9,9,9,9", "--max-bad", "2"], "--max-bad"),
        (["--robot", "ur5e", "--thresholds", "9,9,9,9,9,9", "--rearm", "nan"], "--rearm: is nan; wanted zero or more"),
        (["--robot", "ur5e", "--thresholds", "9,9,9,9,9,9", "--rearm", "-1"], "--rearm: is -1.0; wanted zero or more"),
        (["--robot", "ur5e", "--thresholds", "9,9,9,9,9,9", "--from", "-inf"], "--from: is -inf; valid: 0 to "),
        (["--robot", "ur5e", "--thresholds", "9,9,9,9,9,9", "--until", "nan"], "--until: is nan; valid: 0 to "),
    ],
)
def test_refusals(pushed: Path, options: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "detect", pushed, *options)
    assert (status, out) == (2, "")
    assert err.startswith("error: ")
    assert message in err


@pytest.mark.parametrize(
    ("name", "file"),
    [("ur10", "ur10_ros2/ur10_exciting_trajectory.db3"), ("panda", "panda_ros2/panda_exciting_trajectory.db3")],
)
def test_real_arms_by_their_fitted_dynamics(
    name: str, file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Fitted to the first part; nothing touches the arm in the rest, and thresholds at half of it alarm."""
    path = SHARED / "data" / file
    if not path.exists():
        pytest.skip(f"{path} is absent: set BUMPSTOP_SHARED")
    log = Recording.load(path)
    split, model = 0.75 * log.duration, tmp_path / "arm.toml"
    # The bag's names, in the robot's order.
    columns = tmp_path / "columns.toml"
    columns.write_text(f"joint_names = {json.dumps(list(log.joint_names))}\n", encoding="utf-8")
    path_and_names = (path, "--columns", columns)
    run(capsys, "identify", *path_and_names, "--robot", name, "--until", split, "-o", model, "--cutoff", 4)
    wide = ",".join(["1000"] * log.dof)
    status, text, _ = run(
        capsys,
        "detect",
        *path_and_names,
        "--model",
        model,
        "--thresholds",
        wide,
        "--from",
        split,
        "--json",
        "--out",
        tmp_path,
    )
    assert status == 0
    assert json.loads(text)["events"] == []
    import polars as pl

    residuals = pl.read_parquet(tmp_path / "residuals.parquet").to_numpy()[:, 1:]
    largest = np.abs(residuals).max(axis=0)
    for factor, alarms in ((1.01, False), (0.5, True)):
        limits = ",".join(repr(float(x)) for x in factor * largest)
        _, text, _ = run(
            capsys, "detect", *path_and_names, "--model", model, "--thresholds", limits, "--from", split, "--json"
        )
        assert (json.loads(text)["events"] != []) == alarms
    # Gains that the recordings of the fit did not show: such a joint is monitored, but says nothing of forces.
    fit = DynamicsFit.load(model).model
    errors = np.where(np.arange(log.dof) == 1, np.inf, 0.0)
    unscaled = replace(fit, gains=np.ones(log.dof), unscaled=(1,))
    currents = replace(log, current=log.tau, tau=None)
    found = detect(currents, fit.robot, unscaled, 0.5 * largest)
    plain = detect(log, fit.robot, fit, 0.5 * largest)
    assert f"{fit.robot.joints[1].name}: of unknown gain" in " ".join(found.notes)
    assert [event.t for event in found.events] == [event.t for event in plain.events]
    settings = DetectorSettings(noise_sd=tuple(np.where(np.isinf(errors), np.inf, largest / 6)))
    wanted = detect(log, fit.robot, fit, 0.5 * largest, settings)
    assert [event.force_along for event in found.events] == [event.force_along for event in wanted.events]
    for options, what in (
        (("--residual", "observer"), "'observer'"),
        (("--payload", 1), "--payload: "),
        (("--payload-change", 1), "--payload-change: "),
        (("--measured-rates",), "--measured-rates: "),
        (("--limit-margin", 0.2), "--limit-margin: "),
    ):
        status, _, err = run(capsys, "detect", *path_and_names, "--model", model, "--thresholds", wide, *options)
        assert status == 2
        assert what in err
        assert "is not available with fitted dynamics" in err
        assert "or the residual of a loop, which has it (--causal, or causal = true)" in err


def test_a_loop_of_another_rate_than_its_thresholds_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Thresholds of a slower loop would alarm more often in a faster one, and nothing would tell it of that."""
    limits, made = tmp_path / "limits.toml", tmp_path / "detector.txt"
    limits.write_text("thresholds_Nm = [9, 9, 9, 9, 9, 9]\nperiod_s = 0.02\nresidual = 'observer'\n")
    words = ("detector", made, "--robot", "ur5e", "--thresholds", limits, "--residual")
    status, _, err = run(capsys, *words, "observer", "--period", "0.004")
    assert (status, err) == (2, "error: --period: is 0.004; the thresholds were found at 0.02\n")
    status, _, err = run(capsys, *words, "direct", "--period", "0.02")
    assert (status, err) == (2, "error: --residual: is 'direct'; the thresholds were found for 'observer'\n")
    assert not made.exists()
    status, _, err = run(capsys, *words, "observer", "--period", "0.02")
    assert status == 0, err


@pytest.mark.parametrize("period", ["1e9", "1e308", "1e-12", "0", "nan"])
def test_a_period_that_no_loop_has_is_refused(period: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The file would be one that read_detector refuses, or a loop's whose every sample is late."""
    words = ("detector", tmp_path / "detector.txt", "--robot", "ur5e", "--thresholds", "9,9,9,9,9,9")
    status, _, err = run(capsys, *words, "--period", period)
    assert status == 2
    assert err.startswith(f"error: --period: is {float(period)}; wanted ")


def test_files_of_a_run_without_data(pushed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing is left to be written as residuals, not even those of an earlier run, and all else is told."""
    given = ("--robot", "ur5e", "--thresholds", "20,20,20,9,9,9", "--out", tmp_path / "out")
    assert run(capsys, "detect", pushed, *given)[0] == 0
    short = tmp_path / "short.parquet"
    Recording.load(pushed).between(0.0, 0.02).save(short)
    status, text, _ = run(capsys, "detect", short, *given)
    assert status == 3
    assert text.startswith("INACTIVE all the time (filling 6 rows): nothing could be detected. 0 alarms in 0.02 s")
    assert "no residuals.parquet: the detector had no data all the time" in text
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "events.json",
        "report.html",
        "residuals.svg",
        "residuals.png",
    }
    assert "INACTIVE all the time" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert json.loads((tmp_path / "out" / "events.json").read_text(encoding="utf-8"))["rows"] == 6


def test_a_recording_of_another_robot_is_told(pushed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "of_another.parquet"
    replace(Recording.load(pushed), robot="ur10e").save(path)
    limits = ("--thresholds", "20,20,20,9,9,9")
    for arm, told in (("ur5e", True), ("ur10e", False)):
        _, text, _ = run(capsys, "detect", path, "--robot", arm, *limits, "--json")
        assert any("names robot 'ur10e'" in note for note in json.loads(text)["notes"]) == told


def test_a_fit_of_another_robot_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Fitted dynamics know their robot: another one beside them had no effect, and no word said so."""
    log, model, turned = tmp_path / "log.parquet", tmp_path / "arm.toml", tmp_path / "turned.urdf"
    planted(Robot.load("ur5e"), 1, seconds=12.0).save(log)
    assert run(capsys, "identify", log, "--robot", "ur5e", "--cutoff", 6, "-o", model)[0] == 0
    write_urdf(Robot.load("ur5e"), turned)
    text = turned.read_text(encoding="utf-8")
    limits = ("--thresholds", "90,90,90,30,30,30")
    given = ("--model", model, *limits)
    pose = ("--pose-deg", "0,-60,60,0,90,0")
    for name, option, words in (
        ("ur3e", "--robot", "is 'ur3e', and the model was fitted to 'ur5e'"),
        (turned, "--robot", "ur5e has a joint 'j_2' where the model's ur5e has 'shoulder_lift_joint'"),
        ("panda", "--robot", "panda has 7 joints, the model's ur5e has 6"),
    ):
        turned.write_text(text.replace("shoulder_lift_joint", "j_2"), encoding="utf-8")
        for command in (
            ("detect", log, *given, "--robot", name),
            ("score", log, *given, "--robot", name, "--labels", tmp_path / "labels.csv"),
            ("tune", log, "--model", model, "--robot", name),
            ("detector", tmp_path / "arm.det", *given, "--period", 0.01, "--robot", name),
        ):
            (tmp_path / "labels.csv").write_text("start_s,end_s\n2,3\n", encoding="utf-8")
            status, _, err = run(capsys, *command)
            assert status == 2, command
            assert f"{option}: {words}" in err
        if name != "panda":
            status, _, err = run(capsys, "sensitivity", name, *given, *pose)
            assert status == 2
            assert f"robot: {words}" in err
    turned.write_text(text, encoding="utf-8")
    for name in ("ur5e", turned):
        assert run(capsys, "detect", log, *given, "--robot", name)[0] == 0
        assert run(capsys, "sensitivity", name, *given, *pose)[0] == 0
