"""The fuzzer: its corpus is read, its mutations repeat, and it finds what is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fuzz.__main__ import fuzz
from fuzz.guarded import GuardedReader
from fuzz.mutations import mutated
from fuzz.reading import _read, case, corpus
from fuzz.tally import Tallies
from fuzz.targets import TARGETS, Target

import bumpstop as bs


@pytest.mark.parametrize("name", TARGETS)
def test_readers_take_what_mutations_begin_from(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a corpus that is rejected whole a fuzzer would only see the first check."""
    monkeypatch.chdir(tmp_path)
    files, names = corpus(TARGETS[name])
    for file, content in files.items():
        Path(file).write_bytes(content)
    for file in names:
        TARGETS[name].read(Path(file))
    cases = [case(files, names, name, 0, number) for number in range(20)]
    assert cases == [case(files, names, name, 0, number) for number in range(20)]
    assert len({content for _, content in cases}) > 15
    assert cases != [case(files, names, name, 1, number) for number in range(20)]


def test_whatever_is_no_refusal_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class PanicError(BaseException):
        """As Rust's, which is no Exception."""

    def raising(error: BaseException) -> Any:
        def read(path: Path) -> None:
            raise error

        return Target(read)

    def touch(path: Path) -> None:
        Path("pwned").touch()

    monkeypatch.chdir(tmp_path)
    kinds = {
        "rejected": raising(bs.InputError("key", "is wrong")),
        "found": raising(PanicError("no")),
        "read": Target(lambda path: None),
    }
    for kind, target in kinds.items():
        assert _read(target, Path("x"), bs.InputError)[0] == kind
    assert _read(raising(bs.InputError("", "")), Path("x"), bs.InputError)[0] == "rejected"
    assert _read(Target(touch), Path("x"), bs.InputError) == ("found", "code of the file was run")


def test_mutations_change_and_stay_bounded() -> None:
    import random

    rng = random.Random(4)
    content = b"a = 1.5\nb = [2, 3]\n" * 20
    changed = [mutated(content, [b"c = 7\n"], rng) for _ in range(300)]
    assert sum(each != content for each in changed) > 280
    assert max(map(len, changed)) <= 2_000_000


def test_a_run_goes_on_where_its_counts_end(tmp_path: Path) -> None:
    whole = fuzz("labels", 3, 80, 60.0, tmp_path, Tallies(None))
    kept = tmp_path / "counts.json"
    fuzz("labels", 3, 30, 60.0, tmp_path, Tallies.load(kept))
    in_two = fuzz("labels", 3, 80, 60.0, tmp_path, Tallies.load(kept))
    assert in_two == whole == Tallies.load(kept).of("labels", 3)
    assert whole.executions == 80 == whole.read + whole.rejected
    assert min(whole.read, whole.rejected) > 0
    assert Tallies.load(kept).of("labels", 4).executions == 0


def test_time_and_memory_of_the_guarded_reader_are_seen(tmp_path: Path) -> None:
    """A file of zeros, small as a file: its columns cost memory and time in the reader's process alone."""
    import polars as pl

    bs.Recording(t=np.arange(3.0), q=np.zeros((3, 1))).save(tmp_path / "small.parquet")
    zeros = np.zeros(3_000_000)
    pl.DataFrame({"t": zeros, "q_1": zeros, "q_2": zeros}).write_parquet(tmp_path / "zeros.parquet")
    bs.Recording.load(tmp_path / "small.parquet")
    guarded = GuardedReader()
    bs.Recording.load(tmp_path / "small.parquet")
    assert guarded.used()[1] < 20_000_000
    with pytest.raises(bs.InputError, match="time stands still"):
        bs.Recording.load(tmp_path / "zeros.parquet")
    seconds, memory = guarded.used()
    assert seconds > 0
    assert memory > 72_000_000
    assert guarded.used()[0] == 0


def test_text_that_cpp_reads_is_refused_by_its_line(tmp_path: Path) -> None:
    files, _ = corpus(TARGETS["cpp_text"])
    file = tmp_path / "currents.detector"
    file.write_bytes(files[file.name].replace(b"\nperiod 0.004\n", b"\nperiod none\n"))
    with pytest.raises(bs.InputError, match=r"line \d+: 'period' wants 1 numbers"):
        TARGETS["cpp_text"].read(file)
