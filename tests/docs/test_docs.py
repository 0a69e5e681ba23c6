"""What the documentation says, run and compared with the code."""

from __future__ import annotations

import ast
import copy
import doctest
import math
import re
import shutil
import tomllib
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic_core import PydanticUndefined

import bumpstop as bs
from bumpstop.collision.scenario.scenario import Scenario
from bumpstop.collision.scenario.scenario_tables import SimulationTable
from collision.cases import FREE, REMEMBERING, VARIED
from docs.pages import AS_DOCTEST, PAGES, ROOT, blocks, code, read, rows, section, without_fences

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
    result = bs.evaluate(bs.load_scenario(path))
    assert 0 < result.peak_force.quantile(0.5) < math.inf


@pytest.mark.parametrize(
    "name",
    [
        "how_to/measure.md",
        "how_to/register.md",
        "how_to/uncertainty.md",
        "how_to/view.md",
        "reference/collision.md",
        "reference/robot/recording.md",
        "reference/stopping.md",
    ],
)
def test_python_session(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = ROOT / "docs" / name
    scenario = blocks(
        page if name == "how_to/uncertainty.md" else ROOT / "docs" / "reference" / "collision.md", "toml"
    )[0]
    (tmp_path / "scenario.toml").write_text(scenario, encoding="utf-8")
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    sessions = blocks(page, "pycon")
    test = doctest.DocTestParser().get_doctest("\n".join(sessions), {}, page.name, str(page), 0)
    assert test.examples
    assert doctest.DocTestRunner(optionflags=AS_DOCTEST).run(test).failed == 0


# --- Scenario keys ------------------------------------------------------------------------------------------


def documented_keys() -> dict[str, list[str]]:
    """Dotted key to unit, default, valid values and meaning."""
    text = section(read("docs/reference/collision.md"), "## Every key")
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
    asked = [text for row in rows(read("docs/reference/collision.md"), "key") if len(row) == 2 for text in code(row[0])]
    assert asked == ['contact.arm = "two_mass"', "reaction.stop_category = 0"]
    for text in asked:
        key, _, value = text.partition(" = ")
        changed = copy.deepcopy(data)
        table, name = key.split(".")
        changed["contact"] |= {"kind": "free", "body_mass_kg": 2.0}  # which an arm of two masses is about
        changed["reaction"]["kind"] = "stop"  # brakes alone turn no arm back
        changed[table][name] = tomllib.loads(f"value = {value}")["value"]
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
        python: Any = {"Simulation": SimulationTable}.get(owner) or getattr(bs, owner)
        known = {*dir(python), *getattr(python, "__dataclass_fields__", ()), *getattr(python, "model_fields", ())}
        assert member in known, (symbol, in_python)


def test_rooms_import_only_what_they_may() -> None:
    allowed = {code(room)[0]: set(code(may)) for room, *_, may in rows(read("docs/architecture.md"), "room")}
    everyones = {"display", "errors", "arrays", "text_files", "csv_table", "output_files", "terminal", "interruption"}
    everyones |= {"_native", "_cpu", "rounding"}
    for tree in ("include/bumpstop", "src/bumpstop"):
        folders = {path.name for path in (ROOT / tree).iterdir() if path.is_dir() and path.name != "__pycache__"}
        assert folders <= set(allowed)
    for room, may in allowed.items():
        for path in (ROOT / "include" / "bumpstop" / room).rglob("*.hpp"):
            used = set(re.findall(r'^#include "bumpstop/(\w+)/', path.read_text(encoding="utf-8"), re.MULTILINE))
            assert used <= may | {room}, path
        for path in (ROOT / "src" / "bumpstop" / room).rglob("*.py"):
            syntax = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
            modules = [node.module or "" for node in syntax if isinstance(node, ast.ImportFrom)]
            modules += [name.name for node in syntax if isinstance(node, ast.Import) for name in node.names]
            used = {module.split(".")[1] for module in modules if module.startswith("bumpstop.")}
            assert used <= may | everyones | {room}, path


def test_the_readme_counts_the_scenarios_that_are_compared() -> None:
    words = {8: "eight", 10: "ten", 13: "thirteen"}
    claims = " ".join(claim for claim, *_ in rows(read("README.md"), "claim"))
    for scenarios, what in (
        (VARIED, "scenarios with white noise"),
        (REMEMBERING, "with correlated noise or residuals"),
        (FREE, "scenarios of free contact"),
    ):
        assert f"{words[len(scenarios)]} {what}" in claims


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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
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


@pytest.mark.parametrize(
    "room", sorted({page.parent for page in PAGES} - {ROOT}), ids=lambda path: str(path.relative_to(ROOT))
)
def test_a_room_has_at_most_fifteen_files(room: Path) -> None:
    assert len([path for path in room.iterdir() if path.is_file()]) <= 15
