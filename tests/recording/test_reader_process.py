"""Readers that die of a file: the file is named, and the next one is read."""

from __future__ import annotations

import os
import random
import signal
import struct
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import scipy.io

import bumpstop as bs
from bumpstop.detection.tuning.residual_record import read_residuals, write_residuals
from bumpstop.recording.formats import reader_process
from bumpstop.recording.formats.parquet_excel import read_parquet
from recording.cases import recording


def test_a_reader_that_is_killed_is_named_and_started_again(tmp_path: Path) -> None:
    file = tmp_path / "r.parquet"
    recording().save(file)
    first = bs.Recording.load(file)
    process = reader_process._READER.process
    assert process is not None
    os.kill(process.pid, signal.SIGSTOP)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    again = bs.Recording.load(file)
    assert np.array_equal(first.q, again.q)
    assert reader_process._READER.process is not process


def test_the_end_does_not_wait_for_a_reader_without_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It took 0.2 s of every command that read a recording, and Ctrl-C in it left a traceback."""
    file = tmp_path / "r.parquet"
    recording().save(file)
    bs.Recording.load(file)
    process = reader_process._READER.process
    assert process is not None
    calls = []
    kill, wait = process.kill, process.wait
    monkeypatch.setattr(process, "kill", lambda: (calls.append("kill"), kill())[1])
    monkeypatch.setattr(process, "wait", lambda timeout=None: (calls.append("wait"), wait(timeout))[1])
    reader_process._close()
    assert calls[0] == "kill"
    assert process.returncode == -signal.SIGKILL


@pytest.mark.parametrize(("said", "threads"), [(None, "2"), ("1", "1")])
def test_the_environment_says_how_many_threads_it_has(
    said: str | None, threads: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("POLARS_MAX_THREADS", raising=False)
    if said is not None:
        monkeypatch.setenv("POLARS_MAX_THREADS", said)
    reader_process._close()
    file = tmp_path / "r.parquet"
    recording().save(file)
    bs.Recording.load(file)
    process = reader_process._READER.process
    assert process is not None
    assert f"POLARS_MAX_THREADS={threads}" in Path(f"/proc/{process.pid}/environ").read_text("utf-8").split("\0")


def test_a_file_that_needs_more_memory_than_it_may_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Zeros: a hundred thousand times smaller in the file than in memory."""
    monkeypatch.setattr(reader_process, "MIN_MEMORY", 40_000_000)
    file = tmp_path / "bomb.parquet"
    zeros = np.zeros(8_000_000)
    pl.DataFrame({"t": zeros, "q_1": zeros, "q_2": zeros}).write_parquet(file)
    assert file.stat().st_size < 500_000
    with pytest.raises(bs.InputError, match=r"bomb\.parquet: cannot be read as Parquet"):
        bs.Recording.load(file)
    recording().save(tmp_path / "good.parquet")
    monkeypatch.undo()
    assert bs.Recording.load(tmp_path / "good.parquet").dof == 2


def test_a_small_matlab_file_that_says_it_holds_millions_is_named(tmp_path: Path) -> None:
    """Cells of a number that only its size in the file says: they took half a gigabyte, and more than a second."""
    file, cells = tmp_path / "cells.mat", np.empty((1, 3), dtype=object)
    cells[:] = [[np.arange(3.0)] * 3]
    scipy.io.savemat(file, {"t": np.arange(50) * 0.01, "c": cells})
    content, shape = file.read_bytes(), struct.pack("<IIii", 5, 8, 1, 3)
    file.write_bytes(content.replace(shape, struct.pack("<IIii", 5, 8, 1, 67_000_000), 1))
    with pytest.raises(bs.InputError, match=r"cells\.mat: cannot be read as a MATLAB file within 0\.26 GB of memory"):
        bs.Recording.load(file)


def test_a_reader_that_takes_too_long_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "r.parquet"
    recording().save(file)
    bs.Recording.load(file)
    process = reader_process._READER.process
    assert process is not None
    monkeypatch.setattr(reader_process, "MIN_SECONDS", 0.3)
    os.kill(process.pid, signal.SIGSTOP)
    with pytest.raises(bs.InputError, match="it took longer than 0 s"):
        bs.Recording.load(file)
    assert process.poll() is not None


def test_rows_that_a_file_only_says_it_has_are_named(tmp_path: Path) -> None:
    """One flipped bit in the number of rows: the columns are read without a word, and are shorter or empty."""
    file = tmp_path / "r.parquet"
    recording(rows=50).save(file)
    table = read_parquet(file)
    recording(rows=20).save(file)
    with pytest.raises(bs.InputError, match=r"cannot be read as Parquet \(it says that it has 50 rows, and has 20\)"):
        table.fetch([0])


@pytest.mark.parametrize("kind", ["parquet", "mat", "residuals"])
def test_damaged_files_are_refused_in_one_sentence(kind: str, tmp_path: Path) -> None:
    file = tmp_path / ("r.mat" if kind == "mat" else "r.parquet")
    if kind == "mat":
        scipy.io.savemat(file, {"t": np.arange(50.0), "q": np.ones((50, 2))})
    elif kind == "parquet":
        recording(rows=50).save(file)
    else:
        write_residuals(file, 0.004 * np.arange(50), np.ones((50, 2)))
    columns = {"time": {"variable": "t"}, "position": {"variable": "q"}} if kind == "mat" else None
    content, rng = file.read_bytes(), random.Random(3)
    refused: list[str] = []
    for _ in range(40):
        damaged = bytearray(content)
        for _ in range(rng.randint(1, 6)):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        file.write_bytes(damaged[: rng.choice((len(damaged), rng.randrange(len(damaged))))])
        try:
            read_residuals(file) if kind == "residuals" else bs.Recording.load(file, columns=columns)
        except bs.InputError as error:
            refused.append(str(error))
    assert len(refused) > 20
    for said in refused:
        assert str(file) in said or "columns." in said or "column " in said
        assert len(said) < 1500
