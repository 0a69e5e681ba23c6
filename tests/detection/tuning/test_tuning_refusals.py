"""What the commands of tuning refuse, trim and read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.cli.main import main
from bumpstop.detection import ResidualSeries, Thresholds, tune
from bumpstop.model import inverse_dynamics
from bumpstop.recording import Recording
from cli.support import EXAMPLE, run, strict_json
from detection.tuning_cases import residuals


def test_a_part_of_residuals(noise: Path, tmp_path: Path) -> None:
    """Times count from the first row; both ends belong to the part."""
    series = ResidualSeries.load(noise)
    late = tmp_path / "late.parquet"
    ResidualSeries(series.t + 100, series.rows).save(late)
    found = strict_json(run("tune", late, "--from", 20, "--until", 60, "--per-hour", 100, "--json").out)
    wanted = tune(ResidualSeries(series.t[5000:15001], series.rows[5000:15001]), 100.0)
    assert found["hours"] == pytest.approx(wanted.tail.hours, rel=1e-9)
    assert found["thresholds_Nm"] == pytest.approx(wanted.thresholds().tolist(), rel=1e-9)


def test_what_reading_a_recording_found_is_said_by_every_command(loop: tuple[Path, Path], tmp_path: Path) -> None:
    """Milliseconds taken for seconds make a quiet recording of hours out of one of seconds."""
    import polars as pl

    log = tmp_path / "ms.parquet"
    pl.read_parquet(loop[0]).with_columns(pl.col("t") * 1000).write_parquet(log)
    labels = tmp_path / "labels.csv"
    labels.write_text("start_s,end_s\n1,2\n")
    arm, thresholds = ("--robot", "ur5e"), ("--thresholds", "9,9,9,9,9,9")
    for command in (
        ("detect", log, *arm, *thresholds),
        ("score", log, *arm, *thresholds, "--labels", labels),
        ("tune", log, *arm, "--per-hour", "0.5"),
    ):
        done = run(*command, "--json")
        assert done.status == 0, done.err
        assert any("if these are no seconds" in note for note in json.loads(done.out)["notes"]), command[0]


def test_a_bad_scenario_is_told_before_the_tuning(
    noise: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Recordings of hours take minutes; that a scenario cannot be used is known at once."""

    def too_early(*_: object, **__: object) -> None:
        pytest.fail("the recordings were tuned on first")

    monkeypatch.setattr("bumpstop.detection.tune", too_early)
    damaged = tmp_path / "damaged.toml"
    damaged.write_text("[nonsense")
    for scenario, message in (
        (tmp_path / "none.toml", "cannot be read"),
        (damaged, "is not valid TOML"),
        (EXAMPLE.parent / "05_ur10e.toml", "has thresholds for 6 joints; the residuals have 7"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(["tune", str(noise), "--scenario", str(EXAMPLE), "--scenario", str(scenario)])
        assert ended.value.code == 2
        assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("tune", "NOISE", "--per-hour", "0"), "--per-hour: is 0"),
        (("tune", "NOISE", "--joints", "8"), "--joints: '8' cannot be used; wanted numbers from 1 to 7"),
        (("tune", "NOISE", "--joints", ""), "--joints: '' cannot be used"),
        (("tune", "NOISE", "--robot", "ur5e"), "--robot: has no meaning with the residuals"),
        (("tune", "NOISE", "--residual", "observer"), "--residual: has no meaning with the residuals"),
        (("tune", "NOISE", "--from", "70", "--until", "60"), "--from: 70 leaves nothing before 60; valid: 0 to "),
        (("tune", "LOG", "--robot", "ur5e", "--from", "50"), "--from: 50 leaves nothing before 39.996; valid: 0 to "),
        (("tune", "LOG", "--robot", "ur5e", "--residual", "obsever"), "did you mean 'observer'"),
        (("tune", "LOG", "--robot", "ur5e", "--model", "sia5d"), "is for a joint 'joint_s', which ur5e has not"),
        (
            ("score", "LOG", "--robot", "ur5e", "--labels", "LABELS", "--thresholds", "9,9"),
            "2 of them; the robot has 6",
        ),
        (
            ("score", "LOG", "--robot", "ur5e", "--labels", "LABELS", "--thresholds", "9,9,-9,9,9,9"),
            "thresholds_Nm[3]: is -9 for elbow_joint; wanted one number above 0",
        ),
        (("score", "NOISE", "--labels", "LABELS", "--thresholds", "9,9,9,9,9,9,0"), "thresholds_Nm[7]: is 0; wanted"),
        (
            ("score", "EVENTS", "--labels", "LABELS", "--thresholds", "9"),
            "--thresholds: has no meaning with the events",
        ),
        (("score", "EVENTS", "--labels", "LABELS", "--from", "9"), "--from: has no meaning with the events"),
        (("score", "EVENTS", "--labels", "LABELS", "--rearm", "1"), "--rearm: has no meaning with the events"),
        (("score", "EVENTS", "--labels", "LABELS", "--arming-delay", "1"), "--arming-delay: has no meaning with the e"),
        (
            ("tune", "LOG", "--robot", "ur5e", "--observer-gain", "20"),
            "--observer-gain: has no meaning with --residual d",
        ),
        (("tune", "LOG", "--robot", "ur5e", "--tip", "t"), "--tip: has no meaning with the built-in robot 'ur5e'"),
        (("tune", "NOISE", "--confidence", "2"), "--confidence: is 2"),
        (("tune", "nowhere.parquet"), "nowhere.parquet: there is no such file; wanted a recording"),
        (("tune", "DAMAGED"), "cannot be read as Parquet"),
        (("tune", "NOISE", "NOISE"), "are the same; give each recording once"),
        (("tune", "NOISE", "--scenario", "ur"), "has thresholds for 6 joints; the residuals have 7"),
        (("tune", "NOISE", "--per-hour", "60", "--save", "/nowhere/x.toml"), "cannot be written"),
        (("score", "NOISE", "--labels", "LABELS"), "--thresholds: is missing"),
        (("score", "NOISE", "--labels", "LABELS", "--thresholds", "1,2"), "--thresholds: 2 of them"),
        (("score", "NOISE", "--labels", "LABELS", "--thresholds", "1", "--early", "-1"), "--early: is -1"),
        (
            ("score", "NOISE", "--labels", "LABELS", "--thresholds", "SLOW"),
            "has a row every 0.004 s; the detector is made for thresholds period_s = 0.02",
        ),
        (("score", "LABELS.json", "--labels", "LABELS"), "cannot be read"),
        (("score", "EVENTS", "--labels", "LABELS"), "has no 'start_s'"),
        (("score", "HUGE", "--labels", "LABELS"), "holds no events"),
    ],
)
def test_refusals(
    arguments: tuple[str, ...], message: str, noise: Path, loop: tuple[Path, Path], tmp_path: Path
) -> None:
    labels, events = tmp_path / "labels.csv", tmp_path / "events.json"
    labels.write_text("start_s,end_s\n1,2\n")
    damaged = tmp_path / "damaged.parquet"
    damaged.write_bytes(noise.read_bytes()[:1000])
    events.write_text('{"events": []}')
    huge = tmp_path / "huge.json"
    huge.write_text(f'{{"events": [], "start_s": 0, "end_s": {10**400}, "no_data": []}}')
    slow = tmp_path / "slow.toml"
    slow.write_text(f"thresholds_Nm = {[9] * 7}\nperiod_s = 0.02\n")
    places = {
        "NOISE": noise, "LABELS": labels, "LABELS.json": tmp_path / "none.json", "EVENTS": events,
        "DAMAGED": damaged, "ur": EXAMPLE.parent / "05_ur10e.toml", "LOG": loop[0], "SLOW": slow,
        "HUGE": huge,
    }  # fmt: skip
    done = run(*(places.get(argument, argument) for argument in arguments))
    assert done.status == 2
    assert done.out == ""
    assert message in done.err
    assert done.err.startswith("error: ")
    assert "Traceback" not in done.err


