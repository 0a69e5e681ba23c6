"""Pages of the site that begin, teach and answer: their commands and notebooks, run from top to bottom."""

from __future__ import annotations

import contextlib
import doctest
import io
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest

from cli.support import run
from docs.pages import AS_DOCTEST, ROOT, WIDTH, blocks, code
from docs.test_commands import COMMANDS, Shell

DOCS = ROOT / "docs"
CONSOLES = (
    "start/first_verdict.md",
    "how_to/recipes.md",
    *(f"tutorials/{path.name}" for path in sorted((DOCS / "tutorials").glob("*.md")) if path.name != "index.md"),
)


@pytest.mark.usefixtures("unsaved_pictures")
@pytest.mark.parametrize("page", CONSOLES)
def test_commands_of_a_page_print_what_it_says(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", WIDTH)
    shell = Shell(tmp_path, capsys)
    consoles = blocks(DOCS / page, "console")
    assert consoles
    for text in consoles:
        parts = re.split(r"^\$ (.*)\n", text, flags=re.MULTILINE)
        for command, wanted in zip(parts[1::2], parts[2::2], strict=True):
            if command.startswith("python "):
                words = [sys.executable, *shlex.split(command)[1:]]
                done = subprocess.run(words, capture_output=True, text=True, check=False)
                printed, shell.status = done.stdout + done.stderr, done.returncode
            else:
                printed = shell.run(command)
            assert shell.status in (0, 3, 4), printed
            assert doctest.OutputChecker().check_output(wanted, printed, AS_DOCTEST), f"$ {command}\n{printed}"


def named_commands(page: str) -> list[str]:
    """Commands of ours inside the lines of a page."""
    text = (DOCS / page).read_text(encoding="utf-8").replace("\n", " ")
    return [command for command in code(text) if command.startswith("bumpstop ")]


@pytest.mark.parametrize("command", [*named_commands("cheat_sheet.md"), *named_commands("faq.md")])
def test_a_short_command_exists_with_its_arguments_and_options(command: str) -> None:
    words = shlex.split(command.replace("...", ""))[1:]
    (name,) = [name for k in (1, 2) if (name := " ".join(words[:k])) in COMMANDS][-1:]
    arguments = words[len(name.split()) :]
    if arguments:  # a command named alone needs none
        COMMANDS[name].make_context(name, arguments)


def test_the_workspace_study_of_the_cheat_sheet_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("new", "ur10e", "--out", "cell.toml").status == 0
    (command,) = (each for each in named_commands("cheat_sheet.md") if each.startswith("bumpstop study workspace"))
    assert run(*shlex.split(command)[1:]).status == 0


def test_python_of_the_cheat_sheet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    (text,) = blocks(DOCS / "cheat_sheet.md", "python")
    names: dict[str, Any] = {}
    exec(compile(text, "cheat_sheet.md", "exec"), names)
    assert names["result"].verdict.acceptable


def test_session_of_the_recipes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    text = "\n".join(blocks(DOCS / "how_to" / "recipes.md", "pycon"))
    test = doctest.DocTestParser().get_doctest(text, {}, "recipes", "recipes", 0)
    assert doctest.DocTestRunner(optionflags=AS_DOCTEST).run(test).failed == 0


@pytest.mark.parametrize("page", sorted(path.name for path in (DOCS / "notebooks").glob("*.md")))
def test_notebook(page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its cells in one namespace; what stands last in a cell shows itself, as in a notebook."""
    monkeypatch.chdir(ROOT)
    cells = blocks(DOCS / "notebooks" / page, r"\{code-cell\}")
    assert len(cells) > 1
    names: dict[str, object] = {}
    shown = 0
    with mpl.rc_context({"backend": "agg"}), contextlib.redirect_stdout(io.StringIO()):
        for cell in cells:
            exec(compile(cell, page, "exec"), names)
            last = names.get(cell.strip().splitlines()[-1])
            if hasattr(last, "_repr_html_"):
                shown += last._repr_html_().count("<svg")
    assert shown == len([cell for cell in cells if re.fullmatch(r"result|run|study", cell.strip().splitlines()[-1])])
    import matplotlib.pyplot as plt

    plt.close("all")
