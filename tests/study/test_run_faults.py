"""What goes wrong while a study runs, or with what it has left."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

import bumpstop as bs
from bumpstop.study import run
from cli.support import EXAMPLE
from collision.cases import control_group
from study.run_cases import Squares


def test_threads_that_cannot_be_started_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def start(self: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", start)
    with pytest.raises(bs.InputError, match=r"^threads: no more can be started"):
        run(Squares(control_group()), tmp_path / "out", threads=256)
    assert not (tmp_path / "out").exists()


def test_a_flipped_bit_in_finished_rows_is_refused(tmp_path: Path) -> None:
    """Wherever it is: in a number it would else be read as another number."""
    study = Squares(control_group())
    run(study, tmp_path)
    file = tmp_path / "rows.parquet"
    content = file.read_bytes()
    for share in (0.1, 0.3, 0.5, 0.9):
        flipped = bytearray(content)
        flipped[int(share * len(content))] ^= 1
        file.write_bytes(flipped)
        with pytest.raises(bs.InputError, match=r"rows\.parquet' is damaged"):
            run(study, tmp_path)
    file.write_bytes(content)
    run(study, tmp_path)


def test_a_folder_in_use_is_refused(tmp_path: Path) -> None:
    study = Squares(control_group())
    refused: list[str] = []

    def progress(done: int, total: int) -> None:
        if done == 3:
            with pytest.raises(bs.InputError, match="is in use") as error:
                run(study, tmp_path)
            refused.append(error.value.field)

    run(study, tmp_path, progress=progress)
    assert refused == ["--out"]


def test_rows_of_a_file_that_has_changed_meanwhile_are_not_kept(tmp_path: Path) -> None:
    table = tmp_path / "stops.toml"
    text = (EXAMPLE.parent / "stopping" / "tm5_700.toml").read_text(encoding="utf-8")
    table.write_text(text, encoding="utf-8")
    reaction = {"kind": "stop", "joint_acceleration_rad_s2": 4.5, "deceleration": "table", "payload_percent": 33}
    scenario = bs.load_scenario(EXAMPLE, {"reaction": {**reaction, "stopping_table": str(table)}})

    def change(done: int, shards: int) -> None:
        table.write_text(text if done == 0 else text.replace("364", "728"), encoding="utf-8")

    with pytest.raises(bs.InputError, match="has changed since the work began"):
        run(Squares(scenario), tmp_path / "out", progress=change)
    change(0, 0)
    rows, _ = run(Squares(scenario), tmp_path / "out")
    assert rows.equals(run(Squares(scenario)).rows)
