"""The collision kernels compiled with the sanitizers, warnings as errors."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from cpp.builds import COMPILER, SANITIZERS, can, compiled


def test_kernels_under_the_sanitizers(tmp_path: Path) -> None:
    # Half the work with clang, where it links its sanitizers; -O0 compiles at once, but runs for minutes.
    commands = [[*name, "-O1", "-g1", "-pthread", *SANITIZERS] for name in (["clang++-14"], COMPILER)]
    command = next((command for command in commands if can(command, tmp_path)), None)
    if command is None:
        pytest.skip(f"nothing here builds with {' '.join(commands[-1])}")
    program = tmp_path / "kernels"
    built = compiled(command, Path(__file__).with_name("kernels.cpp"), program)
    assert built.returncode == 0, built.stderr
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
