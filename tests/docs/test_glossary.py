"""The glossary against the code: names that exist, files that hold them, no public name left out."""

from __future__ import annotations

import dataclasses
import importlib
from typing import Any

import pytest

import bumpstop as bs
from docs.pages import ROOT, code, read, rows

ROWS = rows(read("docs/glossary.md"), "term")


def _find(name: str) -> Any:
    """The object of a dotted name under ``bumpstop``; a module may have to be imported first."""
    found: Any = bs
    path = "bumpstop"
    for part in name.split("."):
        path += f".{part}"
        try:
            found = getattr(found, part)
        except AttributeError:
            if dataclasses.is_dataclass(found) and part in {field.name for field in dataclasses.fields(found)}:
                return part
            found = importlib.import_module(path)
    return found


@pytest.mark.parametrize("row", ROWS, ids=[row[0] for row in ROWS])
def test_names_and_files_exist(row: list[str]) -> None:
    *_, names, file = row
    text = (ROOT / code(file)[0]).read_text(encoding="utf-8")
    for name in code(names):
        assert _find(name) is not None
        if "." not in name:
            assert name in text, f"{name} is not in {file}"


def test_every_public_name_has_a_row() -> None:
    assert set(bs.__all__) <= {name for row in ROWS for name in code(row[3])}


def test_a_term_has_one_row() -> None:
    terms = [row[0] for row in ROWS]
    assert len(terms) == len(set(terms))
