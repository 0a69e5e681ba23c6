"""Files that the page reads hold what Python's reader finds in them; what that refuses, the page refuses."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import pytest
from web.exports import ROOT

from web.node import MISSING, WHY_NOT, in_node

pytestmark = pytest.mark.skipif(MISSING, reason=WHY_NOT)

ODD = (
    "",
    "# nothing",
    "a = 1\r\nb = 2.5 # both\r\n",
    'a = [1, 2.0,\n  # between\n 3e-2, ] # end\n[b]\nc = \'x\\y\'\nd = "\\u00e4\\t\\"#"',
    "a = { b = 1, c = [ {d = 0} ] }\n[e]\n f.g.h = -inf\n f.g.i = nan\n",
    "\"quoted key\" = true\n'other' = +1_000.5e+1_0",
    "[ a . b ]\nc = 0\n[a]\nd = 1",
    "real = 1\n[t]\nreal = 2.5\nvalue = {real = 3}",
)
BAD = (
    "a = 1\na = 2",
    "[a]\n[a]",
    "a = 01",
    "a = 1_",
    "a = .5",
    "a = 5.",
    "a = ",
    "= 1",
    "a 1",
    "a = 1 b = 2",
    "a = [1, 2",
    "a = [1 2]",
    "a = {b = 1, b = 2}",
    "a = {b = 1}\n[a]",
    "a = {b = 1}\n[a.c]",
    "a.b = 1\n[a]",
    "a = 1\n[a]",
    "a = 1\na.b = 2",
    "a = 'x",
    'a = "x\ny"',
    'a = "\\q"',
    "a = yes",
    "[a",
    "[]",
    "[a] b = 1",
    "a = [1]\na.b = 1",
    'a = "\x01"',
    "# \x01",
    "a = [{b = 1}]\n[a.c]",
)


def spelt(value: Any) -> Any:
    """As the page's reader gives it: real numbers apart from whole ones."""
    if isinstance(value, dict):
        return {key: spelt(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [spelt(inner) for inner in value]
    if not isinstance(value, float):
        return value
    names = {math.inf: "Infinity", -math.inf: "-Infinity"}
    return {"value": value if math.isfinite(value) else {"not_finite": names.get(value, "NaN")}}


def test_files_are_read_as_python_reads_them(page_script: Path) -> None:
    files = [path.read_text(encoding="utf-8") for path in sorted((ROOT / "examples").rglob("*.toml"))]
    assert len(files) > 15
    for text, told in zip([*files, *ODD], in_node(page_script, "read", [*files, *ODD]), strict=True):
        # What the page says it cannot read is another matter: [[...]] and texts of several lines.
        if "refused" in told and (
            "is no table of a scenario" in told["refused"] or "this page reads" in told["refused"]
        ):
            assert "[[" in text or '"""' in text
            continue
        assert told == spelt(tomllib.loads(text)), text


def test_damaged_files_are_refused_with_their_line(page_script: Path) -> None:
    for text, told in zip(BAD, in_node(page_script, "read", list(BAD)), strict=True):
        with pytest.raises(tomllib.TOMLDecodeError):
            tomllib.loads(text)
        assert told.get("field", "").startswith("line "), f"{text!r}: {told}"
