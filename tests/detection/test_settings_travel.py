"""What thresholds were tuned with goes with them: into detect, score and the written detector; what differs is said."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.detection import Detector, DetectorSettings, Thresholds
from bumpstop.identification import with_payload
from bumpstop.model import inverse_dynamics
from bumpstop.recording import Recording
from bumpstop.recording.read_report import ReadReport, payload_note
from cli.support import run, strict_json
from detection.moving_arms import free_motion

OTHERS = {
    "--window": ("0.05", "window_s", 0.05),
    "--limit-margin": ("0.3", "limit_margin", 0.3),
    "--frozen": ("0.2", "frozen_s", 0.2),
    "--payload": ("1.5", "payload_kg", 1.5),
}


@pytest.fixture(scope="module")
def free(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A UR5e without contact at 250 Hz for 40 s, with rates."""
    path = tmp_path_factory.mktemp("free") / "log.parquet"
    free_motion().save(path)
    return path


@pytest.fixture(scope="module")
def tuned(free: Path) -> Path:
    """Thresholds that were tuned with other settings than the defaults."""
    path = free.parent / "thresholds.toml"
    given = [word for option, (text, _, _) in OTHERS.items() for word in (option, text)]
    done = run("tune", free, "--robot", "ur5e", *given, "--measured-rates", "--residual", "observer", "--save", path)
    assert done.status == 0, done.err
    return path


def test_a_file_of_thresholds_carries_the_settings(tuned: Path) -> None:
    law = Thresholds.load(tuned)
    wanted = {name: value for _, name, value in OTHERS.values()}
    wanted |= {"residual": "observer", "observer_gain_1_s": 50.0, "measured_rates": True}
    assert law.settings == wanted
    assert law.period_s == pytest.approx(0.004)
    assert law.per_hour is not None
    assert f"{law.per_hour:.4g} false alarms an hour wanted" in tuned.read_text()
    again = tuned.with_name("again.toml")
    law.save(again)
    assert Thresholds.load(again).settings == wanted
    assert Thresholds.load(again).per_hour == law.per_hour
    # A detector without settings of its own has them.
    robot = bs.Robot.load("ur5e")
    assert Detector(robot, None, law).settings == DetectorSettings(**wanted)


def test_detect_and_score_take_what_is_not_given(free: Path, tuned: Path, tmp_path: Path) -> None:
    found = strict_json(run("detect", free, "--robot", "ur5e", "--thresholds", tuned, "--json").out)
    for _, name, value in OTHERS.values():
        assert found["settings"][name] == value
    assert found["settings"]["measured_rates"] is True
    assert found["settings"]["residual"] == "observer"
    assert found["settings"]["window_samples"] == 13
    assert not [note for note in found["notes"] if "Differs" in note]
    labels = tmp_path / "labels.csv"
    labels.write_text("start_s,end_s\n30,30.4\n")
    scored = run("score", free, "--robot", "ur5e", "--thresholds", tuned, "--labels", labels, "--json")
    assert scored.status == 0, scored.err
    other = strict_json(run("detect", free, "--robot", "ur5e", "--thresholds", tuned, "--window", 0.09, "--json").out)
    assert other["settings"]["window_s"] == 0.09
    assert (
        "Differs from what the thresholds were tuned with: window_s = 0.09 (tuned with 0.05). The tuned rate of "
        f"{Thresholds.load(tuned).per_hour:.4g} false alarms an hour does not hold."
    ) in other["notes"]


