"""The installed command in a process of its own: streams, signals, completion, and what it imports."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from bumpstop.cli.main import app
from cli.support import EXAMPLE, run

COMMAND = Path(sysconfig.get_path("scripts")) / "bumpstop"
STOPS = EXAMPLE.parent / "stopping" / "tm5_700.toml"
pytestmark = pytest.mark.skipif(not COMMAND.exists(), reason="bumpstop is not installed here")


def bumpstop(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [COMMAND, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=60,
        env=os.environ | environment,
        check=False,
    )


def test_statuses_and_streams() -> None:
    good = bumpstop("evaluate", EXAMPLE, "--json")
    assert (good.returncode, good.stderr) == (0, "")
    assert json.loads(good.stdout)["verdict"]["acceptable"] is True
    over = bumpstop("evaluate", EXAMPLE, "--json", "--set", "contact.area_cm2=0.5")
    assert (over.returncode, over.stderr) == (3, "")
    bad = bumpstop("evaluate", EXAMPLE, "--json", "--set", "contact.area_cm2=0")
    assert (bad.returncode, bad.stdout) == (2, "")
    assert bad.stderr == "error: contact.area_cm2: 0 cannot be used; wanted a number from 0.0001 to 10000\n"


@pytest.mark.parametrize("backend", ["module://matplotlib_inline.backend_inline", "bogus"])
def test_a_backend_of_somebody_elses(backend: str, tmp_path: Path) -> None:
    """Jupyter names one that is not installed here to every command that it runs; pages need none."""
    done = bumpstop("evaluate", EXAMPLE, "--out", tmp_path, MPLBACKEND=backend)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "report.html").is_file()


@pytest.mark.parametrize("columns", ["0", "00"])
def test_a_terminal_without_width(columns: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As some consoles of containers have it."""
    monkeypatch.delenv("COLUMNS", raising=False)
    for arguments in (["evaluate", EXAMPLE], ["robots"], ["stopping", STOPS], ["--help"]):
        assert bumpstop(*arguments, COLUMNS=columns).stdout == bumpstop(*arguments).stdout != ""


def test_errors_that_nobody_hears() -> None:
    """They go nowhere, and not among the results; the status is the same."""
    for arguments, status in (("nope.csv", 2), (EXAMPLE, 0)):
        told = bumpstop("evaluate", arguments, "--json")
        silent = subprocess.run(
            ["sh", "-c", '"$@" 2>&-', "sh", COMMAND, "evaluate", arguments, "--json"],
            stdout=subprocess.PIPE,
            text=True,
            timeout=60,
            check=False,
        )
        assert (silent.returncode, silent.stdout) == (status, told.stdout)


def test_python_runs_the_package_as_the_command() -> None:
    module = [sys.executable, "-m", "bumpstop"]
    said = subprocess.run([*module, "--version"], capture_output=True, text=True, timeout=60, check=False)
    assert (said.returncode, said.stdout, said.stderr) == (0, bumpstop("--version").stdout, "")
    bad = subprocess.run(
        [*module, "bodies", "--limits", "none"], capture_output=True, text=True, timeout=60, check=False
    )
    assert (bad.returncode, bad.stderr) == (2, bumpstop("bodies", "--limits", "none").stderr)


def test_version_and_help() -> None:
    assert bumpstop("--version").stdout == f"bumpstop {version('bumpstop')}\n"
    help_text, help_of_evaluate = bumpstop("--help").stdout, bumpstop("evaluate", "--help").stdout
    # Without a command there is help, too.
    assert bumpstop().stdout == help_text
    for command in ("evaluate", "robots", "bodies"):
        assert re.search(rf"^  {command} +[A-Z]\w+ ", help_text, re.MULTILINE), "every command says what it does"
    for option in ("--json", "--out", "--sampled", "--seed", "--threads", "--set"):
        assert option in help_of_evaluate


