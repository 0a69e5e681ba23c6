"""``bumpstop tune`` and ``score``, and residuals on their way into a scenario."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.detection import ResidualSeries, Thresholds, tune
from bumpstop.detection.durations import hours_in_words, rates_in_words
from bumpstop.recording import Recording
from cli.support import EXAMPLE, run, strict_json
from detection.tuning_cases import residuals


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


def test_the_scenario_that_new_writes_is_taken(tmp_path: Path) -> None:
    """It calls its noise assumed, in place of which the recordings' own is taken; an uncertain one alike."""
    noise, cell, saved = tmp_path / "noise.parquet", tmp_path / "cell.toml", tmp_path / "thresholds.toml"
    series = residuals(0.05, 1, joints=6)
    ResidualSeries(np.arange(series.t.size) * 0.008, series.rows).save(noise)
    assert run("new", "ur10", "--out", cell).status == 0
    assert "detector.noise_sd_Nm" in bs.load_scenario(cell).assumed
    done = run("tune", noise, "--per-hour", 60, "--scenario", cell, "--save", saved)
    assert (done.status, done.err) == (0, "")
    assert "cell: its noise is the residuals of the recordings, in place of its own." in done.out
    assert saved.exists()
    uncertain = '[uncertainty]\n"detector.noise_sd_Nm" = { distribution = "normal", relative_sd = 0.1 }\n'
    cell.write_text(cell.read_text() + uncertain)
    done = run("tune", noise, "--per-hour", 60, "--scenario", cell)
    assert (done.status, done.err) == (0, "")


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
    assert "The residual of joint 7 is 0 all the time: its gain or its model is unknown." in found["notes"]


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


@pytest.mark.parametrize("turns", [2, -2])
def test_a_joint_beyond_its_limits_is_told(turns: int, loop: tuple[Path, Path], tmp_path: Path) -> None:
    log = Recording.load(loop[0])
    q = log.q.copy()
    q[:, 2] += turns * 2 * np.pi
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


def test_rates_and_durations_are_told_as_a_person_would(tmp_path: Path) -> None:
    """Half a minute is no 0.007647 h, and a rate of 4e-06 to 9e+03 an hour is less than 0.001 to some thousands."""
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(3440, 2)) * (1 + 3 * (rng.random((3440, 1)) > 0.997))
    ResidualSeries(0.008 * np.arange(3440.0), rows).save(tmp_path / "short.parquet")
    done = run("tune", tmp_path / "short.parquet", "--save", tmp_path / "limits.toml", "--out", tmp_path / "page")
    assert done.status == 0, done.err
    interval = done.out.splitlines()[0].partition(" interval ")[2]
    assert f"interval of the rate: {interval} an hour." in (tmp_path / "page" / "report.html").read_text()
    for text in (done.out, (tmp_path / "limits.toml").read_text()):
        assert "independent peaks in 27.52 s;" in text
        assert "27.52 s carry one alarm" in text
        assert re.search(r"interval:? (less than 0.001|[\d.]+) to [\d.]+( an hour)?$", text, flags=re.MULTILINE)
        assert not re.search(r"\de[-+]\d\d", text)
    assert "# from 27.52 s; one alarm" in (tmp_path / "limits.toml").read_text()
    times = [hours_in_words(hours) for hours in (0.00375, 0.2, 1.0, 72_000.0)]
    assert times == ["13.5 s", "12 min", "1 h", "72000 h"]
    assert [rates_in_words(*ends) for ends in ((4.041e-06, 9341.2), (1.27, 72.6), (2e-5, 8e-5))] == [
        "less than 0.001 to 9341", "1.27 to 72.6", "2e-05 to 8e-05",
    ]  # fmt: skip


def test_a_scenario_and_a_recording_of_another_robot_are_told(loop: tuple[Path, Path], tmp_path: Path) -> None:
    log, scenario = tmp_path / "log.parquet", EXAMPLE.parent / "05_ur10e.toml"
    replace(Recording.load(loop[0]), robot="ur5e").save(log)
    found = strict_json(run("tune", log, "--robot", "ur5e", "--scenario", scenario, "--json").out)["notes"]
    assert "05_ur10e: its robot is 'ur10e', and the thresholds were tuned for 'ur5e'." in found
    assert not any("names robot" in note for note in found)
    other = strict_json(run("tune", log, "--robot", "ur10e", "--scenario", scenario, "--json").out)["notes"]
    assert not any("its robot is" in note for note in other)
    assert any("The file names robot 'ur5e', and is read as a recording of 'ur10e'" in note for note in other)