def test_the_detector_has_the_options_of_detect_and_warns(tuned: Path, tmp_path: Path) -> None:
    file = tmp_path / "arm.txt"
    same = run("detector", file, "--robot", "ur5e", "--thresholds", tuned)
    assert (same.status, same.err) == (0, "")
    assert "settings: residual observer, period_s 0.004, window_s 0.05, window_samples 13" in same.out
    lines = dict(line.split(" ", 1) for line in file.read_text().splitlines() if " " in line)
    assert (lines["window"], lines["frozen_time"], lines["measured_rates"]) == ("0.05", "0.2", "1.0")
    assert lines["payload"].startswith("1.5 ")
    assert lines["period"] == "0.004"
    assert float(lines["upper"].split()[0]) == pytest.approx(2 * math.pi + 0.3)
    given = (
        "--window", 0.1, "--frozen", 0.3, "--limit-margin", 0.2, "--payload", 0, "--payload-change", 0.7,
        "--direction", "1,0,0", "--link", "forearm_link", "--point-m", "0.1,0,0", "--arming-delay", 0.2,
    )  # fmt: skip
    other = run("detector", file, "--robot", "ur5e", "--thresholds", tuned, *given)
    assert other.status == 0, other.err
    assert other.err.startswith("warning: Differs from what the thresholds were tuned with: ")
    for text in ("window_s = 0.1 (tuned with 0.05)", "limit_margin = 0.2 (tuned with 0.3)", "payload_kg = 0 "):
        assert text in other.err
    lines = dict(line.split(" ", 1) for line in file.read_text().splitlines() if " " in line)
    assert (lines["window"], lines["arming_delay"], lines["payload_least"]) == ("0.1", "0.2", "0.7")
    assert lines["direction"] == "1.0 0.0 0.0"
    assert lines["contact"].startswith("2 0.1 ")


@pytest.mark.parametrize(
    ("tuned", "used", "differs"),
    [
        (None, None, False),
        (None, [0, 0, -9.80665], False),
        (None, [0, 0, 9.80665], True),
        ((0, 0, 9.80665), np.array([0, 0, 9.80665]), False),
        ((0, 0, 9.80665), [0, 0, -9.80665], True),
        ((0, 0, 9.80665), None, False),
    ],
)
def test_another_mounting_than_that_of_the_tuning_is_told(tuned: object, used: object, differs: bool) -> None:
    """No word of the thresholds is an upright arm, none of the detector is its model's mounting."""
    law = Thresholds(np.ones(6), residual="direct", gravity=tuned)  # type: ignore[arg-type]
    notes = law.differences(DetectorSettings(gravity=used))  # type: ignore[arg-type]
    assert any("gravity" in note for note in notes) == differs


GRIPPER = "1.07,0.02,-0.01,0.058"


