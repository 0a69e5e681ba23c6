"""What a register states about the values of its scenarios: how well they are known, and where they come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bumpstop.collision.scenario.scenario_words import as_written
from bumpstop.errors import InputError, near_matches

STATUSES = ("measured", "identified", "published", "agreed", "assumed", "unverified")
"""How well a value is known; ``assumed`` and ``unverified`` keep a situation from passing."""
OPEN_STATUSES = ("assumed", "unverified")

_KEYS = ("key", "status", "source")


@dataclass(frozen=True)
class Statement:
    """How well a value is known.

    Attributes:
        status: one of :data:`STATUSES`.
        source: where it comes from, in words; empty: not told.
    """

    status: str
    source: str = ""


def read_statements(rows: Any, file: str) -> tuple[dict[str, Statement], list[InputError]]:
    """The ``[[input]]`` rows of a register by their keys, and what is wrong with them.

    Args:
        rows: what the file has under ``input``.
        file: how messages call it.
    """
    if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
        return {}, [InputError(f"{file} input", "is not a list of tables", "begin each row with [[input]]")]
    found: dict[str, Statement] = {}
    faults: list[InputError] = []
    for number, row in enumerate(rows, start=1):
        where = f"{file} [[input]] {number}"
        here = [
            InputError(f"{where} {key}", "is not a key of an input", near_matches(str(key), _KEYS))
            for key in row
            if key not in _KEYS
        ]
        key, status, source = row.get("key"), row.get("status"), row.get("source", "")
        if not isinstance(key, str) or not is_scenario_key(key):
            valid = "wanted a key or a table of a scenario, such as detector.thresholds_Nm or detector"
            here.append(InputError(f"{where} key", _problem(key), valid))
        elif key in found:
            here.append(InputError(f"{where} key", f"{key!r} has two rows", "wanted one row for a key"))
        if status not in STATUSES:
            here.append(InputError(f"{where} status", _problem(status), f"valid: {', '.join(STATUSES)}"))
        if not isinstance(source, str):
            here.append(InputError(f"{where} source", _problem(source), "wanted a text"))
        if not here:
            found[str(key)] = Statement(str(status), source)
        faults += here
    return found, faults


def is_scenario_key(key: str) -> bool:
    """Whether a dotted key, or a table, is one of a scenario."""
    from bumpstop.collision.scenario.scenario import Scenario

    table, _, name = key.partition(".")
    field = Scenario.model_fields.get(table)
    if field is None or table == "folder":
        return False
    return not name or name in getattr(field.annotation, "model_fields", {})


def _problem(value: Any) -> str:
    return "is missing" if value is None else f"{as_written(value)} cannot be used"
