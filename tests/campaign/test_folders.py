"""Folders of jobs, as commands meet them that did not make them."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from bumpstop.campaign import Campaign
from bumpstop.shards import ResultFolder, Workers
from bumpstop.shards.run import compute_missing
from campaign.cases import computed, result
from cli.support import EXAMPLE, REPOSITORY, run

PROGRAMS = REPOSITORY / "examples" / "programs"
REGISTER = REPOSITORY / "examples" / "register" / "sia5d_downward.csv"
OTHERS = {
    "evaluate": ("evaluate", EXAMPLE),
    "program": ("program", PROGRAMS / "planned.yaml", "--scenario", PROGRAMS / "cell.toml"),
    "experiment": ("experiment", "glass", "--runs", "1"),
    "register": ("evaluate", REGISTER),
    "report": ("report", REGISTER, "--cell", "Press 4", "--author", "A. Smith", "--revision", "B"),
    "measure plan": ("measure", "plan", EXAMPLE, "--points", "32", "--speeds", "100", "--shots", "1"),
}


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("command", OTHERS)
@pytest.mark.parametrize("kind", ["begun", "joined", "without settings"])
def test_another_command_does_not_write_into_the_folder_of_a_job(
    kind: str, command: str, campaign: Campaign, whole: Path, tmp_path: Path
) -> None:
    """Its settings or its summary would take the place of the job's, which then nobody could resume."""
    out = tmp_path / "out"
    if kind == "begun":
        store = ResultFolder(out, campaign)
        store.open(campaign)
        compute_missing(campaign, store, Workers(), share=(1, 2))
    else:
        shutil.copytree(whole, out)
    if kind == "without settings":
        (out / "settings.toml").unlink()
    before = contents(out)
    refused = run(*OTHERS[command], "--out", out)
    assert refused.status == 2
    (line,) = refused.err.splitlines()
    what = "manifest.json of a study or campaign" if kind == "without settings" else "a campaign (settings.toml)"
    assert line == f"error: --out: '{out}' holds {what}; give another folder"
    assert contents(out) == before


def test_names_alone_make_no_job(tmp_path: Path) -> None:
    for name in ("shards", "rows"):
        (tmp_path / name).mkdir()
    (tmp_path / "manifest.json").write_text('{"name": "a page"}', encoding="utf-8")
    assert run("evaluate", EXAMPLE, "--out", tmp_path).status in (0, 3)


@pytest.mark.parametrize("command", ["resume", "status", "merge", "report"])
def test_the_folder_of_something_else_is_named(command: str, tmp_path: Path) -> None:
    study, other = tmp_path / "study", tmp_path / "other"
    assert run("study", "workspace", EXAMPLE, "--poses", 2, "--out", study).status == 0
    assert run("evaluate", EXAMPLE, "--out", other).status in (0, 3)
    refused = run("campaign", command, study)
    assert (refused.status, refused.out) == (2, "")
    assert (
        refused.err == f"error: {study}: is the folder of a study (workspace), not of a campaign; campaign run FILE\n"
    )
    refused = run("campaign", command, other)
    assert (refused.status, refused.out) == (2, "")
    assert refused.err == f"error: {other}: is the folder of something else, not of a campaign; campaign run FILE\n"


@pytest.mark.parametrize("command", ["campaign", "speed-limits", "evaluate"])
def test_files_whose_names_are_no_text_are_refused_before_any_work(command: str, tmp_path: Path) -> None:
    """Settings are UTF-8, and could not name them."""
    home, out = tmp_path / os.fsdecode(b"q\xff"), tmp_path / "out"
    home.mkdir()
    scenario = EXAMPLE.read_text(encoding="utf-8")
    table = REPOSITORY / "src" / "bumpstop" / "contact" / "data" / "bgia2011.toml"
    (home / "mine.toml").write_bytes(table.read_bytes().replace(b'name = "bgia2011"', b'name = "mine"'))
    (home / "hand.toml").write_text(scenario.replace('"bgia2011"', '"mine.toml"'))
    (home / "c.toml").write_text(
        'poses = 2\ndirections = ["down"]\nspeeds_mm_s = [50]\n[[robots]]\nscenario = "hand.toml"\n'
    )
    arguments = {
        "campaign": ("campaign", "run", home / "c.toml"),
        "speed-limits": ("study", "speed-limits", home / "hand.toml"),
        "evaluate": ("evaluate", home / "hand.toml"),
    }
    refused = run(*arguments[command], "--out", out)
    assert refused.status == 2
    assert refused.err.startswith("error: scenario: '")
    assert refused.err.endswith("is no text; wanted names of files in UTF-8\n")
    assert command == "evaluate" or not out.exists()


def test_a_campaign_is_kept_where_the_name_is_no_text(campaign: Campaign, whole: Path, tmp_path: Path) -> None:
    out = tmp_path / os.fsdecode(b"b\xff")
    assert result(computed(campaign, out)) == result(whole)
