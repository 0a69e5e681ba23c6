"""The form of a table whose figures are not ours: empty it is rejected by name, filled it is a table like any other."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import bumpstop as bs
from bumpstop.contact import LimitTable, form_text, limit_forms
from cli.support import run

(NAME,) = limit_forms()


def filled() -> str:
    """The form with made-up figures."""
    text = form_text(NAME)
    text = re.sub(r'^(source|status) = ""', r'\1 = "made up"', text, flags=re.MULTILINE)
    figures = {"force_N": 100, "pressure_N_cm2": 50, "spring_N_mm": 75, "effective_mass_kg": 1.5}
    for key, value in figures.items():
        text = re.sub(rf'^{key} = ""', f"{key} = {value}", text, flags=re.MULTILINE)
    return re.sub(r'^transient_(force_N|pressure_N_cm2) = ""', "transient_multiplier = 2", text, flags=re.MULTILINE)


def test_the_form_holds_no_figure() -> None:
    for line in form_text(NAME).splitlines():
        if re.match(r"(force|transient|spring|effective|pressure|source|status)", line):
            assert re.fullmatch(r'\w+ = ""(  #.*)?', line), line


def test_empty_it_is_rejected_by_name(tmp_path: Path) -> None:
    with pytest.raises(bs.InputError, match=f"contact.limits: '{NAME}' is an empty form without figures"):
        LimitTable.load(NAME)
    path = tmp_path / "annex_m.toml"
    path.write_text(form_text(NAME), encoding="utf-8")
    with pytest.raises(
        bs.InputError, match=r"source: is empty, and so are \d+ more places of 'ISO 10218-2:2025, annex M'"
    ):
        LimitTable.load(path)
    half = filled().replace("force_N = 100", 'force_N = ""')
    path.write_text(half, encoding="utf-8")
    with pytest.raises(
        bs.InputError, match=r"\[\[region\]\] 1 \('skull_forehead'\) force_N: is empty, and so are 11 more"
    ):
        LimitTable.load(path)
    path.write_text(filled().replace("force_N = 100", 'force_N = ""', 1), encoding="utf-8")
    with pytest.raises(bs.InputError, match=r"\[\[region\]\] 1 \('skull_forehead'\) force_N: '' is no number"):
        LimitTable.load(path)


def test_filled_it_judges(tmp_path: Path) -> None:
    path = tmp_path / "annex_m.toml"
    path.write_text(filled(), encoding="utf-8")
    table, known = LimitTable.load(path), LimitTable.load("ts15066")
    assert table.name == NAME
    assert [region.name for region in table.regions] == [region.name for region in known.regions]
    assert [area.label for area in table.areas] == [area.label for area in known.areas]
    scenario = bs.load_scenario(
        Path(__file__).parents[2] / "examples" / "05_ur10e.toml", {"contact.limits": str(path), "contact.body": "chest"}
    )
    assert bs.evaluate(scenario).verdict.to_json()["limit_force_N"] == 100


def test_command(tmp_path: Path) -> None:
    path = tmp_path / "annex_m.toml"
    assert run("bodies", "--form", path) == (0, f"form: {path}\n", "")
    assert path.read_text(encoding="utf-8") == form_text(NAME)
    refused = run("bodies", "--form", path)
    assert (refused.status, refused.out) == (2, "")
    assert "a filled form is not overwritten" in refused.err
    with pytest.raises(bs.InputError, match="no form is called 'annex'"):
        form_text("annex")
