"""What is wrong with a folder of a campaign is named, and only that is computed again."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from bumpstop.campaign import Campaign
from bumpstop.shards import ResultFolder, Workers
from bumpstop.shards.run import complete, compute_missing
from campaign.cases import result
from cli.support import run


def test_edited_settings_are_damage_of_any_build(campaign: Campaign, whole: Path, tmp_path: Path) -> None:
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    settings = tmp_path / "settings.toml"
    written = settings.read_text(encoding="utf-8")
    changes = {"seed = 7": "seed = 8", "\n[made_by]": "\n# mine\n[made_by]", 'checksum = "': 'checksum = "0'}
    for old, new in changes.items():
        assert written.count(old) == 1
        settings.write_text(written.replace(old, new), encoding="utf-8")
        found = run("campaign", "status", tmp_path, "--check", "--json")
        assert (found.status, found.err) == (3, "")
        assert json.loads(found.out)["damaged"] == [f"'{tmp_path}/settings.toml' is not as it was written"]
    settings.write_text(written.replace("seed = 7", "seed = 8"), encoding="utf-8")
    assert run("campaign", "resume", tmp_path).status == 2
    # With a damaged manifest, too, both are told; without --check the manifest alone.
    (tmp_path / "manifest.json").write_text("{}")
    found = run("campaign", "status", tmp_path, "--check", "--json")
    assert (found.status, len(json.loads(found.out)["damaged"])) == (3, 2)
    found = run("campaign", "status", tmp_path, "--json")
    assert (found.status, len(json.loads(found.out)["damaged"])) == (3, 1)


@pytest.mark.parametrize("name", ["rows/00000.parquet", "manifest.json", "summary.json", "shards/000002.arrow"])
def test_a_flipped_bit_is_named_and_only_that_computed_again(
    name: str, campaign: Campaign, whole: Path, tmp_path: Path
) -> None:
    store = ResultFolder(tmp_path, campaign)
    store.open(campaign)
    compute_missing(campaign, store, Workers())
    if not name.startswith("shards"):
        store.finish(campaign.summarise)
    file = tmp_path / name
    content = bytearray(file.read_bytes())
    content[5 if name == "manifest.json" else len(content) // 2] ^= 1
    file.write_bytes(content)
    status = run("campaign", "status", tmp_path, "--check")
    assert (status.status, status.err) == (3, "")
    assert f"{name}' is damaged" in status.out
    _, account = complete(campaign, ResultFolder(tmp_path, campaign), Workers())
    assert [name in problem for problem in account.damaged] == [True]
    redone = {"shards/000002.arrow": 1, "summary.json": 0}
    assert account.shards == redone.get(name, campaign.shards)
    assert result(tmp_path) == result(whole)


@pytest.mark.parametrize("command", ["status", "report", "merge", "resume"])
def test_a_manifest_that_cannot_be_read_is_named(command: str, whole: Path, tmp_path: Path) -> None:
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    manifest = tmp_path / "manifest.json"
    manifest.unlink()
    manifest.mkdir()
    refused = run("campaign", command, tmp_path)
    assert (refused.status, refused.out) == (2, "")
    assert refused.err.startswith(f"error: FOLDER: '{tmp_path}' cannot be used ({manifest}: Is a directory); ")


@pytest.mark.parametrize("command", ["resume", "merge"])
def test_a_folder_that_another_build_has_computed_is_no_option(command: str, whole: Path, tmp_path: Path) -> None:
    """These commands have no --out: what is wrong is the folder that they were given."""
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    settings = tmp_path / "settings.toml"
    settings.write_text(re.sub(r'fingerprint = "\w{4}', 'fingerprint = "0000', settings.read_text(encoding="utf-8")))
    refused = run("campaign", command, tmp_path)
    assert refused.status == 2
    assert refused.err.startswith(f"error: FOLDER: '{tmp_path}' holds results made otherwise")


def test_a_manifest_that_was_cut_short_or_is_gone_is_damage(campaign: Campaign, whole: Path, tmp_path: Path) -> None:
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    manifest = tmp_path / "manifest.json"
    manifest.write_bytes(manifest.read_bytes()[:20])
    status = run("campaign", "status", tmp_path, "--check", "--json")
    found = json.loads(status.out)
    assert (status.status, status.err, found["done"], found["joined"]) == (3, "", 0, False)
    assert ["manifest.json' is damaged" in problem for problem in found["damaged"]] == [True]
    assert run("campaign", "status", tmp_path).status == 3
    manifest.unlink()
    status = run("campaign", "status", tmp_path, "--check")
    assert (status.status, status.err) == (3, "")
    assert f"damaged: '{manifest}' is not there, although there is a result" in status.out
    assert "every file is what was written" not in status.out
    # A run that has been interrupted before its rows were joined has none, and is well.
    (tmp_path / "summary.json").unlink()
    shutil.rmtree(tmp_path / "rows")
    assert run("campaign", "status", tmp_path, "--check").status == 0