@pytest.fixture(scope="module")
def gripping(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The torques of a UR5e whose gripper has its centre beside the tip, without noise, for 40 s."""
    mass, *center = (float(figure) for figure in GRIPPER.split(","))
    loaded, t = with_payload(bs.Robot.load("ur5e"), mass, center), 0.004 * np.arange(10_000)
    phase = 0.3 * t[:, None] + np.arange(6)
    q, qd, qdd = np.sin(phase), 0.3 * np.cos(phase), -0.09 * np.sin(phase)
    path = tmp_path_factory.mktemp("gripping") / "log.parquet"
    Recording(t=t, q=q, qd=qd, tau=inverse_dynamics(loaded, q, qd, qdd)).save(path)
    return path


def test_a_payload_is_given_with_its_centre_and_travels(gripping: Path, tmp_path: Path) -> None:
    """As ``identify`` takes it: in the frame of the tip. Settings have it in that of the last link."""
    robot, saved, printed = bs.Robot.load("ur5e"), tmp_path / "thresholds.toml", tmp_path / "thresholds.json"
    tune = ("tune", gripping, "--robot", "ur5e", "--json")
    whole = run(*tune, "--payload", GRIPPER, "--save", saved)
    assert whole.status == 0, whole.err
    printed.write_text(whole.out)
    at_tip = strict_json(run(*tune, "--payload", "1.07").out)
    assert max(strict_json(whole.out)["thresholds_Nm"]) < 0.1 * max(at_tip["thresholds_Nm"])
    assert at_tip["payload_kg"] == 1.07
    assert "payload_center" not in at_tip
    center = np.asarray(robot.tip_origin) + np.asarray(robot.tip_rotation) @ [0.02, -0.01, 0.058]
    for file in (saved, printed):
        law = Thresholds.load(file)
        assert law.payload_kg == 1.07
        np.testing.assert_allclose(law.payload_center, center, atol=1e-12)  # type: ignore[arg-type]
    options = ("--robot", "ur5e", "--thresholds", saved)
    for same in ((), ("--payload", GRIPPER)):
        found = strict_json(run("detect", gripping, *options, *same, "--json").out)
        np.testing.assert_allclose(found["settings"]["payload_center"], center, atol=1e-12)
        assert not [note for note in found["notes"] if "Differs" in note]
    other = strict_json(run("detect", gripping, *options, "--payload", "1.07", "--json").out)
    assert "payload_center" not in other["settings"]
    assert any("payload_center = the tip (tuned with (" in note for note in other["notes"])
    labels = tmp_path / "labels.csv"
    labels.write_text("start_s,end_s\n8,8.4\n")
    scored = run("score", gripping, *options, "--payload", GRIPPER, "--labels", labels, "--json")
    assert scored.status == 0, scored.err
    done = run("detector", tmp_path / "arm", *options)
    assert (done.status, done.err) == (0, "")
    lines = dict(line.split(" ", 1) for line in (tmp_path / "arm").read_text().splitlines() if " " in line)
    np.testing.assert_allclose([float(figure) for figure in lines["payload"].split()], [1.07, *center], atol=1e-12)


def test_another_centre_than_that_of_the_tuning_is_told() -> None:
    """Without a word of it the thresholds were found with the load at the tip."""
    at_tip = Thresholds(np.ones(6), residual="direct", payload_kg=1.0)
    assert at_tip.differences(DetectorSettings(payload_kg=1.0)) == []
    (note,) = at_tip.differences(DetectorSettings(payload_kg=1.0, payload_center=(0.0, 0.0, 0.1)))
    assert "payload_center = (0.0, 0.0, 0.1) (tuned with the tip)" in note


def test_a_payload_that_the_controller_was_told_of_is_no_note_once_it_is_declared(gripping: Path) -> None:
    mass, *center = (float(figure) for figure in GRIPPER.split(","))
    robot, told = bs.Robot.load("ur5e"), payload_note(mass, center)
    log = replace(Recording.load(gripping), report=ReadReport(notes=(told, "another")))
    link = tuple((np.asarray(robot.tip_origin) + np.asarray(robot.tip_rotation) @ center).tolist())
    for settings, noted in (
        (DetectorSettings(), True),
        (DetectorSettings(payload_kg=mass), True),
        (DetectorSettings(payload_kg=mass, payload_center=link), False),
    ):
        notes = Detector(robot, None, [9.0] * 6, settings).run(log).notes
        assert (told in notes) == noted
        assert "another" in notes


def test_a_detector_without_a_rate_is_refused(tmp_path: Path) -> None:
    done = run("detector", tmp_path / "arm", "--robot", "ur5e", "--thresholds", "9,9,9,9,9,9")
    assert done.status == 2
    assert done.err == "error: --period: is missing; the thresholds do not say at what rate they were found\n"


def test_settings_that_no_detector_has_are_refused_where_they_are_read(tmp_path: Path) -> None:
    path = tmp_path / "limits.toml"
    for text, message in (
        ("window_s = -1", "window_s: is -1"),
        ("frozen_s = 0", "frozen_s: is 0"),
        ('measured_rates = "yes"', "measured_rates: is 'yes'; wanted true or false"),
        ("payload_kg = -1.0", "payload_kg: is -1.0"),
        ("per_hour = 0", "per_hour: is 0; wanted more than zero"),
        ("per_hour = -60.0", "per_hour: is -60.0; wanted more than zero"),
        ("per_hour = inf", "per_hour: is inf; wanted a finite number"),
        ("per_hour = nan", "per_hour: is nan; wanted a finite number"),
        ('per_hour = "60"', "per_hour: '60' is not a number"),
        ("per_hour = true", "per_hour: True is not a number"),
        ("window = 8", "'window' is no key; did you mean 'window_s'"),
    ):
        path.write_text(f"thresholds_Nm = [1, 2]\n{text}\n")
        with pytest.raises(bs.InputError, match=message):
            Thresholds.load(path)


def test_feedback_that_may_stand_still_for_ever_travels_too(free: Path, tmp_path: Path) -> None:
    saved, printed = tmp_path / "thresholds.toml", tmp_path / "thresholds.json"
    done = run("tune", free, "--robot", "ur5e", "--frozen", "inf", "--save", saved, "--json")
    assert done.status == 0, done.err
    printed.write_text(done.out)
    assert Thresholds.load(saved).frozen_s == math.inf
    assert Thresholds.load(printed).frozen_s == math.inf
    found = json.loads(run("detect", free, "--robot", "ur5e", "--thresholds", saved, "--json").out)
    assert found["settings"]["frozen_s"] is None


def test_inactive_all_the_time_is_said_first_and_ends_with_3(free: Path, tmp_path: Path) -> None:
    """Each by another cause: nothing is monitored, beyond its limits, arming."""
    for options, why in (
        (("--thresholds", "inf,inf,inf,inf,inf,inf"), "no joint is monitored"),
        (("--thresholds", "9,9,9,9,9,9", "--arming-delay", 1000), "filling 17 rows, arming 9983 rows"),
    ):
        done = run("detect", free, "--robot", "ur5e", *options, "--out", tmp_path / "out")
        assert done.status == 3
        assert done.out.startswith(f"INACTIVE all the time ({why}): nothing could be detected. 0 alarms in 40 s")
        page = (tmp_path / "out" / "report.html").read_text()
        assert "detector inactive" in page
        assert page.index("INACTIVE all the time") < page.index("<table")
        done = run("detect", free, "--robot", "ur5e", *options, "--json")
        assert done.status == 3
        assert strict_json(done.out)["active"] is False
    done = run("detect", free, "--robot", "ur5e", "--thresholds", "99,99,99,99,99,99", "--json")
    assert (done.status, strict_json(done.out)["active"]) == (0, True)


@pytest.mark.parametrize("column", ["tau", "q", "speed"])
def test_joints_that_are_not_monitored_do_not_deactivate_the_detector(column: str, free: Path, tmp_path: Path) -> None:
    """Joint 3 is beyond its limits, faster than its limit, or its torque is more than a drive can give."""
    log = Recording.load(free)
    q, tau = log.q.copy(), log.tau.copy()  # type: ignore[union-attr]
    tau[5000:5100, 1] += 40
    if column == "q":
        q[:, 2] += 4 * np.pi
    robot = bs.Robot.load("ur5e")
    if column == "tau":
        tau[:, 2] = 1e9
    if column == "speed":
        robot = replace(
            robot,
            joints=tuple(replace(joint, velocity=0.01) if k == 2 else joint for k, joint in enumerate(robot.joints)),
        )
    settings = DetectorSettings(largest_signal=(500.0,) * 6)
    monitored = Detector(robot, None, [15.0] * 6, settings).run_rows(log.t, q, tau)
    assert monitored.no_data.mean() > 0.5
    run_ = Detector(robot, None, [15.0, 15, math.inf, 15, 15, 15], settings).run_rows(log.t, q, tau)
    assert not run_.inactive
    assert [event.joints for event in run_.events] == [(1,)]
    if column == "tau":
        tau[:, 2] = math.nan
        again = Detector(robot, None, [15.0, 15, math.inf, 15, 15, 15], settings).run_rows(log.t, q, tau)
        assert [event.t for event in again.events] == [event.t for event in run_.events]
        assert np.isfinite(again.residual[~again.no_data]).all()
