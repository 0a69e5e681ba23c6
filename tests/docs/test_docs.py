"""What the documentation says, run and compared with the code."""

from __future__ import annotations

import ast
import copy
import doctest
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any, get_args

import pytest
import typer
from pydantic_core import PydanticUndefined

import bumpstop as bs
from bumpstop.cli.main import app, main
from bumpstop.cli.output import settings_toml
from bumpstop.collision.scenario import Scenario, Simulation

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
WIDTH = "110"  # of the consoles in docs/cli.md
AS_DOCTEST = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def read(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def section(text: str, heading: str) -> str:
    """What stands under a heading, up to the next of its rank or above."""
    begin = text.index(f"\n{heading}\n") + len(heading) + 2
    rank = len(heading) - len(heading.lstrip("#"))
    end = re.compile(rf"^#{{1,{rank}}} ", re.MULTILINE).search(text, begin)
    return text[begin : end.start() if end else None]


def rows(text: str, first_column: str) -> list[list[str]]:
    """Cells of the rows of every table whose first column is called so."""
    found: list[list[str]] = []
    inside = False
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")] if line.startswith("|") else []
        if not cells:
            inside = False
        elif cells[0] == first_column:
            inside = True
        elif inside and not set(cells[0]) <= {"-"}:
            found.append(cells)
    assert found, f"no table begins with {first_column!r}"
    return found


def without_fences(text: str) -> str:
    return re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)


