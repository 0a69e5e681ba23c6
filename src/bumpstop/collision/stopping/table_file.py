"""Files of stopping distances: CSV with a header, or TOML with columns and rows."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bumpstop.collision.stopping.stopping_table import StoppingTable
from bumpstop.collision.stopping.table_cells import number_of
from bumpstop.collision.stopping.table_reader import EXAMPLE, FULL_SPEED, STATED, WANTED, TableReader
from bumpstop.csv_table import cells_of
from bumpstop.errors import InputError
from bumpstop.text_files import as_path, parse_toml, read_text


def load_stopping_table(
    path: str | os.PathLike[str],
    *,
    full_speed_deg_s: float | Sequence[float] | None = None,
    reach_mm: float | None = None,
    category: int | None = None,
) -> StoppingTable:
    """Read a table of stopping distances.

    Columns are found by their names, in any order: ``payload``, ``extension``, ``speed``, and ``distance`` and
    ``time`` with the number of a joint, each with its unit; or one ``joint`` column beside one ``distance``.

    Args:
        path: .csv (comma, semicolon or tab) or .toml (``columns`` and ``rows``, or ``[[row]]`` tables).
        full_speed_deg_s: of the joints at 100 %, one for all or one for each; None: as the file states it.
        reach_mm: turns distances of the tool centre point in mm into angles at the extension; None: as the file says.
        category: read the rows and columns of this stop category alone; None: the file must have one only.

    Returns:
        The checked table; see :meth:`StoppingTable.checked` for what is refused.

    Raises:
        InputError: the file cannot be read, a column has no unit, a value is none or out of range; names row and
            column.
    """
    file = as_path(path, "table")
    names, cells, stated = _read(file)
    if full_speed_deg_s is not None:
        stated = {key: value for key, value in stated.items() if key not in FULL_SPEED}
        stated["full_speed_deg_s"] = full_speed_deg_s
    if reach_mm is not None:
        stated["reach_mm"] = reach_mm
    return TableReader(str(path), names, cells, stated).table(category)


def _read(path: Path) -> tuple[list[str], list[list[Any]], dict[str, Any]]:
    """Names, rows and what is stated beside them."""
    kind = path.suffix.lower()
    if kind not in (".csv", ".tsv", ".txt", ".toml"):
        raise InputError(str(path), f"has the extension {kind!r}", WANTED)
    text = read_text(path, WANTED)
    return _read_toml(text, str(path)) if kind == ".toml" else _read_csv(text, str(path))


def _read_toml(text: str, name: str) -> tuple[list[str], list[list[Any]], dict[str, Any]]:
    data = parse_toml(text, name)
    tables = [value for value in data.values() if isinstance(value, Mapping)]
    # A table of one's own name around everything is as good.
    if "rows" not in data and "row" not in data and len(tables) == 1:
        data = dict(tables[0])
    rows = data.get("rows", data.get("row"))
    if not isinstance(rows, list) or not rows:
        raise InputError(f"{name}, rows", "are missing", "wanted columns = [names] and rows = [[...], ...]")
    stated = {key: data[key] for key in STATED if key in data}
    if all(isinstance(row, Mapping) for row in rows):
        names = list(dict.fromkeys(key for row in rows for key in row))
        return names, [[row.get(key) for key in names] for row in rows], stated
    columns = data.get("columns")
    if not isinstance(columns, list) or not all(isinstance(column, str) for column in columns):
        raise InputError(f"{name}, columns", "are missing", f"wanted a list of names with units: {EXAMPLE}")
    if not all(isinstance(row, list) for row in rows):
        raise InputError(f"{name}, rows", "hold something else than lists", "wanted rows = [[...], ...]")
    return list(columns), [list(row) for row in rows], stated


def _read_csv(text: str, name: str) -> tuple[list[str], list[list[Any]], dict[str, Any]]:
    comments, lines = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.lstrip().startswith("#"):
            comments.append(line.strip())
        elif line.strip(" \t,;"):
            lines.append((number, line))
    if not lines:
        raise InputError(name, "is empty", WANTED)
    delimiter = max((";", "\t", ","), key=lambda mark: (lines[0][1].count(mark), mark == ";"))
    stated = _stated(comments, decimal_commas=delimiter != ",", name=name)
    valid = "wanted one row in each line"
    rows = [cells_of(line, delimiter, f"{name} line {number}", valid) for number, line in lines]
    # Spreadsheets write empty columns behind the last one.
    width = max((place for row in rows for place, cell in enumerate(row, start=1) if cell.strip()), default=1)
    rows = [row[:width] for row in rows]
    if delimiter != ",":
        rows[1:] = [[cell.replace(",", ".") for cell in row] for row in rows[1:]]
    return [cell.strip() for cell in rows[0]], [list(row) for row in rows[1:]], stated


def _stated(comments: list[str], *, decimal_commas: bool, name: str) -> dict[str, Any]:
    """What comments state: a number, or a list of them; a comma inside a number is that of its file's cells."""
    stated: dict[str, Any] = {}
    for line in comments:
        said = re.match(r"#\s*(\w+)\s*[=:]\s*(.+)", line)
        if said and said[1] in STATED:
            text = re.sub(r"(?<=\d),(?=\d)", ".", said[2]) if decimal_commas else said[2]
            numbers = [number_of(part) for part in re.split(r"[\s,;]+", text.strip("[] "))]
            if any(part is None for part in numbers):
                raise InputError(f"{name}, {said[1]}", f"{said[2]!r} is no number", "wanted one, or one by joint")
            stated[said[1]] = numbers[0] if len(numbers) == 1 else numbers
    return stated
