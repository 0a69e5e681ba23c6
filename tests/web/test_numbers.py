"""What the page computes is what the command computes: the compiled core in node against the one in Python."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w

import bumpstop as bs
from bumpstop.collision.probability_text import decimal, percent, small_percent
from bumpstop.errors import InputError
from web.cases import random_tables
from web.exports import ROOT
from web.node import MISSING, WHY_NOT, in_node

pytestmark = pytest.mark.skipif(MISSING, reason=WHY_NOT)

# The aim of the page. The arithmetic is the same but for functions of the standard library: differences are some 1e-13.
RELATIVE = 1e-9
# Keys of the command that the page does not give.
NOT_GIVEN = {"contact_duration_s", "arm", "notes"}


def differences(told: Any, wanted: Any, path: str = "") -> list[str]:
    """Where two objects of JSON differ."""
    if isinstance(wanted, dict):
        if told.keys() != wanted.keys():
            return [f"{path}: keys {sorted(told.keys() ^ wanted.keys())}"]
        return [found for key in wanted for found in differences(told[key], wanted[key], f"{path}.{key}")]
    if isinstance(wanted, list):
        pairs = enumerate(zip(told, wanted, strict=True))
        return [found for i, (one, other) in pairs for found in differences(one, other, f"{path}[{i}]")]
    number = isinstance(wanted, float) and isinstance(told, int | float)
    same = math.isclose(told, wanted, rel_tol=RELATIVE) if number else told == wanted
    return [] if same else [f"{path}: {told!r}, wanted {wanted!r}"]


def command(text: str) -> dict[str, Any]:
    """What the command says of a scenario, as far as the page says it, too; warnings apart."""
    found = bs.evaluate(bs.Scenario.from_dict(tomllib.loads(text))).to_json()
    return {key: value for key, value in found.items() if key not in NOT_GIVEN}


def compare(text: str, told: dict[str, Any]) -> list[str]:
    """Differences of a scenario that both compute. Warnings of the page are the command's; it has not all of them."""
    wanted = command(text)
    said, known = told["verdict"].pop("warnings"), wanted["verdict"].pop("warnings")
    return [*differences(told, wanted), *(f"own warning: {one}" for one in said if one not in known)]


def test_examples_have_the_numbers_of_the_command(page_script: Path) -> None:
    texts = {path.name: path.read_text(encoding="utf-8") for path in sorted((ROOT / "examples").glob("0[1-5]*.toml"))}
    assert len(texts) == 5
    for name, told in zip(texts, in_node(page_script, "evaluate", list(texts.values())), strict=True):
        assert compare(texts[name], told) == [], name


def test_random_scenarios_have_the_numbers_of_the_command(page_script: Path) -> None:
    texts = [tomli_w.dumps(random_tables(seed)) for seed in range(70)]
    computed = 0
    for seed, (text, told) in enumerate(zip(texts, in_node(page_script, "evaluate", texts), strict=True)):
        if "refused" in told:
            with pytest.raises(InputError):
                command(text)
            continue
        assert compare(text, told) == [], f"seed {seed}\n{text}"
        computed += 1
    assert computed > 60


def test_warnings_that_the_page_looks_for_are_those_of_the_command(page_script: Path) -> None:
    hand = tomllib.loads((ROOT / "examples" / "01_hand_downward.toml").read_text(encoding="utf-8"))
    changes: tuple[tuple[str, str, Any], ...] = (
        ("motion", "start", "rest"),
        ("motion", "duration_s", 0.12),
        ("contact", "normal", [1.0, 0.0, -0.2]),
        ("contact", "limits", "ts15066"),
        ("simulation", "step_s", 0.002),
        ("simulation", "substeps", 1),
    )
    texts = []
    for table, key, value in changes:
        changed = {name: dict(part) if isinstance(part, dict) else part for name, part in hand.items()}
        changed.setdefault(table, {})[key] = value
        if value == "ts15066":
            changed["contact"]["body"] = "skull_forehead"
        texts.append(tomli_w.dumps(changed))
    found = []
    for text, told in zip(texts, in_node(page_script, "evaluate", texts), strict=True):
        if "refused" in told:
            with pytest.raises(InputError):
                command(text)
            continue
        assert told["verdict"]["warnings"] == command(text)["verdict"]["warnings"], text
        found += told["verdict"]["warnings"]
    print(found)


def test_numbers_are_written_as_the_command_writes_them(page_script: Path) -> None:
    values = [10.0**k * factor for k in range(-14, 8) for factor in (1.0, 1.2345678, 9.99999951, 4.5678)]
    shares = [value for value in values if value <= 1] + [0.0, 1.0, 0.99895, 0.9999991, 0.5]
    written = [f"{value:{form}}" for form in ("g", ".3g", ".17g") for value in values]
    asked = [["general", value, digits] for digits in (6, 3, 17) for value in values]
    assert in_node(page_script, "words", asked) == written
    for name, function in (("percent", percent), ("smallPercent", small_percent)):
        for integrated in (False, True):
            wanted = [function(p, integrated=integrated) for p in shares]
            assert in_node(page_script, "words", [[name, p, integrated] for p in shares]) == wanted
    assert in_node(page_script, "words", [["decimal", p] for p in shares]) == [decimal(p, integrated=True) for p in shares]