def test_recordings_are_trimmed_by_time_from_both_ends(tmp_path: Path) -> None:
    """Jerky starts and ends of files of other lengths and clocks."""
    paths = []
    for number, hours in enumerate((0.05, 0.08)):
        one = residuals(hours, 40 + number)
        rows = one.rows.copy()
        rows[:50] += 300.0
        rows[-150:] -= 900.0
        paths.append(tmp_path / f"log_{number}.parquet")
        ResidualSeries(one.t + 100.0 * number, rows).save(paths[-1])
    jerky = run("tune", *paths, "--per-hour", 60)
    assert "The ends of recordings rule the thresholds: joint " in jerky.out
    assert "--trim-end" in jerky.out
    trimmed = strict_json(run("tune", *paths, "--per-hour", 60, "--trim-start", 0.5, "--trim-end", 1.5, "--json").out)
    assert not any("rule" in note for note in trimmed["notes"])
    calm = [residuals(hours, 40 + number) for number, hours in enumerate((0.05, 0.08))]
    wanted = tune([one.between(0.5, float(one.t[-1]) - 1.4999) for one in calm], 60.0).thresholds()
    np.testing.assert_allclose(trimmed["thresholds_Nm"], wanted, rtol=0.02)
    refused = run("tune", *paths, "--trim-start", 250)
    assert "--trim-start: leaves nothing of " in refused.err
    assert "log_0.parquet" in refused.err
    assert "--trim-end: is -1" in run("tune", *paths, "--trim-end", -1).err


