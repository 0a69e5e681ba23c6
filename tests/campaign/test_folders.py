"""Folders of jobs, as commands meet them that did not make them."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bumpstop.campaign import Campaign
from bumpstop.shards import ResultFolder, Workers
from bumpstop.shards.run import compute_missing
from cli.support import EXAMPLE, REPOSITORY, run

PROGRAMS = REPOSITORY / "examples" / "programs"
OTHERS = {
    "evaluate": ("evaluate", EXAMPLE),
    "program": ("program", PROGRAMS / "planned.yaml", "--scenario", PROGRAMS / "cell.toml"),
    "experiment": ("experiment", "glass", "--runs", "1"),
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
