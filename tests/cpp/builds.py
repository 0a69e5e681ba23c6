"""How the tests compile C++ programs, and whether they can be compiled here.

``CXX`` names the compiler (default: c++).
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

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
    """What the compiler says of a program against the headers alone, warnings being errors."""
    folders = [f"-I{ROOT / 'include'}", f"-I{ROOT / 'tests'}"]
    whole = [*command, *WARNINGS, *folders, str(source), "-o", str(program)]
    return subprocess.run(whole, capture_output=True, text=True, check=False)
