"""``bumpstop tune`` and ``score``, and residuals on their way into a scenario."""

from __future__ import annotations

import json
import math
from dataclasses import replace
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


@pytest.fixture(scope="module")
def noise(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Residuals of the example's seven joints, a row every feedback period of 4 ms."""
    series = residuals(0.05, 1, joints=7)
    path = tmp_path_factory.mktemp("noise") / "free.parquet"
    ResidualSeries(np.arange(series.t.size) * 0.004, 0.4 * series.rows).save(path)
    return path


def test_tune_writes_thresholds_that_others_read(noise: Path, tmp_path: Path) -> None:
    saved, out = tmp_path / "thresholds.toml", tmp_path / "report"
    done = run("tune", noise, "--per-hour", 60, "--json", "--save", saved, "--out", out, "--scenario", EXAMPLE)
    assert done.status == 0, done.err
    found = strict_json(done.out)
    wanted = tune(ResidualSeries.load(noise), 60.0)
    assert found["thresholds_Nm"] == pytest.approx(wanted.thresholds().tolist(), rel=1e-12)
    assert found["per_hour"] == 60
    low, high = found["per_hour_interval"]
    assert low < 60 < high
    for value, (below, above) in zip(found["thresholds_Nm"], found["thresholds_interval_Nm"], strict=True):
        assert below < value < above
    np.testing.assert_allclose(Thresholds.load(saved).constant, wanted.thresholds(), rtol=1e-12)
    text = saved.read_text()
    assert "60 false alarms an hour wanted" in text
    assert str(noise) in text
    # Fewer alarms cost newtons.
    operating_curve = found["operating_curve"]
    rates = [point["per_hour"] for point in operating_curve]
    assert rates == sorted(rates)
    assert 60 in rates
    forces = [point["scenarios"][str(EXAMPLE)]["p95"] for point in operating_curve]
    assert forces == sorted(forces, reverse=True)
    assert forces[0] > 1.1 * forces[-1]
    undetectable = [point["scenarios"][str(EXAMPLE)]["anywhere"] for point in operating_curve]
    assert undetectable == sorted(undetectable, reverse=True)
    assert {path.name for path in out.iterdir()} == {
        "report.html", "alarm_rate.svg", "alarm_rate.png", "alarms_against_newtons.svg", "alarms_against_newtons.png",
    }  # fmt: skip
    page = (out / "report.html").read_text()
    # Powers at a logarithmic axis would be mathematical text, which figures do not set.
    assert ">nan<" not in page
    assert "mathdefault" not in page


def test_the_operating_curve_says_by_what_a_scenario_fails(noise: Path, tmp_path: Path) -> None:
    """Where its period is another, a scenario keeps its own noise: low thresholds drown in it, whatever the forces."""
    undetecting = tmp_path / "undetecting.toml"
    undetecting.write_text(EXAMPLE.read_text().replace("[0, 0, -50]", "[0, 0, -150]").replace("0.004", "0.006"))
    options = ("tune", noise, "--per-hour", 60, "--scenario", EXAMPLE, "--scenario", undetecting)
    found = strict_json(run(*options, "--json").out)
    for path, measured in ((EXAMPLE, noise), (undetecting, None)):
        scenario = bs.load_scenario(path)
        if measured is not None:
            data = scenario.to_dict()
            for key in ("noise_sd_Nm", "noise_mean_Nm", "noise_correlation"):
                data["detector"].pop(key, None)
            data["detector"]["residuals"] = str(measured)
            scenario = bs.Scenario.from_dict(data, path.parent)
        for point in found["operating_curve"]:
            forces = point["scenarios"][str(path)]
            thresholds = [math.inf if x is None else x for x in point["thresholds_Nm"]]
            verdict = bs.evaluate(
                scenario.with_values({"detector.thresholds_Nm": thresholds}), samples=20_000 if measured else None
            ).verdict
            assert forces["acceptable"] is verdict.acceptable
            assert ("false_alarm" in forces["fails_by"]) is (verdict.false_alarm_probability > 0.001)
            assert ("force" in forces["fails_by"]) is ((verdict.p_over_force or 0) > 0.001)
            assert ("pressure" in forces["fails_by"]) is ((verdict.p_over_pressure or 0) > 0.001)
    notes = " ".join(found["notes"])
    loud = sum("false_alarm" in point["scenarios"][str(undetecting)]["fails_by"] for point in found["operating_curve"])
    assert 0 < loud < len(found["operating_curve"])
    assert f"undetecting: at {loud} of {len(found['operating_curve'])} rates" in notes
    assert "undetecting: its feedback period is 0.006 s, and the thresholds were found at 0.004 s" in notes
    assert f"{EXAMPLE.stem}: its noise is the residuals of the recordings, in place of its own" in notes
    assert f"{EXAMPLE.stem}: its feedback period" not in notes
    printed = run("tune", noise, "--per-hour", 60, "--scenario", undetecting).out
    assert printed.count("no: ") == sum(
        not p["scenarios"][str(undetecting)]["acceptable"] for p in found["operating_curve"]
    )


def test_tune_for_people(noise: Path) -> None:
    done = run("tune", noise, "--per-hour", 0.1, "--joints", "1,2", "--scenario", EXAMPLE)
    assert done.status == 0, done.err
    assert "0.1 false alarms an hour; 95 % interval" in done.out
    assert "not monitored" in done.out
    assert "Extrapolated too far" in done.out
    assert "* more than 100 times what was recorded" in done.out


def test_residuals_become_the_noise_of_a_scenario(noise: Path) -> None:
    """The scenario's own noise, told from the file, is that of the file."""
    series = ResidualSeries.load(noise)
    scenario = bs.load_scenario(EXAMPLE)
    data = scenario.to_dict()
    for key in ("noise_sd_Nm", "noise_mean_Nm", "noise_correlation"):
        data["detector"].pop(key, None)
    data["detector"]["residuals"] = str(noise)
    problem = bs.CollisionProblem.from_scenario(bs.Scenario.from_dict(data, EXAMPLE.parent))
    assert problem.residuals is not None
    np.testing.assert_array_equal(problem.residuals.rows, series.rows)
    np.testing.assert_allclose(problem.noise_sd, series.rows.std(axis=0), rtol=1e-3)
    law = bs.evaluate(problem.scenario, samples=2000)
    assert 0 < law.peak_force.quantile(0.5) < math.inf
    # Thresholds tuned on the very residuals keep false alarms of short motions rare; half of them do not.
    tuned = tune(series, 10.0).thresholds()
    quiet, loud = (
        bs.evaluate(
            problem.scenario.with_values({"detector.thresholds_Nm": (factor * tuned).tolist()}), samples=2000
        ).false_alarm_probability
        for factor in (1.0, 0.4)
    )
    assert quiet < 0.01
    assert loud > 0.1


def test_score_of_residuals(noise: Path, tmp_path: Path) -> None:
    series = ResidualSeries.load(noise)
    thresholds = tune(series, 60.0).thresholds()
    rows = series.rows.copy()
    for start in (20.0, 60.0):
        rows[(series.t >= start) & (series.t < start + 0.5), 3] += 3 * thresholds[3]
    touched, labels, out = tmp_path / "touched.parquet", tmp_path / "labels.csv", tmp_path / "report"
    ResidualSeries(series.t, rows).save(touched)
    labels.write_text("start_s,end_s,kind\n20,20.5,push\n40,40.5,nothing\n60,60.5,push\n")
    limits = ",".join(repr(float(x)) for x in thresholds)
    done = run("score", touched, "--labels", labels, "--thresholds", limits, "--json", "--out", out)
    assert done.status == 0, done.err
    found = strict_json(done.out)
    assert found["kinds"] == {"push": {"detected": 2, "missed": 0}, "nothing": {"detected": 0, "missed": 1}}
    assert found["delay_s"]["max"] == pytest.approx(0, abs=1e-9)
    assert found["hours"] == pytest.approx((series.t[-1] - 3 * 0.8) / 3600)
    # Far below the thresholds the noise alarms without a pause, and no contact is an event of its own.
    detected = [row["detected"] for row in found["roc"] if row["factor"] >= 1]
    assert detected == sorted(detected, reverse=True)
    rates = {row["factor"]: row["false_alarms_per_hour"] for row in found["roc"]}
    assert rates[0.5] > rates[4.0] == 0
    drawn = {f"{name}.{ending}" for name in ("delay", "roc", "factors") for ending in ("svg", "png")}
    assert {path.name for path in out.iterdir()} == {"report.html"} | drawn
    assert "mathdefault" not in (out / "report.html").read_text()
    assert "detected 2 of 3" in run("score", touched, "--labels", labels, "--thresholds", limits).out
    # Without contacts there is nothing but alarms to show.
    labels.write_text("start_s,end_s\n")
    bare = tmp_path / "bare"
    done = run("score", touched, "--labels", labels, "--thresholds", limits, "--json", "--out", bare)
    assert strict_json(done.out)["false_alarms"] == found["false_alarms"] + 2
    assert {path.name for path in bare.iterdir()} == {"report.html", "factors.svg", "factors.png"}
    assert "missed" not in (bare / "report.html").read_text().split("Other thresholds")[-1]


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A recording of joint torque with noise, a UR5e at 250 Hz for 40 s, pushed from 30 s on; and a label of it."""
    folder = tmp_path_factory.mktemp("loop")
    robot, t = bs.Robot.load("ur5e"), 0.004 * np.arange(10_000)
    phase = 0.3 * t[:, None] + np.arange(6)
    q, qd, qdd = np.sin(phase), 0.3 * np.cos(phase), -0.09 * np.sin(phase)
    tau = inverse_dynamics(robot, q, qd, qdd) + np.random.default_rng(1).normal(0, 0.5, q.shape)
    tau[7500:7600, 1] += 60
    Recording(t=t, q=q, tau=tau).save(folder / "log.parquet")
    (folder / "labels.csv").write_text("start_s,end_s\n30,30.4\n")
    return folder / "log.parquet", folder / "labels.csv"


@pytest.mark.parametrize("kind", ["direct", "observer"])
def test_tune_on_the_first_part_and_score_the_rest(kind: str, loop: tuple[Path, Path], tmp_path: Path) -> None:
    log, labels = loop
    saved = tmp_path / "thresholds.toml"
    of = (log, "--robot", "ur5e", "--residual", kind)
    tuned = run("tune", *of, "--until", 20, "--save", saved)
    assert tuned.status == 0, tuned.err
    assert "1 shoulder_pan_joint" in tuned.out
    filling = 17 if kind == "direct" else 18  # the observer begins at the first row with rates
    assert f"{filling} of 5001 rows are left out: the detector had no data" in tuned.out
    found = run("score", *of, "--from", 20, "--labels", labels, "--thresholds", saved, "--json")
    score = strict_json(found.out)
    assert (score["detected"], score["missed"], score["false_alarms"]) == (1, 0, 0)
    # The observer is late by about 1 / K, and by its length the push is well over what noise leaves of the threshold.
    assert 0 <= score["delay_s"]["max"] <= (0.0 if kind == "direct" else 0.02)
    # Thresholds of one residual are not those of another.
    other = "observer" if kind == "direct" else "direct"
    refused = run("detect", log, "--robot", "ur5e", "--residual", other, "--thresholds", saved)
    assert (refused.status, refused.out) == (2, "")
    assert f"--residual: is {other!r}; the thresholds were found for {kind!r}" in refused.err
    if kind == "observer":
        refused = run("detect", *of, "--observer-gain", 20, "--thresholds", saved)
        assert "--observer-gain: is 20; the thresholds were found for 50" in refused.err
        # The noise of an observer with a smaller gain is smaller, and so are its thresholds.
        slow = strict_json(run("tune", *of, "--observer-gain", 10, "--until", 20, "--json").out)["thresholds_Nm"]
        assert all(a < 0.7 * b for a, b in zip(slow, Thresholds.load(saved).constant, strict=True))


def test_thresholds_as_json_hold_for_their_rate_and_residual_too(loop: tuple[Path, Path], tmp_path: Path) -> None:
    saved, printed = tmp_path / "thresholds.toml", tmp_path / "thresholds.json"
    arm = ("--robot", "ur5e", "--residual", "observer", "--observer-gain", 20)
    done = run("tune", loop[0], *arm, "--per-hour", 600, "--json", "--save", saved)
    assert done.status == 0, done.err
    printed.write_text(done.out)
    ours, theirs = Thresholds.load(printed), Thresholds.load(saved)
    assert ours.period_s == pytest.approx(0.004)
    for name in ("period_s", "residual", "observer_gain_1_s"):
        assert getattr(ours, name) == getattr(theirs, name)
    done = run("detector", tmp_path / "slow", *arm, "--thresholds", printed, "--period", 0.02)
    assert done.err == "error: --period: is 0.02; the thresholds were found at 0.004\n"


def test_joints_that_a_model_cannot_tell_are_not_monitored(tmp_path: Path) -> None:
    """The built-in model of the SIA5D has no seventh joint."""
    t = 0.004 * np.arange(3000)
    q = 0.2 + 0.02 * t[:, None] * np.ones(7)
    Recording(t=t, q=q, current=np.random.default_rng(2).normal(0, 9, q.shape)).save(tmp_path / "log.parquet")
    done = run("tune", tmp_path / "log.parquet", "--model", "sia5d", "--per-hour", 600, "--json")
    assert done.status == 0, done.err
    found = strict_json(done.out)
    assert [value is None for value in found["thresholds_Nm"]] == [False] * 6 + [True]
    assert "joint_t: without a joint model, not monitored." in found["notes"]
    assert "Not monitored: joint 7." in found["notes"]
    assert "The residual of joint 7 never changes." in found["notes"]


def test_residuals_of_a_loop_that_loses_samples_are_noise(noise: Path, tmp_path: Path) -> None:
    """Ticks come when they come: 3 % of them lost and times off by a tenth of a period; but not with 6 % lost."""
    series, rng = ResidualSeries.load(noise), np.random.default_rng(4)
    t = series.t + rng.uniform(-4e-4, 4e-4, series.t.size)
    scenario = bs.load_scenario(EXAMPLE).to_dict()
    for key in ("noise_sd_Nm", "noise_mean_Nm", "noise_correlation"):
        scenario["detector"].pop(key, None)
    for lost, usable in ((0.03, True), (0.06, False)):
        kept = rng.random(t.size) >= lost
        path = tmp_path / f"{lost}.parquet"
        ResidualSeries(t[kept], series.rows[kept]).save(path)
        scenario["detector"]["residuals"] = str(path)
        made = bs.Scenario.from_dict(scenario, EXAMPLE.parent)
        if not usable:
            with pytest.raises(bs.InputError, match="are uneven; at most 5 % may be"):
                bs.CollisionProblem.from_scenario(made)
            continue
        record = bs.CollisionProblem.from_scenario(made).residuals
        assert record is not None
        gaps = int(np.count_nonzero(np.diff(np.flatnonzero(kept)) > 1))
        assert f"{gaps} of {kept.sum() - 1} intervals" in record.notes[0]


def test_a_joint_beyond_its_limits_is_told(loop: tuple[Path, Path], tmp_path: Path) -> None:
    log = Recording.load(loop[0])
    q = log.q.copy()
    q[:, 2] += 4 * np.pi
    far = tmp_path / "far.parquet"
    replace(log, q=q).save(far)
    refused = run("tune", far, "--robot", "ur5e")
    assert refused.status == 2
    assert "the detector has no data in all 10000 rows (outside_limits 10000); elbow_joint: at " in refused.err
    assert "beyond its limits -6.283 to 6.283 by more than limit_margin = 0.1, in 10000 of 10000 rows" in refused.err
    thresholds = [
        strict_json(run("tune", path, "--robot", "ur5e", "--limit-margin", margin, "--until", 20, "--json").out)
        for path, margin in ((far, 8), (loop[0], 0.1))
    ]
    # The angle's sine and cosine differ by rounding.
    assert thresholds[0]["thresholds_Nm"] == pytest.approx(thresholds[1]["thresholds_Nm"], rel=1e-6)


@pytest.mark.parametrize("told", ["on and on", "within a turn"])
def test_a_last_wrist_turns_without_end(told: str, loop: tuple[Path, Path], tmp_path: Path) -> None:
    """Its limits guard cables; the same angles are told beyond them, or from -pi to pi."""
    log = Recording.load(loop[0])
    q = log.q.copy()
    q[:, 5] = q[:, 5] + 4 * np.pi if told == "on and on" else (q[:, 5] + np.pi - 0.9) % (2 * np.pi) - np.pi + 0.9
    far = tmp_path / "far.parquet"
    replace(log, q=q).save(far)
    thresholds = [
        strict_json(run("tune", path, "--robot", "ur5e", "--until", 20, "--json").out)["thresholds_Nm"]
        for path in (far, loop[0])
    ]
    assert thresholds[0] == pytest.approx(thresholds[1], rel=1e-6)


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
    """Torque noise that grows with speed: thresholds that grow with it, and a fast channel."""
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
    told = run(*given).out
    assert "per speed" in told
    refused = run("tune", paths[0], "--robot", "ur5e", "--terms", "fats")
    assert "--terms: 'fats' is none; did you mean 'fast'" in refused.err


def test_motion_is_asked_of_recordings_only(noise: Path) -> None:
    refused = run("tune", noise, "--terms", "speed")
    assert "--terms: " in refused.err
    assert "holds residuals without the motion; give the recording" in refused.err
