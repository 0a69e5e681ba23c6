"""Readers of programs on damaged programs: no byte is lost, and nothing but a refusal is raised."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from bumpstop.errors import InputError
from bumpstop.program.languages.krl import parse_krl, read_krl
from bumpstop.program.languages.message_syntax import parse_json, parse_yaml
from bumpstop.program.languages.rapid import parse_rapid, read_rapid
from bumpstop.program.languages.syntax import Edit, edited
from bumpstop.program.languages.urscript import parse_urscript, read_urscript
from bumpstop.program.trajectories.messages import read_messages
from program.corpora import EXAMPLES, KRL, RAPID, URSCRIPT, cell, mutated
from validation.findings import Findings

TITLE = "Readers of programs on damaged programs"
# Ten minutes for all readers: the whole validation ends within some hours.
RUNS = 100_000
# Of a message only some points: all of them take ten times as long to damage and to read.
_POINTS = 3


def compare(findings: Findings, *, quick: bool, runs: int | None = None) -> None:
    """Every reader on programs that are cut, doubled, mixed and sprinkled with other bytes."""
    count = runs or (200 if quick else RUNS)
    messages = short_messages()
    readers: dict[str, tuple[tuple[bytes, ...], Callable[[bytes], bool]]] = {
        "URScript": (URSCRIPT, lambda text: parse_urscript(text).text() == text and bool(read_urscript(text))),
        "KRL": (KRL, lambda text: parse_krl(text).text() == text and bool(read_krl(text, text))),
        "RAPID": (RAPID, lambda text: parse_rapid(text).text() == text and bool(read_rapid(text))),
        "JSON": (messages["JSON"], lambda text: _same(text, parse_json, Path("x.json"))),
        "YAML": (messages["YAML"], lambda text: _same(text, parse_yaml, Path("x.yaml"))),
    }
    rows = []
    for name, (corpus, holds) in readers.items():
        begin, lost, refused, raised, slowest = time.perf_counter(), 0, 0, "", 0.0
        for seed in range(count):
            # Half of a message is none: it would be refused before anything is read.
            text = mutated(corpus, seed, whole=name in messages)
            start = time.perf_counter()
            try:
                lost += not holds(text)
            except InputError:
                refused += 1
            except Exception as error:
                raised = raised or f"seed {seed}: {type(error).__name__}: {error}"
            slowest = max(slowest, time.perf_counter() - start)
        findings.check(f"{name}: {count} damaged programs, no byte lost", lost == 0, f"{lost} lost")
        findings.check(f"{name}: nothing but refusals", not raised, raised)
        rows.append([name, count, refused, time.perf_counter() - begin, 1e3 * slowest])
    heads = ["Reader", "Runs", "Refused", "Time [s]", "Slowest [ms]"]
    findings.table("Damaged programs", heads, ["", "d", "d", ".1f", ".1f"], rows)


def short_messages() -> dict[str, tuple[bytes, ...]]:
    """By format: a trajectory of some points, and inside of a MoveIt message."""
    whole = json.loads((EXAMPLES / "planned.json").read_bytes())
    trajectory = next(_trajectories(whole))
    few = {**trajectory, "points": trajectory["points"][:_POINTS]}
    every = (few, {"joint_trajectory": few}, {"trajectory": [{"joint_trajectory": few}], "model_id": "x"})
    yaml = (EXAMPLES / "planned.yaml").read_bytes().split(b"  - positions")
    return {
        "JSON": tuple(json.dumps(one, indent=indent).encode() for one in every for indent in (None, 1)),
        "YAML": (b"  - positions".join(yaml[: _POINTS + 1]),),
    }


def _trajectories(value: object) -> Iterator[dict[str, Any]]:
    """The objects with points, wherever they stand."""
    if isinstance(value, dict):
        if "points" in value and "joint_names" in value:
            yield value
        for part in value.values():
            yield from _trajectories(part)
    elif isinstance(value, list):
        for part in value:
            yield from _trajectories(part)


def _same(text: bytes, parse: Callable[[bytes, str], list[object]], path: Path) -> bool:
    """Every value put back where it stands leaves the text as it was, and so does what is written of it."""
    scalars = [scalar for document in parse(text, "x") for scalar in document.scalars()]  # type: ignore[attr-defined]
    same = edited(text, [Edit(s.start, s.end, text[s.start : s.end].decode("latin-1")) for s in scalars]) == text
    return same and bool(read_messages(path, text, cell()))
