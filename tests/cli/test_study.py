"""``bumpstop study``: what it prints, what it leaves, and what it refuses."""

from __future__ import annotations

import errno
import html
import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import bumpstop as bs
from bumpstop.detection.tuning.residual_record import write_residuals
from bumpstop.output_files import write_bytes
from bumpstop.study.parameters.effectiveness import EffectivenessStudy
from bumpstop.study.study import Study
from cli.support import EXAMPLE, REPOSITORY, run, strict_json

SLOW = ("--set", "motion.velocity_mm_s=[0, 0, -10]")
QUICK = {
    "parameters": ("--vary", "motion.speed=40:60:5"),
    "effectiveness": ("--body", "hand_finger", "--direction", "down", "--speed", 50, "--highest-speed", 20),
    "workspace": (*SLOW, "--poses", 20, "--speed-sd", 2),
}


@pytest.mark.parametrize("name", list(QUICK))
def test_files_and_json_say_the_same(name: str, tmp_path: Path) -> None:
    result = run("study", name, EXAMPLE, "--json", "--out", tmp_path, *QUICK[name])
    assert (result.status, result.err) == (0, "")
    printed = strict_json(result.out)
    assert printed.pop("seconds") > 0
    assert printed == strict_json((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert printed["study"] == name
    rows = pl.read_parquet(tmp_path / "rows.parquet")
    assert rows.height > 0
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    for unwanted in ("<script", "<link", 'src="', ">nan<", ">inf<", ">None<"):
        assert unwanted not in html
    figures = {path.stem for path in tmp_path.glob("*.svg")}
    assert figures == {path.stem for path in tmp_path.glob("*.png")}
    assert figures
    assert not (tmp_path / "shards").exists()


@pytest.mark.parametrize("name", list(QUICK))
def test_words_for_people(name: str) -> None:
    result = run("study", name, EXAMPLE, *QUICK[name])
    assert (result.status, result.err) == (0, "")
    wanted = {
        "parameters": "motion.speed 40 to 60 mm/s: up; quadratic",
        "effectiveness": "bgia2011 hand_finger down 2 cm²: 20 or more",
        "workspace": "20 distributions; 0 poses start at a singularity",
    }
    assert wanted[name] in result.out
    assert "rows in" in result.out


def test_speed_limits_without_a_safe_speed_says_that_nothing_is_retimed(tmp_path: Path) -> None:
    path = EXAMPLE.parent / "06_pick_and_place_trajectory.toml"
    result = run("study", "speed-limits", path, "--out", tmp_path, "--set", "contact.area_cm2=0.0001")
    assert result.status == 3
    assert "76 of 76 waypoints are passed faster than is safe" in result.out
    assert re.search(r"at (\d+) of \1 places no speed is safe", result.out)
    assert "there is no slower trajectory: at some places no speed is safe" in result.out
    assert not (tmp_path / "retimed.csv").exists()


def test_speed_limits_tells_durations_verdicts_and_files_everywhere(tmp_path: Path) -> None:
    path = EXAMPLE.parent / "06_pick_and_place_trajectory.toml"
    result = run("study", "speed-limits", path, "--out", tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text())
    before, after = summary["duration_s"], summary["retimed_duration_s"]
    assert before == 3.0 < after < 6
    assert f"slowed down, {after:.4g} s instead of 3 s: " in result.out
    assert "as given, 3 s: NOT ACCEPTABLE. " in result.out
    for name in ("retimed.csv", "retimed.json", "speed_limit.csv"):
        assert str(tmp_path / name) in result.out
        assert (tmp_path / name).is_file()
    page = (tmp_path / "report.html").read_text()
    assert f"{after:.4g} s" in page
    assert "in these directions: the motion's own" in html.unescape(page)
    # The same words as of evaluate, before and after.
    for changes, key in (((), "verdict"), (("--set", f"motion.file={tmp_path / 'retimed.csv'}"), "retimed_verdict")):
        judged = run("evaluate", path, "--json", *changes)
        assert json.loads(judged.out)["verdict"]["reason"] == summary[key]["reason"]
        assert json.loads(judged.out)["verdict"]["acceptable"] == summary[key]["acceptable"]


def test_singular_waypoints_do_not_end_speed_limits(tmp_path: Path) -> None:
    """A UR that starts with a straight wrist and turns about its base: keys that nobody wrote are not blamed."""
    rows = [f"{t},{0.1 * t**2},-1.5,1.2,0,0,0" for t in (0, 0.5, 1, 1.5, 2)]
    (tmp_path / "t.csv").write_text("\n".join(["t,q_1,q_2,q_3,q_4,q_5,q_6", *rows]) + "\n")
    changes = {
        "robot": "ur10e", "motion.file": tmp_path / "t.csv", "detector.thresholds_Nm": [20] * 6,
        "detector.noise_sd_Nm": 2.0,
    }  # fmt: skip
    options = [part for key, value in changes.items() for part in ("--set", f"{key}={value}")]
    result = run("study", "speed-limits", EXAMPLE.parent / "06_pick_and_place_trajectory.toml", *options)
    assert result.status in (0, 3)
    assert "no straight line can be followed" in result.out


def test_a_seed_is_refused_where_nothing_is_drawn() -> None:
    result = run("study", "speed-limits", EXAMPLE.parent / "06_pick_and_place_trajectory.toml", "--seed", 3)
    assert (result.status, result.out) == (2, "")
    assert result.err.startswith("error: --seed: has no meaning with a trajectory")


@pytest.mark.usefixtures("unsaved_pictures")
def test_a_page_says_whether_its_laws_are_exact(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bumpstop.collision.evaluation.RESAMPLED_RUNS", 2000)
    noise = np.random.default_rng(0).normal(0, 1.8, (400, 7))
    write_residuals(tmp_path / "free.parquet", 0.004 * np.arange(400), noise)
    text = EXAMPLE.read_text(encoding="utf-8")
    measured = re.sub("noise_sd_Nm = .*", 'residuals = "free.parquet"', text)
    (tmp_path / "measured.toml").write_text(measured, encoding="utf-8")
    for name, scenario in (("exact", EXAMPLE), ("drawn", tmp_path / "measured.toml")):
        result = run("study", "parameters", scenario, "--vary", "motion.speed=45:55:3", "--out", tmp_path / name)
        assert (result.status, result.err) == (0, "")
    exact, drawn = ((tmp_path / name / "report.html").read_text(encoding="utf-8") for name in ("exact", "drawn"))
    assert "there is no sampling noise" in exact
    assert "2000 sampled collisions" not in exact
    assert "there is no sampling noise" not in drawn
    assert "2000 sampled collisions" in drawn


@pytest.mark.usefixtures("unsaved_pictures")
def test_a_page_tells_what_it_calls_the_source_and_speaks_of_it_where_it_belongs(tmp_path: Path) -> None:
    """A page is handed on to people who have not read ours."""
    pages = {}
    for name, changes in (("hand", ()), ("arm", ("--set", "contact.body=lower_arm_wrist"))):
        options = (*QUICK["workspace"], *changes, "--out", tmp_path / name)
        assert run("study", "workspace", EXAMPLE, *options).status == 0
        pages[name] = (tmp_path / name / "report.html").read_text(encoding="utf-8")
    assert "135 N for a hand" in pages["hand"]
    assert "135 N for a hand" not in pages["arm"]
    varied = ("--vary", "detector.thresholds=8:12:3", "--out", tmp_path / "varied")
    assert run("study", "parameters", EXAMPLE, *varied).status == 0
    pages["varied"] = (tmp_path / "varied" / "report.html").read_text(encoding="utf-8")
    assert "detector.thresholds: lowest threshold; the others in proportion" in pages["varied"]
    asked = ("--body", "hand_finger", "--direction", "down", "--speed", 50, "--highest-speed", 20)
    assert run("study", "effectiveness", EXAMPLE, *asked, "--out", tmp_path / "bodies").status == 0
    pages["bodies"] = (tmp_path / "bodies" / "report.html").read_text(encoding="utf-8")
    for page in pages.values():
        main, footer = page.split("<footer>")
        assert ("Schroeder" in main) is ("Schroeder (2013): K. Schroeder" in footer)
    assert "Schroeder" in pages["hand"]
    assert "Schroeder" not in pages["bodies"]


def test_settings_repeat_the_study(tmp_path: Path) -> None:
    first = run("study", "workspace", EXAMPLE, "--json", "--out", tmp_path / "a", *QUICK["workspace"])
    again = run("study", "workspace", tmp_path / "a" / "settings.toml", "--json", "--poses", 20, "--speed-sd", 2)
    one, two = (strict_json(result.out) for result in (first, again))
    one.pop("seconds"), two.pop("seconds")
    assert one == two


def test_an_interrupted_study_is_taken_up_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from bumpstop.study.parameters.parameters import ParameterStudy

    command = ("study", "parameters", EXAMPLE, "--threads", 1, "--json")
    vary = [part for key in ("motion.speed=40:60:3", "contact.area_cm2=1:2:3") for part in ("--vary", key)]
    whole = run(*command, *vary, "--out", tmp_path / "whole")
    calls = []
    shard = ParameterStudy.shard

    def once(self: Study, number: int) -> pl.DataFrame:
        calls.append(number)
        if calls == [0, 1]:
            raise KeyboardInterrupt
        return shard(self, number)  # type: ignore[arg-type]

    monkeypatch.setattr(ParameterStudy, "shard", once)
    broken = run(*command, *vary, "--out", tmp_path / "half")
    assert (broken.status, broken.err) == (130, "error: interrupted\n")
    assert [path.name for path in (tmp_path / "half" / "shards").iterdir()] == ["000000.arrow"]
    resumed = run(*command, *vary, "--out", tmp_path / "half")
    assert calls == [0, 1, 1]
    one, two = strict_json(whole.out), strict_json(resumed.out)
    one.pop("seconds"), two.pop("seconds")
    assert one == two
    for name in ("rows.parquet", "summary.json", "report.html"):
        assert (tmp_path / "half" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes(), name


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("parameters", "--vary", "motion.speed=60:40"), "--vary: 60 to 40 is an empty range"),
        (("parameters", "--vary", "motion.sped=40:60"), "did you mean 'motion.speed'"),
        (("parameters", "--pair", "motion.speed"), "--pair: 'motion.speed' is not KEY,KEY"),
        (("parameters", "--cost", "motion.speed=0"), "--cost: '0' of motion.speed is no cost"),
        (("effectiveness", "--body", "tail"), "--body: 'tail' is a region of no table"),
        (("effectiveness", "--speed", "0"), "--speed: 0 cannot be used"),
        (("workspace",), "--poses: is missing; give it or --grid, for example --poses 1000"),
        (("workspace", "--poses", "5", "--grid", "2"), "--grid: has no meaning with --poses; give one of them"),
        (("workspace", "--poses", "-1"), "--poses: '-1' cannot be used"),
        (("workspace", "--poses", "5", "--directions", "even"), "--directions: 'even' is unknown"),
        (("workspace", "--poses", "5", "--joint-limits", "no"), "--joint-limits: 'no' is unknown"),
        (("workspace", "--poses", "5", "--velocity-limits", "no"), "--velocity-limits: 'no' is unknown"),
        (
            ("workspace", "--poses", "5", "--predict", "--set", "contact.kind=free", "--set", "contact.body_mass_kg=1"),
            "contact.kind",
        ),
    ],
)
def test_refusals(arguments: tuple[str, ...], words: str) -> None:
    name, *rest = arguments
    result = run("study", name, EXAMPLE, *rest)
    assert result.status == 2
    assert result.out == ""
    (line,) = result.err.splitlines()
    assert line.startswith("error: ")
    assert words in line


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    assert run("evaluate", EXAMPLE, "--out", tmp_path).status in (0, 3)
    before = {path.name for path in tmp_path.iterdir()}
    result = run("study", "workspace", EXAMPLE, "--poses", 5, "--out", tmp_path)
    assert result.status == 2
    assert "holds results made otherwise" in result.err
    assert {path.name for path in tmp_path.iterdir()} == before


def test_a_study_that_cannot_begin_leaves_its_folder_to_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(study: EffectivenessStudy) -> dict[str, Any]:
        raise bs.InputError("contact.body_mass_kg", "is missing")

    folder = tmp_path / "out"
    asked = ("study", "effectiveness", EXAMPLE, *QUICK["effectiveness"], "--out", folder)
    with monkeypatch.context() as patch:
        patch.setattr(EffectivenessStudy, "_schema", refuse)
        refused = run(*asked)
    assert refused.status == 2
    assert "contact.body_mass_kg: is missing" in refused.err
    assert not folder.exists()
    assert run(*asked).status == 0
    assert (folder / "rows.parquet").is_file()
    # What another run has begun is not its own to remove.
    assert run(*asked, "--set", "contact.limits=ts15066").status == 2
    assert (folder / "rows.parquet").is_file()


def test_a_workspace_of_one_pose_has_its_page(tmp_path: Path) -> None:
    """A map of the condition number has cells then, too, though there is one number only."""
    result = run("study", "workspace", EXAMPLE, "--poses", 1, "--out", tmp_path)
    assert (result.status, result.err) == (0, "")
    assert "1 distributions; 0 poses start at a singularity" in result.out
    assert (tmp_path / "report.html").is_file()


def test_body_parts_without_a_verdict_say_why(tmp_path: Path) -> None:
    free = ("--set", "contact.kind=free", "--set", "contact.limits=ts15066", "--body", "face")
    result = run("study", "effectiveness", EXAMPLE, *QUICK["effectiveness"], *free, "--out", tmp_path)
    assert "  ts15066 hand_finger down 1 cm²: 20 or more\n" in result.out
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Face (bgia2011): bgia2011 gives no mass of a body region" in page
    assert "Face (ts15066): ts15066 does not permit transient contact" in page
    assert "Hand/Finger (bgia2011): bgia2011 gives no mass of a body region" in page
    # Three parts on two areas: in the table of speeds, and in that of all collisions at one speed.
    assert page.count("no verdict<") == 12
    assert ">none<" not in page.split("All 8 collisions")[0]


def test_the_trajectory_itself_is_not_written_over(tmp_path: Path) -> None:
    given = (REPOSITORY / "examples" / "06_pick_and_place.csv").read_bytes()
    trajectory = tmp_path / "retimed.csv"
    trajectory.write_bytes(given)
    scenario = REPOSITORY / "examples" / "06_pick_and_place_trajectory.toml"
    result = run("study", "speed-limits", scenario, "--set", f'motion.file="{trajectory}"', "--out", tmp_path)
    refused = f"error: --out: {str(trajectory)!r} is read, and would be written over; give another folder\n"
    assert (result.status, result.err) == (2, refused)
    assert trajectory.read_bytes() == given


@pytest.mark.parametrize("place", ["studies.parameters.pages_of", "document.Document.write"])
def test_a_fault_that_no_system_call_has_is_told_in_its_own_words(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As matplotlib has it, where it finds no folder for its cache."""

    def refuse(*_: object) -> None:
        raise OSError("Matplotlib requires a writable cache directory")

    monkeypatch.setattr(f"bumpstop.report.{place}", refuse)
    result = run("study", "parameters", EXAMPLE, *QUICK["parameters"], "--out", tmp_path)
    assert result.status == 2
    assert "cannot be written (Matplotlib requires a writable cache directory); " in result.err


def test_a_disk_that_is_full_at_the_slower_trajectory_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, content: bytes) -> None:
        if path == tmp_path / "retimed.json":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        write_bytes(path, content)

    monkeypatch.setattr("bumpstop.study.speed.trajectory.trajectory_writing.write_bytes", full)
    scenario = REPOSITORY / "examples" / "06_pick_and_place_trajectory.toml"
    result = run("study", "speed-limits", scenario, "--out", tmp_path)
    assert result.status == 2
    room = "make room on its disk, or give a folder on another one"
    assert result.err == f"error: --out: '{tmp_path}' cannot be written (No space left on device); {room}\n"
