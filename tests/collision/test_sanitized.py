"""The collision kernels compiled with the sanitizers, warnings as errors."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from cpp.builds import COMPILER, SANITIZERS, can, compiled


def test_kernels_under_the_sanitizers(tmp_path: Path) -> None:
    command = [*COMPILER, "-O1", "-g", "-pthread", *SANITIZERS]
    if not can(command, tmp_path):
        pytest.skip(f"nothing here builds with {' '.join(command)}")
    program = tmp_path / "kernels"
    built = compiled(command, Path(__file__).with_name("kernels.cpp"), program)
    assert built.returncode == 0, built.stderr
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
