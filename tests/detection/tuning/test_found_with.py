"""Files of residuals say what they were found with: tune, score and scenarios hear of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.cli.collision.output import settings_toml
from bumpstop.detection import DetectorSettings, ResidualSeries, Thresholds, residual_record
from bumpstop.detection.tuning.found_with import found_with
from bumpstop.identification import DynamicsFit
from bumpstop.joint import JointTorqueModel
from bumpstop.recording import Recording
from cli.support import run, strict_json
from detection.moving_arms import free_motion


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A UR5e without contact at 250 Hz for 40 s."""
    path = tmp_path_factory.mktemp("free") / "log.parquet"
    free_motion().save(path)
    return path


def written(log: Path, name: str, *given: object) -> Path:
    """Residuals that ``detect`` writes with other options."""
    out = log.parent / name
    done = run("detect", log, "--robot", "ur5e", "--thresholds", "inf,inf,inf,inf,inf,inf", *given, "--out", out)
    assert done.status in (0, 3), done.err
    return out / "residuals.parquet"


def test_a_file_carries_its_settings_into_thresholds(log: Path, tmp_path: Path) -> None:
    file, saved = written(log, "observer", "--residual", "observer", "--window", "0.05"), tmp_path / "thresholds.toml"
    assert ResidualSeries.load(file).found_with["model"] == "none: recorded torque"
    assert run("tune", file, "--per-hour", 60, "--save", saved).status == 0
    assert Thresholds.load(saved).settings == {
        "residual": "observer",
        "observer_gain_1_s": 50.0,
        "window_s": 0.05,
        "measured_rates": False,
        "limit_margin": 0.1,
        "frozen_s": 0.1,
        "payload_kg": 0.0,
    }
    refused = run("detect", log, "--robot", "ur5e", "--thresholds", saved, "--residual", "direct")
    assert "the thresholds were found for 'observer'" in refused.err
    copied = tmp_path / "part.parquet"
    ResidualSeries.load(file).between(0, 20).save(copied)
    assert ResidualSeries.load(copied).found_with == ResidualSeries.load(file).found_with


def test_files_of_other_residuals_are_not_joined(log: Path) -> None:
    direct, observer = written(log, "direct"), written(log, "observer", "--residual", "observer")
    refused = run("tune", direct, observer)
    assert refused.status == 2
    assert f'{observer}: holds residuals of residual = "observer"; those of {direct} are of "direct"' in refused.err
    gain = written(log, "gain", "--residual", "observer", "--observer-gain", "20")
    assert "holds residuals of observer_gain_1_s = 20.0; those of" in run("tune", observer, gain).err


def test_what_differs_between_files_is_said_and_not_written(log: Path, tmp_path: Path) -> None:
    short, long, saved = written(log, "short"), written(log, "long", "--window", "0.1"), tmp_path / "thresholds.toml"
    loaded = written(log, "loaded", "--payload", "2")
    done = run("tune", short, long, "--per-hour", 60, "--save", saved)
    assert done.status == 0, done.err
    told = " ".join(done.out.split())
    assert f"were found with something else than those of {short}: window_s = 0.1 (there 0.07)" in told
    assert "window_s" not in Thresholds.load(saved).settings
    assert Thresholds.load(saved).residual == "direct"
    assert "payload_kg = 2.0 (there 0.0)" in " ".join(run("tune", short, loaded).out.split())
    halves = [tmp_path / "first.parquet", tmp_path / "second.parquet"]
    for part, start in zip(halves, (0, 20), strict=True):
        ResidualSeries.load(long).between(start, start + 20).save(part)
    assert "something else" not in run("tune", *halves, "--save", saved).out
    assert Thresholds.load(saved).settings["window_s"] == 0.1


def test_a_file_that_does_not_say_is_named(log: Path, tmp_path: Path) -> None:
    short, dumb = written(log, "short"), tmp_path / "dumb.parquet"
    series = ResidualSeries.load(short)
    ResidualSeries(series.t, 1.1 * series.rows).save(dumb)
    for given in ((short, dumb), (dumb, short)):
        done = strict_json(run("tune", *given, "--json").out)
        assert any(note.startswith(f"{dumb} does not say what its residuals were found with") for note in done["notes"])
        assert "residual" not in done
    assert "does not say" not in run("tune", dumb).out


def test_score_compares_residuals_with_what_thresholds_are_for(log: Path, tmp_path: Path) -> None:
    short, saved, labels = written(log, "short"), tmp_path / "thresholds.toml", tmp_path / "labels.csv"
    labels.write_text("start_s,end_s\n10,11\n")
    assert run("tune", log, "--robot", "ur5e", "--window", "0.1", "--save", saved).status == 0
    done = strict_json(run("score", short, "--labels", labels, "--thresholds", saved, "--json").out)
    assert any("window_s = 0.07 (tuned with 0.1)" in note for note in done["notes"])
    observer = written(log, "observer", "--residual", "observer")
    refused = run("score", observer, "--labels", labels, "--thresholds", saved)
    assert refused.status == 2
    assert f"{observer}: is 'observer'; the thresholds were found for 'direct'" in refused.err


