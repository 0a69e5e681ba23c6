"""Programs that are kept from one run of the tests to the next."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from cpp import builds
from cpp.builds import COMPILER, can, compiled


def test_a_program_is_compiled_anew_where_anything_has_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not can(COMPILER, tmp_path):
        pytest.skip("no C++ compiler")
    monkeypatch.setattr(builds, "ROOT", tmp_path)
    source, header, program = (tmp_path / name for name in ("five.cpp", "five.hpp", "five"))
    header.write_text("constexpr int five = 5;\n", encoding="utf-8")
    source.write_text('#include "five.hpp"\nint main() { return five; }\n', encoding="utf-8")

    def status(*options: str) -> int:
        done = compiled([*COMPILER, *options], source, program)
        assert done.returncode == 0, done.stderr
        return subprocess.run([program], check=False).returncode

    assert status() == 5
    (kept,) = (tmp_path / "build" / "tests").iterdir()
    os.utime(kept, (1, 1))
    assert status() == 5
    assert kept.stat().st_mtime == 1
    header.write_text("constexpr int five = 6;\n", encoding="utf-8")
    assert status() == 6
    source.write_text('#include "five.hpp"\nint main() { return five + 1; }\n', encoding="utf-8")
    assert status() == 7
    assert status("-O1") == 7
    assert not kept.exists()
    assert len(list(kept.parent.iterdir())) == 2
    source.write_text("int main() { return nothing; }\n", encoding="utf-8")
    assert "nothing" in compiled(COMPILER, source, program).stderr
