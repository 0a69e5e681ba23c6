"""How the tests compile C++ programs, and whether they can be compiled here.

``CXX`` names the compiler (default: c++).
"""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import pytest

from bumpstop.output_files import replacing

ROOT = Path(__file__).parents[2]
COMPILER = shlex.split(os.environ.get("CXX", "c++"))
WARNINGS = ["-std=c++20", "-Wall", "-Wextra", "-Werror", "-Wno-psabi"]
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


def can(command: Sequence[str], folder: Path) -> bool:
    """Whether a program can be built so here: a clang without its runtime library compiles, but links no sanitizer."""
    whole = [*command, "-x", "c++", "-", "-o", str(folder / "nothing")]
    return (
        shutil.which(command[0]) is not None
        and not subprocess.run(whole, input=b"int main() {}", capture_output=True, check=False).returncode
    )


def compiled(command: Sequence[str], source: Path, program: Path) -> subprocess.CompletedProcess[str]:
    """What the compiler says of a program against the headers alone, warnings being errors.

    Programs that were compiled are kept under ``build/``, and made anew where the compiler, its options, the source or
    a header has changed: most runs of the tests follow a change of Python.
    """
    folders = [f"-I{ROOT / 'include'}", f"-I{ROOT / 'tests'}"]
    whole = [*command, *WARNINGS, *folders, str(source), "-o", str(program)]
    known = source.relative_to(ROOT) if source.is_relative_to(ROOT) else Path(source.name)
    options = hashlib.sha256("\n".join([*command, *WARNINGS, *folders, str(known)]).encode()).hexdigest()[:16]
    kept = ROOT / "build" / "tests" / f"{source.stem}-{options}-{_state(command[0], source)}"
    if kept.exists():
        shutil.copy(kept, program)
        return subprocess.CompletedProcess(whole, 0, "", "")
    done = subprocess.run(whole, capture_output=True, text=True, check=False)
    if done.returncode == 0:
        kept.parent.mkdir(parents=True, exist_ok=True)
        for older in kept.parent.glob(f"{source.stem}-{options}-*"):
            older.unlink()
        with replacing(kept) as waiting:
            shutil.copy(program, waiting)
    return done


def program_beside(test: str, name: str, folder: Path) -> Path:
    """A C++ program that stands beside a test, compiled into a folder; without a compiler the test is skipped."""
    if not can(COMPILER, folder):
        pytest.skip("no compiler")
    program = folder / name
    built = compiled([*COMPILER, "-O1"], Path(test).with_name(f"{name}.cpp"), program)
    assert built.returncode == 0, built.stderr
    return program


def _state(compiler: str, source: Path) -> str:
    """A digest of the compiler's version, a source, and every header that it may include."""
    found = hashlib.sha256(_version(compiler) + source.read_bytes())
    for folder, pattern in ((ROOT / "include", "**/*.hpp"), (ROOT / "tests", "**/*.hpp"), (source.parent, "*.hpp")):
        for header in sorted(folder.glob(pattern)):
            found.update(str(header).encode() + header.read_bytes())
    return found.hexdigest()[:16]


@cache
def _version(compiler: str) -> bytes:
    return subprocess.run([compiler, "--version"], capture_output=True, check=True).stdout
