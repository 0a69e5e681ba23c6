"""What the documentation says of the command line, run and compared with the code."""

from __future__ import annotations

import doctest
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer

import bumpstop as bs
from bumpstop.cli.collision.output import settings_toml
from bumpstop.cli.main import app, main
from docs.pages import AS_DOCTEST, CLI, ROOT, WIDTH, blocks, code, command_line, read, rows, section, without_fences


def consoles() -> list[Any]:
    """Each console of the pages as commands with what they print."""
    found = []
    for page in (*CLI, ROOT / "docs/reference/study.md", ROOT / "docs/how_to/program.md"):
        for number, text in enumerate(blocks(page, "console"), start=1):
            parts = re.split(r"^\$ (.*)\n", text, flags=re.MULTILINE)
            assert parts[0] == ""
            session = list(zip(parts[1::2], parts[2::2], strict=True))
            found.append(pytest.param(session, id=f"{page.parent.name}-{page.name}-{number}-{session[0][0][:40]}"))
    return found


class Shell:
    """Runs ``bumpstop`` inside this process, and in bash where the shell itself matters."""

    def __init__(self, folder: Path, capture: pytest.CaptureFixture[str]) -> None:
        self.folder, self.capture, self.status = folder, capture, 0

    def run(self, command: str) -> str:
        if command == "echo $?":
            return f"{self.status}\n"
        name, *arguments = shlex.split(command)
        if name != "bumpstop" or any("completion" in argument for argument in arguments):
            return self.run_in_bash(command)
        self.capture.readouterr()
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        self.status = ended.value.code if isinstance(ended.value.code, int) else 1
        return "".join(self.capture.readouterr())

    def run_in_bash(self, command: str) -> str:
        bash = shutil.which("bash")
        if bash is None:
            pytest.skip("bash is not installed")
        program, ours = (self.folder / folder / "bumpstop" for folder in ("program", "bin"))
        for path in (program, ours):
            path.parent.mkdir(exist_ok=True)
        program.write_text("from bumpstop.cli.main import main\n\nmain()\n")
        ours.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{program}" "$@"\n')
        ours.chmod(0o755)
        home = {"HOME": str(self.folder), "PATH": f"{ours.parent}{os.pathsep}{os.environ['PATH']}"}
        # The trailing command keeps bash from replacing itself: completion looks for the shell it is called from.
        done = subprocess.run(
            [bash, "-c", f"{command}\nstatus=$?; exit $status"],
            env=os.environ | home,
            capture_output=True,
            text=True,
            check=False,
        )
        self.status = done.returncode
        return done.stdout + done.stderr