def code(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


# --- Scenarios and sessions ---------------------------------------------------------------------------------


def complete_scenarios() -> list[Any]:
    found = []
    for page in PAGES:
        for number, text in enumerate(blocks(page, "toml"), start=1):
            if re.search(r"^robot *=", text, re.MULTILINE) and "[motion]" in text and "[contact]" in text:
                found.append(pytest.param(text, id=f"{page.name}-{number}"))
    return found


@pytest.mark.parametrize("text", complete_scenarios())
def test_complete_scenario_runs(text: str, tmp_path: Path) -> None:
    path = tmp_path / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    law = bs.evaluate(bs.load_scenario(path))
    assert 0 < law.peak_force.quantile(0.5) < math.inf


@pytest.mark.parametrize("name", ["collision.md", "recording.md"])
def test_python_session(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = blocks(ROOT / "docs" / "collision.md", "toml")[0]
    page = ROOT / "docs" / name
    (tmp_path / "scenario.toml").write_text(scenario, encoding="utf-8")
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    sessions = blocks(page, "pycon")
    test = doctest.DocTestParser().get_doctest("\n".join(sessions), {}, page.name, str(page), 0)
    assert test.examples
    assert doctest.DocTestRunner(optionflags=AS_DOCTEST).run(test).failed == 0


# --- The command line ---------------------------------------------------------------------------------------


def consoles() -> list[Any]:
    """Each console of docs/cli.md as commands with what they print."""
    found = []
    for number, text in enumerate(blocks(ROOT / "docs" / "cli.md", "console"), start=1):
        parts = re.split(r"^\$ (.*)\n", text, flags=re.MULTILINE)
        assert parts[0] == ""
        session = list(zip(parts[1::2], parts[2::2], strict=True))
        found.append(pytest.param(session, id=f"{number}-{session[0][0][:40]}"))
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
        law = bs.evaluate(bs.load_scenario("examples/01_hand_downward.toml"))
        Path("out/hand").mkdir(parents=True)
        Path("out/hand/settings.toml").write_text(settings_toml(law), encoding="utf-8")
    for command, wanted in session:
        printed = shell.run(command)
        assert doctest.OutputChecker().check_output(wanted, printed, AS_DOCTEST), f"$ {command}\n{printed}"
        assert shell.status in ((2,) if "error:" in wanted or wanted == "2\n" else (0, 3))
    if "--out" in session[0][0]:
        written = {path.name for path in (tmp_path / "out" / "hand").iterdir()}
        for name, *_ in rows(section(read("docs/cli.md"), "### Files: `--out`"), "file"):
            for pattern in code(name):
                assert any(Path(file).match(pattern) for file in written), pattern


@pytest.mark.parametrize("page", ["tutorial_identification.md", "tutorial_plant.md"])
def test_tutorial(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every console of a tutorial, one after the other in one folder."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", WIDTH)
    shell = Shell(tmp_path, capsys)
    for text in blocks(ROOT / "docs" / page, "console"):
        parts = re.split(r"^\$ (.*)\n", text, flags=re.MULTILINE)
        for command, wanted in zip(parts[1::2], parts[2::2], strict=True):
            if command.startswith("python "):
                arguments = [sys.executable, *shlex.split(command)[1:]]
                done = subprocess.run(arguments, capture_output=True, text=True, check=False)
                printed, shell.status = done.stdout + done.stderr, done.returncode
            else:
                printed = shell.run(command)
            assert shell.status == 0, printed
            assert doctest.OutputChecker().check_output(wanted, printed, AS_DOCTEST), f"$ {command}\n{printed}"


@pytest.mark.parametrize(
    "command",
    ["evaluate", "bodies", "robots", "identify", "validate", "detect", "detector", "tune", "score", "sensitivity"],
)
def test_options(command: str) -> None:
    parameters: Any = typer.main.get_command(app).commands[command].params  # type: ignore[attr-defined]
    compare_options(parameters, command)


@pytest.mark.parametrize("command", ["show", "export"])
def test_options_of_robots(command: str) -> None:
    group: Any = typer.main.get_command(app).commands["robots"]  # type: ignore[attr-defined]
    compare_options(group.commands[command].params, f"robots {command}")


@pytest.mark.parametrize("command", ["identification", "excitation"])
def test_options_of_plan(command: str) -> None:
    group: Any = typer.main.get_command(app).commands["plan"]  # type: ignore[attr-defined]
    compare_options(group.commands[command].params, f"plan {command}")


@pytest.mark.parametrize("command", ["info", "convert"])
def test_options_of_recording(command: str) -> None:
    group: Any = typer.main.get_command(app).commands["recording"]  # type: ignore[attr-defined]
    compare_options(group.commands[command].params, f"recording {command}")


def test_options_of_plant() -> None:
    group: Any = typer.main.get_command(app).commands["plant"]  # type: ignore[attr-defined]
    compare_options(group.commands["run"].params, "plant run")


@pytest.mark.parametrize("command", ["parameters", "effectiveness", "workspace"])
def test_options_of_studies(command: str) -> None:
    group: Any = typer.main.get_command(app).commands["study"]  # type: ignore[attr-defined]
    compare_options(group.commands[command].params, f"study {command}")


def compare_options(parameters: Any, heading: str) -> None:
    options = {p.opts[0]: p.default for p in parameters if p.param_type_name == "option" and p.name != "help"}
    text = section(read("docs/cli.md"), f"## `bumpstop {heading}`")
    table = {code(name)[0].split()[0]: code(default) for name, default, _ in rows(text, "option")} if options else {}
    assert set(table) == set(options)
    for name, default in table.items():
        if default:
            assert str(options[name]) == default[0], name
        else:
            assert options[name] in (None, False, [])


def test_json_keys() -> None:
    text = section(read("docs/cli.md"), "### For programs: `--json`")
    keys = {key for name, *_ in rows(text, "key") for key in code(name)}
    verdict_keys = {key for name, *_ in rows(text, "key of `verdict`") for key in code(name)}
    scenario = bs.load_scenario(ROOT / "examples" / "01_hand_downward.toml")
    sampled = bs.evaluate(scenario, samples=10).to_json()
    assert keys == set(sampled)
    assert keys - {"samples", "seed"} == set(bs.evaluate(scenario).to_json())
    assert verdict_keys == set(sampled["verdict"])


def test_columns_of_the_law() -> None:
    from bumpstop.collision.tables import law_table

    text = section(read("docs/cli.md"), "### Files: `--out`")
    scenario = bs.load_scenario(ROOT / "examples" / "01_hand_downward.toml")
    exact = law_table(bs.evaluate(scenario))
    (listed,) = [span for span in code(without_fences(text)) if span.startswith("probability ")]
    assert set(listed.split()) == set(exact.columns)
    assert exact["probability"].to_list()[-4:] == [0.995, 0.999, 0.9995, 0.9999]
    choices = {"{x,y,z}": "xyz", "{j}": "1234567", "{i}": "123456"}
    columns = set()
    for name, *_ in rows(text, "columns"):
        for pattern in code(name)[0].split():
            (mark,) = [mark for mark in choices if mark in pattern] or [""]
            columns |= {pattern.replace(mark, one) for one in choices[mark]} if mark else {pattern}
    assert columns == set(law_table(bs.evaluate(scenario, samples=10)).columns)


# --- Scenario keys ------------------------------------------------------------------------------------------


def documented_keys() -> dict[str, list[str]]:
    """Dotted key to unit, default, valid values and meaning."""
    text = section(read("docs/collision.md"), "## Every key")
    found: dict[str, list[str]] = {}
    for heading in re.findall(r"^### (top level|`\[\w+\]`)$", text, re.MULTILINE):
        table = "" if heading == "top level" else heading.strip("`[]") + "."
        for key, *cells in rows(section("\n" + text, f"### {heading}"), "key"):
            found[table + code(key)[0]] = cells
    return found


def existing_keys() -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, field in Scenario.model_fields.items():
        if name == "folder":
            continue
        model = field.annotation
        if isinstance(model, type) and hasattr(model, "model_fields"):
            found |= {f"{name}.{key}": inner for key, inner in model.model_fields.items()}
        else:
            found[name] = field
    return found


def test_every_key_is_documented_and_every_documented_key_exists() -> None:
    assert set(documented_keys()) == set(existing_keys())


@pytest.mark.parametrize("key", sorted(existing_keys()))
def test_default(key: str) -> None:
    written = documented_keys()[key][1]
    default = existing_keys()[key].default
    if written == "required":
        assert default is PydanticUndefined
    elif written == "none":
        assert default is None
    else:
        assert tomllib.loads(f"value = {code(written)[0]}")["value"] == default


def bounds(schema: Any) -> set[float]:
    """All limits in a JSON schema."""
    if isinstance(schema, list):
        return set().union(*map(bounds, schema))
    if not isinstance(schema, dict):
        return set()
    names = ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")
    own = {float(schema[name]) for name in names if name in schema}
    return own.union(*(bounds(value) for value in schema.values()))


@pytest.mark.parametrize("key", sorted(existing_keys()))
def test_valid_values(key: str) -> None:
    valid, field = documented_keys()[key][2], existing_keys()[key]
    model: Any = Scenario
    *tables, name = key.split(".")
    for table in tables:
        model = model.model_fields[table].annotation
    limits = bounds(model.model_json_schema()["properties"][name])
    number = r"(-?[\d.]+(?:e-?\d+)?)"
    found = re.search(rf"{number} to {number}|between {number} and {number}", valid)
    if key == "detector.thresholds_Nm":  # checked by hand, as inf is allowed
        limits = {1e-6, 1e9}
    assert (set() if found is None else {float(x) for x in found.groups() if x}) == limits
    choices = [choice for choice in get_args(field.annotation) if isinstance(choice, str)]
    if choices:
        assert [text.strip('"') for text in code(valid)] == choices


def test_limits_of_thresholds() -> None:
    scenario = bs.load_scenario(ROOT / "examples" / "01_hand_downward.toml")
    for good in (1e-6, 1e9, math.inf):
        scenario.with_values({"detector.thresholds_Nm": [good] * 7})
    for bad in (0.99e-6, 1.01e9, -math.inf):
        with pytest.raises(bs.InputError, match="cannot be used"):
            scenario.with_values({"detector.thresholds_Nm": [bad] * 7})


def test_what_is_not_available_is_refused_by_name() -> None:
    data = bs.load_scenario(ROOT / "examples" / "06_pick_and_place_trajectory.toml").to_dict()
    asked = [text for row in rows(read("docs/collision.md"), "key") if len(row) == 2 for text in code(row[0])]
    assert asked == ['contact.arm = "two_mass"']
    for text in asked:
        key, _, value = text.partition(" = ")
        changed = copy.deepcopy(data)
        table, name = key.split(".")
        changed["contact"] |= {"kind": "free", "body_mass_kg": 2.0}  # which an arm of two masses is about
        changed[table][name] = value.strip('"')
        with pytest.raises(bs.InputError, match="not available with") as refused:
            bs.Scenario.from_dict(changed, ROOT / "examples")
        assert refused.value.field == key


# --- Conventions and architecture ---------------------------------------------------------------------------


def test_symbols_exist_in_both_languages() -> None:
    headers = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "include").rglob("*.hpp"))
    for symbol, *_, in_cpp, in_python in rows(read("docs/conventions.md"), "symbol"):
        owner, _, member = code(in_cpp)[0].partition("::")
        if member:
            (body,) = re.findall(rf"^(?:struct|class) {owner} {{\n(.*?)^}};", headers, re.MULTILINE | re.DOTALL)
            assert re.search(rf"\b{member}\b", body), in_cpp
        else:
            assert re.search(rf"\b{owner}\b", headers), in_cpp
        owner, member = code(in_python)[0].split(".")
        python: Any = {"Simulation": Simulation}.get(owner) or getattr(bs, owner)
        known = {*dir(python), *getattr(python, "__dataclass_fields__", ()), *getattr(python, "model_fields", ())}
        assert member in known, (symbol, in_python)