def test_score_names_a_file_that_does_not_say_and_one_of_another_mounting(log: Path, tmp_path: Path) -> None:
    short, labels, dumb = written(log, "short"), tmp_path / "labels.csv", tmp_path / "dumb.parquet"
    labels.write_text("start_s,end_s\n10,11\n")
    replace(ResidualSeries.load(short), found_with={}).save(dumb)
    saved, mounted = tmp_path / "thresholds.toml", tmp_path / "mounted.toml"
    assert run("tune", short, "--save", saved).status == 0
    mounted.write_text(saved.read_text() + "gravity = [0.0, -9.80665, 0.0]\n")

    def told(file: Path, thresholds: object) -> str:
        done = run("score", file, "--labels", labels, "--thresholds", thresholds, "--json")
        return " ".join(strict_json(done.out)["notes"])

    assert f"{dumb} does not say what its residuals were found with" in told(dumb, saved)
    assert "does not say" not in told(dumb, "9,9,9,9,9,9") + told(short, saved)
    assert "Differs" not in told(short, saved)
    assert "gravity = " in told(short, mounted)


def test_scenarios_keep_their_noise_beside_residuals_of_another_kind(log: Path, tmp_path: Path) -> None:
    """Also where one of the files does not say its kind."""
    observer, dumb = written(log, "observer", "--residual", "observer"), tmp_path / "dumb.parquet"
    series = ResidualSeries.load(observer)
    ResidualSeries(series.t, 1.1 * series.rows).save(dumb)
    base = bs.load_scenario("examples/05_ur10e.toml", {"detector.feedback_period_s": 0.004})
    for name, changes in (
        ("direct", {"detector.residual": "direct"}),
        ("fast", {"detector.residual": "observer", "detector.observer_gain_1_s": 20}),
    ):
        (tmp_path / f"{name}.toml").write_text(settings_toml(bs.evaluate(base.with_values(changes))))
    given = [word for name in ("direct", "fast") for word in ("--scenario", tmp_path / f"{name}.toml")]
    done = run("tune", observer, dumb, "--per-hour", 60, *given, "--json")
    assert done.status == 0, done.err
    notes = strict_json(done.out)["notes"]
    for said in (
        "direct: its residual is 'direct', and the thresholds were found for 'observer': its own noise is kept",
        "fast: its observer has 20 1/s, and the thresholds were found for 50: its own noise is kept",
    ):
        assert any(note.startswith(said) for note in notes), notes
    alone = strict_json(run("tune", observer, "--per-hour", 60, *given, "--json").out)["notes"]
    assert any("its robot is 'ur10e', and the thresholds were tuned for 'ur5e'" in note for note in alone)


def test_models_differ_by_what_is_in_them(log: Path, tmp_path: Path) -> None:
    """Files with the same name in two folders may be two models, and a copy is the same."""
    fits, names = [], []
    for number, until in enumerate(("20", "20", "30")):
        fits.append(tmp_path / str(number) / "arm.toml")
        fits[-1].parent.mkdir()
        assert run("identify", log, "--robot", "ur5e", "--until", until, "-o", fits[-1]).status in (0, 3)
        model = DynamicsFit.load(fits[-1]).model
        names.append(residual_record(Recording.load(log), model.robot, model).found_with["model"])
    assert names[0].startswith("fitted dynamics ")
    assert names[0] == names[1] != names[2]
    joints = JointTorqueModel.load("sia5d")
    joints.save(tmp_path / "copy.toml")
    others = (joints, JointTorqueModel.load(tmp_path / "copy.toml"), replace(joints, joints=joints.joints[:-1]))
    kinds = [found_with(bs.Robot.load("sia5d"), other, DetectorSettings())["model"] for other in others]
    assert kinds[0] == kinds[1] != kinds[2]


def test_a_scenario_refuses_residuals_of_another_kind(log: Path) -> None:
    file = written(log, "observer", "--residual", "observer")
    scenario = bs.load_scenario("examples/05_ur10e.toml")
    data = scenario.to_dict()
    for key in ("noise_sd_Nm", "noise_mean_Nm", "noise_correlation"):
        data["detector"].pop(key, None)
    data["detector"] |= {"residuals": str(file), "feedback_period_s": 0.004}
    with pytest.raises(bs.InputError, match="holds the observer residual"):
        bs.evaluate(bs.Scenario.from_dict(data, scenario.folder))


def test_what_no_detector_has_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "odd.parquet"
    for odd in ({"window_s": -1.0}, {"other": 3}, {"degree": 3}):
        ResidualSeries(0.004 * np.arange(200), np.ones((200, 2)), found_with=odd).save(file)
        with pytest.raises(bs.InputError, match="says of its residuals what cannot be"):
            ResidualSeries.load(file)


def test_a_scenario_says_that_its_residuals_are_of_another_robot(log: Path) -> None:
    path = written(log, "short")
    base = bs.load_scenario("examples/05_ur10e.toml", {"detector.feedback_period_s": 0.004})
    said = "The residuals are of the robot 'ur5e', and this one is {!r}."
    for robot, told in (("ur10e", True), ("ur5e", False)):
        changes = {"robot": robot, "detector.residuals": str(path), "detector.noise_sd_Nm": None}
        notes = bs.evaluate(base.with_values(changes), samples=1000).notes
        assert (said.format(robot) in notes) == told, notes
