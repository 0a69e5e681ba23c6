"""Files of registers: TOML with ``[[situation]]`` rows, or CSV with one situation in a line."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bumpstop.collision.scenario.keys import value_of
from bumpstop.collision.scenario.scenario_words import as_written
from bumpstop.collision.scenario.uncertainty_table import flattened
from bumpstop.csv_table import read_csv_table
from bumpstop.errors import InputError, near_matches
from bumpstop.register.rows import Row, plain_keys, unknown_key_of_row
from bumpstop.register.statements import Statement, read_statements
from bumpstop.text_files import parse_toml, read_text

MAX_SITUATIONS = 10_000
_MAX_BYTES = 5_000_000
_WANTED = "wanted a register of contact situations (.toml or .csv)"
_OTHER_TABLES = (".xlsx", ".xls", ".ods", ".tsv")
_TOP_KEYS = ("scenario", "situation", "input")
# Cells that are texts, whatever they look like.
_TEXTS = ("name", "scenario", "frequency", "note", "link", "body", "kind")
_OF_CSV = "wanted a first line with the names of columns: scenario, name, body, speed_mm_s and others"


@dataclass(frozen=True)
class RegisterFile:
    """A register as it is written.

    Attributes:
        path: of the file.
        rows: its rows, not checked yet.
        scenario: path of the scenario that rows without one of their own stand on, relative to the file; empty: none.
        statements: where values come from.
        faults: of what is no row.
    """

    path: Path
    rows: list[Row]
    scenario: str = ""
    statements: Mapping[str, Statement] = field(default_factory=dict)
    faults: list[InputError] = field(default_factory=list)


def is_register(path: Path) -> bool:
    """Whether a file is a register and no scenario: CSV, or TOML with ``[[situation]]`` rows.

    A file that cannot be read is no register: whoever reads it as a scenario says what is wrong with it.

    Raises:
        InputError: it is called as tables are that cannot be read.
    """
    if path.suffix.lower() in _OTHER_TABLES:
        valid = f"{_WANTED} or a scenario (.toml); a spreadsheet is saved as CSV, UTF-8"
        raise InputError(str(path), "is neither .toml nor .csv", valid)
    if path.suffix.lower() == ".csv":
        return True
    if path.suffix.lower() != ".toml":
        return False
    try:
        return "situation" in parse_toml(read_text(path, _WANTED, max_bytes=_MAX_BYTES), str(path))
    except InputError:
        return False


def read_register(path: Path) -> RegisterFile:
    """Read a register; its rows are not checked yet.

    Raises:
        InputError: the file is absent, damaged or empty.
    """
    text = read_text(path, _WANTED, max_bytes=_MAX_BYTES)
    file = _read_csv(text, path) if path.suffix.lower() == ".csv" else _read_toml(text, path)
    if not 1 <= len(file.rows) <= MAX_SITUATIONS and not file.faults:
        raise InputError(str(path), f"has {len(file.rows)} situations", f"wanted 1 to {MAX_SITUATIONS}")
    return file


def _read_toml(text: str, path: Path) -> RegisterFile:
    data = parse_toml(text, str(path))
    faults = [
        InputError(f"{path}, {key}", "is no key of a register", near_matches(key, _TOP_KEYS))
        for key in data
        if key not in _TOP_KEYS
    ]
    scenario = data.get("scenario", "")
    if not isinstance(scenario, str):
        problem = f"{as_written(scenario)} cannot be used"
        faults.append(InputError(f"{path}, scenario", problem, "wanted the path of a scenario"))
        scenario = ""
    tables = data.get("situation", [])
    if not isinstance(tables, list) or not all(isinstance(table, Mapping) for table in tables):
        raise InputError(f"{path}, situation", "is not a list of tables", "begin each row with [[situation]]")
    statements, found = read_statements(data.get("input", []), str(path))
    rows: list[Row] = []
    for number, table in enumerate(tables, start=1):
        place, values = f"[[situation]] {number}", _dotted(table)
        rows.append(Row(path, place, dict(values)))
        # "contact.area_cm2" and contact.area_cm2 are two keys to TOML.
        twice = [key for key, count in Counter(key for key, _ in values).items() if count > 1]
        faults += [InputError(f"{path} {place}, {key}", "is given twice", "give it once") for key in twice]
    return RegisterFile(path, rows, scenario, statements, faults + found)


def _dotted(table: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Keys and values of a row; ``contact.area_cm2 = 2`` is a table to TOML."""
    found: list[tuple[str, Any]] = []
    for key, value in table.items():
        if not prefix and key == "uncertainty" and isinstance(value, Mapping):
            # Its keys are dotted themselves, and its values are tables.
            found += [(f"{key}.{name}", spec) for name, spec in flattened(value).items()]
        elif not prefix and key.startswith("uncertainty."):
            found.append((key, value))
        else:
            found += _dotted(value, f"{prefix}{key}.") if isinstance(value, Mapping) else [(prefix + key, value)]
    return found


def _read_csv(text: str, path: Path) -> RegisterFile:
    table = read_csv_table(text, path, _OF_CSV, "situation", known=plain_keys())
    names, where = table.names, f"{path} row {table.head_line}"
    for name in names:
        if not name or names.count(name) > 1:
            problem = "has a column without a name" if not name else f"has two columns {as_written(name)}"
            raise InputError(where, problem, _OF_CSV)
    for name in ("scenario", "name"):
        if name not in names:
            raise InputError(where, f"has no column {name!r}", _OF_CSV)
    # Of a column that nothing is called after, every row would say the same.
    strange = {name: fault for name in names if (fault := unknown_key_of_row(name)) is not None}
    faults = [InputError(f"{where}, {fault.field}", fault.problem, fault.valid) for fault in strange.values()]
    rows: list[Row] = []
    for number, row in table.rows:
        if isinstance(row, InputError):
            faults.append(row)
            continue
        filled = {name: _cell(name, cell) for name, cell in zip(names, row, strict=True) if cell.strip()}
        filled = {name: cell for name, cell in filled.items() if name not in strange}
        texts = {name: cell.strip() for name, cell in zip(names, row, strict=True)}
        rows.append(Row(path, f"row {number}", filled, texts))
    return RegisterFile(path, rows, faults=faults)


def _cell(name: str, text: str) -> Any:
    """What a cell says; lists are numbers with commas or spaces between them, in brackets or without."""
    if name in _TEXTS:
        return text.strip()
    value = value_of(text.strip())
    if isinstance(value, str) and len(parts := text.split()) > 1:
        value = value_of(",".join(parts)) if isinstance(value_of(",".join(parts)), list) else value
    return value
