"""Tables that people and devices write as text: separators, decimal commas and lines before the header are found."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path

from bumpstop.errors import InputError
from bumpstop.text_files import MAX_BYTES, read_text

_SEPARATORS = (";", "\t", ",")
# Header lines of devices are at most so many.
_MAX_PREAMBLE = 200
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")


@dataclass(frozen=True)
class TextTable:
    """Cells as they were written.

    Attributes:
        names: of the columns, from the header; ``column 1`` and so on without one.
        rows: cells; every row as long as the header.
        preamble: lines above the header.
        decimal_comma: whether numbers have commas for points.
        ragged: rows that were shorter or longer than the header.
        has_header: whether the names are those of the file.
    """

    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    preamble: tuple[str, ...]
    decimal_comma: bool
    ragged: int
    has_header: bool

    def cell(self, row: int, name: str) -> str:
        """Text of a cell."""
        return self.rows[row][self.names.index(name)]

    def number(self, text: str) -> float:
        """A cell as a number; NaN where it is none."""
        return as_number(text, self.decimal_comma)


def as_number(text: str, decimal_comma: bool) -> float:
    """A number as a device writes it; NaN where it is none."""
    text = text.strip().strip('"')
    if decimal_comma:
        text = text.replace(".", "").replace(",", ".") if text.count(",") == 1 else text
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def read_text_table(path: Path, wanted: str, *, max_bytes: int = MAX_BYTES) -> TextTable:
    """Read a table: comma, semicolon or tab between cells, decimal points or commas, text above the header.

    Args:
        path: of the file.
        wanted: what it should have been, as errors say it.
        max_bytes: longer files are refused.

    Raises:
        InputError: the file cannot be read, or holds no table.
    """
    lines = [line for line in read_text(path, wanted, max_bytes=max_bytes).splitlines() if line.strip(" \t,;")]
    if not lines:
        raise InputError(str(path), "is empty", wanted)
    separator = _separator(lines)
    try:
        cells = [[cell.strip() for cell in row] for row in csv.reader(lines, delimiter=separator)]
    except csv.Error as error:
        raise InputError(str(path), f"is not valid CSV ({error})", wanted) from None
    first = _first_numbers(cells)
    comma = separator != "," and _has_decimal_commas(cells[first:])
    named = first > 0 and first < len(cells) and len(cells[first - 1]) >= min(2, len(cells[first]))
    header = first - 1 if named else None
    if header is None and first < len(cells):
        names = [f"column {i + 1}" for i in range(len(cells[first]))]
    elif header is None:
        raise InputError(str(path), "holds no numbers", wanted)
    else:
        names = cells[header]
        # A line of units below the names.
        if header > 0 and _is_units(cells[header]) and len(cells[header - 1]) == len(cells[header]):
            names = [f"{name} [{unit.strip('[]()')}]" for name, unit in zip(cells[header - 1], names, strict=True)]
            header -= 1
    while names and not names[-1]:
        names = names[:-1]
    rows, ragged = [], 0
    for row in cells[first:]:
        trimmed = row[: len(names)]
        if len(trimmed) < len(names) or any(row[len(names) :]):
            ragged += 1
        rows.append(tuple(trimmed + [""] * (len(names) - len(trimmed))))
    above = cells[: header if header is not None else first]
    return TextTable(
        tuple(names), tuple(rows), tuple(separator.join(row) for row in above), comma, ragged, header is not None
    )


def _separator(lines: list[str]) -> str:
    """That which most of the last lines agree on."""
    sample = lines[-50:]
    counts = {mark: min(line.count(mark) for line in sample) for mark in _SEPARATORS}
    for mark in (";", "\t"):
        if counts[mark] > 0 or lines[0].count(mark) > 0:
            return mark
    return ","


def _first_numbers(cells: list[list[str]]) -> int:
    """First row whose cells begin with what is no name."""
    for i, row in enumerate(cells[:_MAX_PREAMBLE]):
        numbers = sum(bool(_NUMBER.fullmatch(cell)) for cell in row)
        if numbers and numbers >= sum(bool(cell) for cell in row) - numbers:
            return i
        if numbers >= 2 and i > 0 and len(row) == len(cells[0]):
            return i
    return min(1, len(cells))


def _has_decimal_commas(rows: list[list[str]]) -> bool:
    return any(re.fullmatch(r"[+-]?\d*,\d+([eE][+-]?\d+)?", cell) for row in rows[:200] for cell in row)


def _is_units(row: list[str]) -> bool:
    known = {"s", "ms", "us", "µs", "n", "kn", "lbf", "lb", "n/cm2", "n/cm²", "mpa", "psi", "kpa", "bar", "sec"}
    filled = [cell.strip("[]() ").lower() for cell in row if cell]
    return bool(filled) and all(cell in known for cell in filled)