def test_terms_are_tuned_saved_and_read_by_detect(tmp_path: Path) -> None:
    """Torque noise that grows with speed: thresholds that grow with it, and a band-pass channel."""
    rng = np.random.default_rng(4)
    arm = bs.Robot.load("ur5e")
    t = 0.004 * np.arange(15_000)
    paths = []
    for number in range(2):
        phase = rng.uniform(0, 6, 6)
        q = 0.4 * np.sin(0.8 * t[:, None] + phase)
        qd, qdd = 0.32 * np.cos(0.8 * t[:, None] + phase), -0.256 * np.sin(0.8 * t[:, None] + phase)
        tau = inverse_dynamics(arm, q, qd, qdd) + (0.2 + 3 * np.abs(qd)) * rng.standard_normal(q.shape)
        paths.append(tmp_path / f"free_{number}.parquet")
        Recording(t=t, q=q, tau=tau).save(paths[-1])
    saved = tmp_path / "thresholds.toml"
    given = ("tune", *paths, "--robot", "ur5e", "--per-hour", 120, "--terms", "fast,speed,acceleration")
    done = run(*given, "--save", saved, "--json")
    assert done.status == 0, done.err
    found = strict_json(done.out)
    law = Thresholds.load(saved)
    np.testing.assert_allclose(law.speed, found["per_speed_Nm_s"])
    np.testing.assert_allclose(law.fast, found["fast_Nm"])
    assert law.speed is not None
    assert (law.speed > 3 * law.constant).all()
    alarms = strict_json(run("detect", paths[0], "--robot", "ur5e", "--thresholds", saved, "--json").out)
    assert len(alarms["events"]) <= 8  # two wanted
    told = run(*given, "--out", tmp_path / "page").out
    assert "per speed" in told
    page = (tmp_path / "page" / "report.html").read_text()
    for heading in ("fast, Nm", "per speed, Nm s/rad", "per acceleration, Nm s2/rad"):
        assert f">{heading}<" in page
    assert f">{law.fast[0]:.4g}<" in page
    refused = run("tune", paths[0], "--robot", "ur5e", "--terms", "fats")
    assert "--terms: 'fats' is none; did you mean 'fast'" in refused.err


def test_motion_is_asked_of_recordings_only(noise: Path) -> None:
    refused = run("tune", noise, "--terms", "speed")
    assert "--terms: " in refused.err
    assert "holds residuals without the motion; give the recording" in refused.err


def test_what_is_said_of_one_of_several_recordings_names_it(loop: tuple[Path, Path], tmp_path: Path) -> None:
    """A short recording among those of many days was refused without its name, and counts of rows had none."""
    log = Recording.load(loop[0])
    first, second = tmp_path / "monday.parquet", tmp_path / "tuesday.parquet"
    log.between(0, 11.998).save(first)
    log.between(14, 25.998).save(second)
    told = run("tune", first, second, "--robot", "ur5e")
    assert told.status == 0, told.err
    for path in (first, second):
        assert f"note: {path}: 17 of 3000 rows are left out: the detector had no data." in told.out
    for rows, problem in ((5, "the detector has no data in all 5 rows"), (60, "43 rows; wanted at least 100")):
        log.between(14, 14 + 0.004 * (rows - 0.5)).save(second)
        refused = run("tune", first, second, "--robot", "ur5e")
        assert refused.err.startswith(f"error: {second}: {problem}"), refused.err
