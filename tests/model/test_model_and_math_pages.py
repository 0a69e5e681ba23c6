"""The Python sessions of the pages of the rooms, run; the C++ example of the page on models, compiled and run."""

from __future__ import annotations

import doctest
import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def blocks(page: str, language: str) -> list[str]:
    text = (ROOT / "docs" / "reference" / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize(
    "page",
    ["robot/model.md", "robot/dynamics.md", "robot/drive_train.md", "math.md", "robot/signal.md", "robot/joint.md"],
)
def test_sessions(page: str) -> None:
    session = doctest.DocTestParser().get_doctest("\n".join(blocks(page, "pycon")), {}, page, page, 0)
    assert session.examples
    assert doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(session).failed == 0


def test_cpp_example(tmp_path: Path) -> None:
    compiler = shlex.split(os.environ.get("CXX", "c++"))
    if not shutil.which(compiler[0]):
        pytest.skip(f"no compiler {compiler[0]} here")
    (example,) = blocks("robot/model.md", "cpp")
    include, rest = example.split("\n\n", 1)
    check = "    return std::fabs(tip.x - 0.8) + std::fabs(tip.y) + std::fabs(tip.z - 0.5) < 1e-12 ? 0 : 1;\n"
    source = tmp_path / "example.cpp"
    source.write_text(f"{include}\n\nint main() {{\n{rest}{check}}}\n", encoding="utf-8")
    program = tmp_path / "example"
    warnings = ["-std=c++20", "-Wall", "-Wextra", "-Werror", "-Wno-psabi"]
    subprocess.run([*compiler, *warnings, f"-I{ROOT / 'include'}", str(source), "-o", str(program)], check=True)
    subprocess.run([program], check=True)