@pytest.mark.parametrize("session", consoles())
def test_console(
    session: list[tuple[str, str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", WIDTH)
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE", "BUMPSTOP_TARGET"):
        monkeypatch.delenv(name, raising=False)
    shell = Shell(tmp_path, capsys)
    if "out/hand/settings.toml" in session[0][0]:
        result = bs.evaluate(bs.load_scenario("examples/01_hand_downward.toml"))
        Path("out/hand").mkdir(parents=True)
        Path("out/hand/settings.toml").write_text(settings_toml(result), encoding="utf-8")
    for command, wanted in session:
        printed = shell.run(command)
        assert doctest.OutputChecker().check_output(wanted, printed, AS_DOCTEST), f"$ {command}\n{printed}"
        assert shell.status in ((2,) if "error:" in wanted or wanted == "2\n" else (0, 3, 4))
    if "--out out/hand" in session[0][0]:
        written = {path.name for path in (tmp_path / "out" / "hand").iterdir()}
        for name, *_ in rows(section(command_line(), "### Files: `--out`"), "file"):
            for pattern in code(name):
                assert any(Path(file).match(pattern) for file in written), pattern


@pytest.mark.usefixtures("unsaved_pictures")
def test_readme(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """What make run ends with, every command of the README, and its session in Python."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    shell = Shell(tmp_path, capsys)
    (recipe,) = re.findall(r"^run: build\n\t\$\(BIN\)/(bumpstop .*?) \|\|", read("Makefile"), re.MULTILINE)
    printed = shell.run(recipe.replace("$(OUT)", "out/hand_downward"))
    (shown,) = blocks(ROOT / "README.md", "text")
    assert doctest.OutputChecker().check_output(shown, printed, AS_DOCTEST), printed
    asked = [line[2:] for text in blocks(ROOT / "README.md", "console")[1:] for line in text.splitlines()]
    assert len(asked) > 5
    for command in asked:
        printed = shell.run(command)
        assert shell.status in (0, 3), f"$ {command}\n{printed}"
    (session,) = blocks(ROOT / "README.md", "python")
    exec(compile(session, "README.md", "exec"), {})
    numbers = capsys.readouterr().out.splitlines()
    assert numbers[1] == "True " + bs.evaluate(bs.load_scenario("examples/01_hand_downward.toml")).verdict.reason


def test_python_of_the_page_on_studies(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(ROOT)
    page = ROOT / "docs" / "reference" / "study.md"
    program, session = blocks(page, "python")
    exec(compile(program, page.name, "exec"), {})
    assert capsys.readouterr().out == blocks(page, "text")[0]
    test = doctest.DocTestParser().get_doctest(session, {}, page.name, str(page), 0)
    assert doctest.DocTestRunner(optionflags=AS_DOCTEST).run(test).failed == 0


def commands(group: Any, above: str = "") -> dict[str, Any]:
    """Every command below a group by its words; a group that does something by itself is one, too."""
    found = {above: group} if above and group.invoke_without_command else {}
    for name, command in group.commands.items():
        words = f"{above} {name}".strip()
        found |= commands(command, words) if hasattr(command, "commands") else {words: command}
    return found


COMMANDS = commands(typer.main.get_command(app))


@pytest.mark.parametrize("command", COMMANDS)
def test_options(command: str) -> None:
    parameters = COMMANDS[command].params
    options = {p.opts[0]: p.default for p in parameters if p.param_type_name == "option" and p.name != "help"}
    text = section(command_line(), f"## `bumpstop {command}`")
    table = {code(name)[0].split()[0]: code(default) for name, default, _ in rows(text, "option")} if options else {}
    assert set(table) == set(options)
    for name, default in table.items():
        if default:
            assert str(options[name]) == default[0], name
        else:
            assert options[name] in (None, False, [])


def test_the_first_table_has_every_command_in_the_words_of_the_headings() -> None:
    page = command_line()
    listed = [re.sub(r" [A-Z-].*", "", code(row[0])[0]).removeprefix("bumpstop ") for row in rows(page, "command")]
    assert sorted(listed) == sorted(COMMANDS)
    headings = re.findall(r"^## `bumpstop (.*)`$", page, re.MULTILINE)
    assert sorted(headings) == sorted(COMMANDS)


def test_json_keys() -> None:
    text = section(command_line(), "### For programs: `--json`")
    keys, verdict_keys, bounds_keys, uncertainty_keys = (
        {key for name, *_ in rows(text, heading) for key in code(name)}
        for heading in ("key", "key of `verdict`", "key of `impact_bounds`", "key of `uncertainty`")
    )
    scenario = bs.load_scenario(ROOT / "examples" / "01_hand_downward.toml")
    plain, sampled = bs.evaluate(scenario).to_json(), bs.evaluate(scenario, samples=10).to_json()
    named = {"contact.body": "hand_finger", "contact.limits": "ts15066"}
    free = bs.evaluate(scenario.with_values({**named, "contact.kind": "free"})).to_json()
    phases = bs.evaluate(scenario.with_values({**named, "verdict.clamped_limit": "two_phase"})).to_json()
    of_samples, of_phases = {"samples", "seed"}, {"limit_transient_force_N", "limit_transient_pressure_N_cm2"}
    uncertain = bs.evaluate_uncertain(bs.load_scenario(ROOT / "examples" / "07_hand_uncertain.toml")).to_json()
    assert set(uncertain) == {*plain, "uncertainty"}
    assert uncertainty_keys == set(uncertain["uncertainty"])
    keys -= {"uncertainty"}
    assert keys - of_samples - {"impact_bounds"} == set(plain) == set(phases)
    assert keys - {"impact_bounds"} == set(sampled)
    assert keys - of_samples == set(free)
    assert bounds_keys == set(free["impact_bounds"])
    assert verdict_keys == set(phases["verdict"])
    assert verdict_keys - of_phases == set(plain["verdict"]) == set(free["verdict"])
    kinds = text[text.index("| `limit_table`, `limit_kind`") :].split("|")[3]
    assert {result["verdict"]["limit_kind"] for result in (plain, free, phases)} == set(re.findall(r'`"(\w+)"`', kinds))


def test_columns_of_the_law() -> None:
    from bumpstop.collision.tables import result_table

    text = section(command_line(), "### Files: `--out`")
    scenario = bs.load_scenario(ROOT / "examples" / "01_hand_downward.toml")
    exact = result_table(bs.evaluate(scenario))
    (listed,) = [span for span in code(without_fences(text)) if span.startswith("probability ")]
    assert set(listed.split()) == set(exact.columns)
    assert exact["probability"].to_list()[-4:] == [0.995, 0.999, 0.9995, 0.9999]
    choices = {"{x,y,z}": "xyz", "{j}": "1234567", "{i}": "123456"}
    columns = set()
    for name, *_ in rows(text, "columns"):
        for pattern in code(name)[0].split():
            (mark,) = [mark for mark in choices if mark in pattern] or [""]
            columns |= {pattern.replace(mark, one) for one in choices[mark]} if mark else {pattern}
    assert columns == set(result_table(bs.evaluate(scenario, samples=10)).columns)