def commands(group: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Every command with its name."""
    for word, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, f"{name}{word} ")
        else:
            yield f"{name}{word}", command


def test_folders_and_lists_are_asked_for_in_one_way() -> None:
    folders, lists = set(), set()
    for name, command in commands(get_command(app)):
        for option in command.params:
            if "--out" in option.opts:
                assert option.opts == ["--out", "-o"], name
                folders.add(name)
            takes_list = isinstance(option.default, str) and re.fullmatch(r"[-\d.]+(,[-\d.]+)+", option.default)
            if takes_list or {"--gravity", "--thresholds", "--pose-deg"} & set(option.opts):
                assert option.metavar in ("LIST", "LIST|FILE"), (name, option.opts)
                lists.add(name)
    assert {"evaluate", "study parameters", "study speed-limits", "identify", "detect", "plant run"} <= folders
    assert {"sensitivity", "plan identification", "identify", "detect", "detector", "robots show"} <= lists


@pytest.mark.parametrize(
    ("arguments", "unwanted"),
    [
        (["--help"], {"numpy", "scipy", "pydantic", "polars", "matplotlib", "rich.table", "bumpstop._native"}),
        (["evaluate", str(EXAMPLE), "--json"], {"scipy", "polars", "matplotlib", "rich.table", "bumpstop.report"}),
        (["bodies"], {"scipy", "polars", "matplotlib", "bumpstop.report"}),
    ],
)
def test_nothing_heavy_is_imported_in_vain(arguments: list[str], unwanted: set[str]) -> None:
    program = (
        "import sys\nfrom bumpstop.cli.main import main\n"
        f"try:\n    main({arguments!r})\nfinally:\n    print(*sys.modules, file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    imported = set(done.stderr.split())
    assert "typer" in imported
    assert imported.isdisjoint(unwanted)


def test_a_reader_that_leaves_early() -> None:
    for arguments in (["evaluate", EXAMPLE, "--json"], ["bodies"]):
        process = subprocess.Popen([COMMAND, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.wait(60) == 1
        assert process.stderr.read() == b""
        process.stderr.close()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk() -> None:
    for arguments in (["evaluate", EXAMPLE, "--json"], ["evaluate", EXAMPLE], ["bodies"]):
        with Path("/dev/full").open("w") as full:
            done = subprocess.run(
                [COMMAND, *arguments], stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False
            )
        assert (done.returncode, done.stderr) == (1, "error: output: No space left on device\n")


def test_a_terminal_that_knows_ascii_only() -> None:
    for arguments in (["evaluate", EXAMPLE], ["robots"], ["bodies"]):
        done = bumpstop(*arguments, PYTHONIOENCODING="ascii", LC_ALL="C")
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout
    done = bumpstop("evaluate", "größe.toml", PYTHONIOENCODING="ascii", PYTHONUTF8="1")
    assert done.returncode == 2
    assert (
        done.stderr == "error: gr\\xf6\\xdfe.toml: cannot be read (No such file or directory); wanted a scenario file\n"
    )


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts(shell: str) -> None:
    done = bumpstop("--show-completion", shell, _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1")
    assert (done.returncode, done.stderr) == (0, "")
    assert f"complete_{shell}" in done.stdout
    assert "_BUMPSTOP_COMPLETE" in done.stdout


def test_completion_answers() -> None:
    asked = {"_BUMPSTOP_COMPLETE": "complete_bash", "COMP_CWORD": "1"}
    assert bumpstop(COMP_WORDS="bumpstop ev", **asked).stdout.split() == ["evaluate"]
    assert set(bumpstop(COMP_WORDS="bumpstop ", **asked).stdout.split()) == {
        "new",
        "evaluate",
        "report",
        "robots",
        "bodies",
        "plant",
        "recording",
        "identify",
        "validate",
        "study",
        "require",
        "experiment",
        "plan",
        "program",
        "detect",
        "detector",
        "tune",
        "score",
        "sensitivity",
        "stopping",
        "measure",
        "benchmark",
        "campaign",
        "monitor",
        "view",
    }
    options = bumpstop(COMP_WORDS="bumpstop evaluate --s", **(asked | {"COMP_CWORD": "2"})).stdout.split()
    assert set(options) == {"--sampled", "--seed", "--set"}


def test_completion_for_a_shell_nobody_knows() -> None:
    done = bumpstop("--show-completion", "tcsh", _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: --show-completion: 'tcsh' is not one of 'bash', 'zsh', 'fish'")
    done = bumpstop(COMP_WORDS="bumpstop ev", COMP_CWORD="1", _BUMPSTOP_COMPLETE="complete_tcsh")
    assert done.returncode == 1
    assert "Traceback" not in done.stderr


def test_faults_of_our_own_are_status_1(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("by design")

    monkeypatch.setattr("bumpstop.collision.load_scenario", fail)
    result = run("evaluate", EXAMPLE)
    assert (result.status, result.out) == (1, "")
    assert result.err == "error: internal fault (ZeroDivisionError: by design); please report it\n"


def test_an_interruption(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("bumpstop.collision.evaluate", interrupt)
    assert run("evaluate", EXAMPLE) == (130, "", "error: interrupted\n")


@pytest.mark.parametrize("options", [(), ("--sampled", 1000)])
def test_too_little_memory(monkeypatch: pytest.MonkeyPatch, options: tuple[object, ...]) -> None:
    def fail(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr("bumpstop.collision.evaluate", fail)
    result = run("evaluate", EXAMPLE, *options)
    assert (result.status, result.out) == (2, "")
    assert result.err.startswith("error: --sampled: ")
    assert "memory" in result.err


def test_names_in_letters_that_the_terminal_lacks(tmp_path: Path) -> None:
    (tmp_path / "é.csv").write_text("t,q_1\n" + "".join(f"{k / 100},{k}\n" for k in range(100)))
    for encoding, name in (("ascii", r"\xe9.csv"), ("utf-8", "é.csv")):
        done = bumpstop("recording", "info", tmp_path / "é.csv", PYTHONIOENCODING=encoding, PYTHONUTF8="1")
        assert (done.returncode, done.stderr) == (0, "")
        assert name in done.stdout
