"""A folder of shards while others work in it."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import polars as pl
import pytest

import bumpstop as bs
from bumpstop.shards import ResultFolder, Workers
from bumpstop.shards.run import complete, compute_missing
from bumpstop.shards.storage import LocalStorage
from bumpstop.shards.workers import compute_group
from collision.cases import control_group
from study.run_cases import Squares


def test_a_listing_is_whole_although_files_vanish_during_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files that are being written have a name with a dot until they are whole; others may be deleted."""
    (tmp_path / "shards").mkdir()
    for name in ("000000.arrow", "000001.arrow", "000002.arrow", ".000003.arrow.5ea1", ".share-1-of-2"):
        (tmp_path / "shards" / name).write_bytes(b"1234")
    scandir = os.scandir

    @contextmanager
    def slow(path: Any) -> Iterator[list[os.DirEntry[str]]]:
        with scandir(path) as entries:
            found = list(entries)
        for gone in ("000001.arrow", ".000003.arrow.5ea1"):
            (tmp_path / "shards" / gone).unlink()
        yield found

    monkeypatch.setattr(os, "scandir", slow)
    assert LocalStorage(tmp_path).sizes("shards") == {"000000.arrow": 4, "000002.arrow": 4}
    monkeypatch.undo()
    assert LocalStorage(tmp_path).sizes("rows") == {}
    assert LocalStorage(tmp_path).sizes("shards/000000.arrow") == {}


@dataclass(frozen=True)
class Refused(Squares):
    """A study none of whose shards can be computed."""

    def shard(self, number: int) -> pl.DataFrame:
        raise bs.InputError("seed", f"shard {number} cannot be computed", "wanted another")


@pytest.mark.parametrize(("share", "left"), [((1, 2), True), ((1, 1), False)])
def test_a_share_that_fails_leaves_the_folder_to_the_others(share: tuple[int, int], left: bool, tmp_path: Path) -> None:
    """They may compute in it already, with no shard there yet; a command that is alone cleans up."""
    job = Refused(control_group())
    store = ResultFolder(tmp_path / "out", job)
    store.open(job)
    with store.storage.lock("1-of-2" if left else None), pytest.raises(bs.InputError, match="shard 0 cannot be"):
        compute_missing(job, store, Workers(), share=share)
    assert (tmp_path / "out" / "settings.toml").exists() == left


def test_a_place_that_processes_do_not_see_is_named() -> None:
    """Each process has a memory of its own: the shards would be computed for ever, and never be there."""
    job = Squares(control_group())
    store = ResultFolder("memory://bumpstop/unseen", job)
    store.open(job)
    with pytest.raises(bs.InputError, match=r"^--out: 'memory://bumpstop/unseen' holds no settings\.toml of this run"):
        complete(job, store, Workers(processes=1))
    assert store.storage.sizes("") == {}


@pytest.mark.parametrize("workers", [Workers(), Workers(threads=3), Workers(processes=2)])
@pytest.mark.parametrize("lost", ["removed", "moved", "settings"])
def test_a_folder_that_is_lost_meanwhile_is_not_made_anew(lost: str, workers: Workers, tmp_path: Path) -> None:
    """What is computed after that would be kept where nobody looks for it."""
    out = tmp_path / "out"
    job = Squares(control_group(), count=40)
    store = ResultFolder(out, job)
    store.open(job)
    seen = []

    def lose(done: int, total: int) -> None:
        seen.append(done)
        if len(seen) == 2:
            if lost == "settings":
                (out / "settings.toml").unlink()
                return
            out.rename(tmp_path / "elsewhere")
            if lost == "removed":
                shutil.rmtree(tmp_path / "elsewhere")

    with (
        store.storage.lock(None),
        pytest.raises(bs.InputError, match=r"^--out: '.*out' (holds no settings|cannot be used)"),
    ):
        complete(job, store, workers, progress=lose)
    assert seen[-1] < 40
    assert out.exists() == (lost == "settings")
    assert not (out / "settings.toml").exists()
    if lost == "moved":
        moved = ResultFolder(tmp_path / "elsewhere", job)
        moved.open(job)
        complete(job, moved, workers)


def test_a_result_is_not_joined_where_its_settings_are_gone(tmp_path: Path) -> None:
    job = Squares(control_group())
    store = ResultFolder(tmp_path, job)
    store.open(job)
    compute_missing(job, store, Workers())
    (tmp_path / "settings.toml").unlink()
    with pytest.raises(bs.InputError, match=r"holds no settings\.toml of this run"):
        store.finish(job.summarise)
    assert not (tmp_path / "rows.parquet").exists()


def test_a_worker_makes_no_folder(tmp_path: Path) -> None:
    """Others would see its settings, and put their shards there."""
    job = Squares(control_group())
    store = ResultFolder(tmp_path / "out", job)
    with pytest.raises(bs.InputError, match="holds no settings"):
        compute_group(job, store, [0])
    with pytest.raises(bs.InputError, match="cannot be used"):
        store.put(0, job.shard(0))
    with pytest.raises(FileNotFoundError):
        store.storage.write("settings.toml", b"")
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_never_gives_back_what_was_written_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = Squares(control_group())
    store = ResultFolder(tmp_path, job)
    store.open(job)
    read = LocalStorage.read

    def forgetful(self: LocalStorage, name: str) -> bytes:
        content = read(self, name)
        return content[:-1] if name.endswith("000003.arrow") else content

    monkeypatch.setattr(LocalStorage, "read", forgetful)
    with pytest.raises(bs.InputError, match=r"000003\.arrow' is damaged, .* although it was written anew;"):
        complete(job, store, Workers())


@pytest.mark.parametrize("share", [None, "1-of-2"])
def test_a_place_that_cannot_be_locked_is_told_as_the_user_s(
    share: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Any, flags: int, mode: int = 0o777) -> int:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))

    with monkeypatch.context() as patch:
        patch.setattr(os, "open", full)
        with pytest.raises(bs.InputError, match=r"^--out: .* cannot be used \(.*: Read-only file system\); give"):
            LocalStorage(tmp_path).lock(share).__enter__()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "shards").write_bytes(b"")
    with pytest.raises(bs.InputError, match=r"^--out: .* cannot be used \(.*shards: File exists\)"):
        LocalStorage(tmp_path / "out").lock(share).__enter__()


def test_a_folder_that_a_file_replaces_is_named(tmp_path: Path) -> None:
    job, out = Squares(control_group()), tmp_path / "out"
    store = ResultFolder(out, job)
    store.open(job)

    def replace(done: int, total: int) -> None:
        if done == 0:
            shutil.rmtree(out)
            out.write_bytes(b"")

    with pytest.raises(bs.InputError, match=r"^--out: .* cannot be used \(.*: Not a directory\)"):
        compute_missing(job, store, Workers(), progress=replace)
    assert out.read_bytes() == b""
