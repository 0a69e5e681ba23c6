"""The timing of a newcomer's path: its steps, and what it says where no verdict comes or it takes too long."""

from __future__ import annotations

import re
import subprocess
import time
from pathlib import Path

import pytest
from tools.newcomer import STEPS, main, walk

from docs.pages import read

LINES = ("venv made", "Compiling the kernels (one)", "[1/2] one", "Installing bumpstop", "bumpstop evaluate x.toml")


def repository(folder: Path, verdict: str, pause: str = "true") -> Path:
    """A repository whose ``make run`` prints the lines of ours."""
    folder.mkdir()
    recipe = "".join(f"\t@echo '{line}'\n" for line in (*LINES, verdict))
    (folder / "Makefile").write_text(f"run:\n\t@{pause}\n{recipe}", encoding="utf-8")
    identity = ["-c", "user.name=a", "-c", "user.email=a@b.c"]
    for words in (["init", "--quiet"], ["add", "."], [*identity, "commit", "--quiet", "-m", "x"]):
        subprocess.run(["git", *words], cwd=folder, check=True)
    return folder


def test_steps_begin_where_make_says_so(tmp_path: Path) -> None:
    source = repository(tmp_path / "source", " ACCEPTABLE  within the limits", pause="sleep 0.3")
    found = walk(source, tmp_path)
    assert list(found.seconds) == ["clone", "environment", "compiling", "installing", "evaluating"]
    assert 0.3 <= found.silence <= found.seconds["environment"] < found.total
    assert found.status == 0


def test_no_verdict_and_too_slow_are_failures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good = str(repository(tmp_path / "good", " NOT ACCEPTABLE  over the limit"))
    assert main(["--source", good]) == 0
    assert main(["--source", good, "--limit", "0.001"]) == 1
    assert "no verdict" not in capsys.readouterr().out
    assert main(["--source", str(repository(tmp_path / "bad", "nothing"))]) == 1
    assert "no verdict: make run ended with exit status 0" in capsys.readouterr().out


def test_the_makefile_prints_what_begins_a_step() -> None:
    printed = [line.lstrip("\t@").removeprefix('echo "') for line in read("Makefile").splitlines()]
    for name, pattern in STEPS:
        assert any(pattern.search(line) for line in printed), name


def test_progress_is_shown_as_it_comes() -> None:
    """The filter of the Makefile holds no line back until there are more of them."""
    (shown,) = re.findall(r"tee build/build\.log \| (.*)$", read("Makefile"), re.MULTILINE)
    compiler = "echo '  [1/2] one'; echo noise; sleep 1; echo '  [2/2] two'"
    with subprocess.Popen(["sh", "-c", f"({compiler}) | {shown}"], stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        heard = [(line.strip(), time.perf_counter()) for line in running.stdout]
    assert [line for line, _ in heard] == ["[1/2] one", "[2/2] two"]
    assert heard[1][1] - heard[0][1] > 0.5
