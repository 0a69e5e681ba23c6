"""Readers of programs on damaged programs: no byte is lost, and nothing but a refusal is raised."""

from __future__ import annotations

import time
from collections.abc import Callable

from bumpstop.errors import InputError
from bumpstop.program.languages.krl import parse_krl, read_krl
from bumpstop.program.languages.message_syntax import parse_json, parse_yaml
from bumpstop.program.languages.rapid import parse_rapid, read_rapid
from bumpstop.program.languages.syntax import Edit, edited
from bumpstop.program.languages.urscript import parse_urscript, read_urscript
from program.corpora import EXAMPLES, KRL, RAPID, URSCRIPT, mutated
from validation.findings import Findings

TITLE = "Readers of programs on damaged programs"
RUNS = 1_000_000
# Of a message only some points: a whole one takes ten times as long to damage and to read.
_LETTERS = 900


def compare(findings: Findings, *, quick: bool, runs: int | None = None) -> None:
    """Every reader on programs that are cut, doubled, mixed and sprinkled with other bytes."""
    count = runs or (200 if quick else RUNS)
    json = (EXAMPLES / "planned.json").read_bytes()
    yaml = (EXAMPLES / "planned.yaml").read_bytes()
    messages = {"JSON": (json[:_LETTERS], json[-_LETTERS:]), "YAML": (yaml[:_LETTERS], yaml[-_LETTERS:])}
    readers: dict[str, tuple[tuple[bytes, ...], Callable[[bytes], bool]]] = {
        "URScript": (URSCRIPT, lambda text: parse_urscript(text).text() == text and bool(read_urscript(text))),
        "KRL": (KRL, lambda text: parse_krl(text).text() == text and bool(read_krl(text, text))),
        "RAPID": (RAPID, lambda text: parse_rapid(text).text() == text and bool(read_rapid(text))),
        "JSON": (messages["JSON"], lambda text: _same(text, parse_json)),
        "YAML": (messages["YAML"], lambda text: _same(text, parse_yaml)),
    }
    rows = []
    for name, (corpus, holds) in readers.items():
        begin, lost, raised, slowest = time.perf_counter(), 0, "", 0.0
        for seed in range(count):
            text = mutated(corpus, seed)
            start = time.perf_counter()
            try:
                lost += not holds(text)
            except InputError:
                pass  # a refusal
            except Exception as error:
                raised = raised or f"seed {seed}: {type(error).__name__}: {error}"
            slowest = max(slowest, time.perf_counter() - start)
        findings.check(f"{name}: {count} damaged programs, no byte lost", lost == 0, f"{lost} lost")
        findings.check(f"{name}: nothing but refusals", not raised, raised)
        rows.append([name, count, time.perf_counter() - begin, 1e3 * slowest])
    findings.table("Damaged programs", ["Reader", "Runs", "Time [s]", "Slowest [ms]"], ["", "d", ".1f", ".1f"], rows)


def _same(text: bytes, parse: Callable[[bytes, str], list[object]]) -> bool:
    """Every value put back where it stands leaves the text as it was."""
    scalars = [scalar for document in parse(text, "x") for scalar in document.scalars()]  # type: ignore[attr-defined]
    return edited(text, [Edit(s.start, s.end, text[s.start : s.end].decode("latin-1")) for s in scalars]) == text
