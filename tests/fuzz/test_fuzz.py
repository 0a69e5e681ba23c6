"""The fuzzer: its corpus is read, its mutations repeat, and it finds what is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from fuzz.mutations import mutated
from fuzz.reading import _read, case, corpus
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
