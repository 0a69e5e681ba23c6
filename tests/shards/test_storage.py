"""A folder of shards while others work in it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from bumpstop.shards.storage import LocalStorage


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