def test_rooms_import_only_what_they_may() -> None:
    allowed = {code(room)[0]: set(code(may)) for room, *_, may in rows(read("docs/architecture.md"), "room")}
    everyones = {"errors", "arrays", "kernels", "_cpu"}
    for tree in ("include/bumpstop", "src/bumpstop"):
        folders = {path.name for path in (ROOT / tree).iterdir() if path.is_dir() and path.name != "__pycache__"}
        assert folders <= set(allowed)
    for room, may in allowed.items():
        for path in (ROOT / "include" / "bumpstop" / room).glob("*.hpp"):
            used = set(re.findall(r'^#include "bumpstop/(\w+)/', path.read_text(encoding="utf-8"), re.MULTILINE))
            assert used <= may | {room}, path
        for path in (ROOT / "src" / "bumpstop" / room).rglob("*.py"):
            syntax = ast.parse(path.read_text(encoding="utf-8"))
            modules = [node.module or "" for node in ast.walk(syntax) if isinstance(node, ast.ImportFrom)]
            modules += [name.name for node in ast.walk(syntax) if isinstance(node, ast.Import) for name in node.names]
            used = {module.split(".")[1] for module in modules if module.startswith("bumpstop.")}
            assert used <= may | everyones | {room}, path


def test_make_targets_exist() -> None:
    rules = set(re.findall(r"^(\w+):", read("Makefile"), re.MULTILINE))
    for target in re.findall(r"`make (\w+)`", read("CONTRIBUTING.md")):
        assert target in rules


def test_changelog_has_this_version() -> None:
    version = tomllib.loads(read("pyproject.toml"))["project"]["version"]
    assert re.search(r"^## \[([^\]]+)\]", read("CHANGELOG.md"), re.MULTILINE).group(1) == version  # type: ignore[union-attr]


# --- Links --------------------------------------------------------------------------------------------------


def anchors(page: Path) -> set[str]:
    """Anchors of the headings, by GitHub's rule."""
    text = without_fences(page.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links(page: Path) -> None:
    text = without_fences(page.read_text(encoding="utf-8"))
    for link in re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'(?:src|href)="([^"]+)"', text):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        assert target.is_relative_to(ROOT), link
        if anchor:
            assert anchor in anchors(target), link
