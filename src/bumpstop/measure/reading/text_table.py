"""Tables that people and devices write as text: separators, decimal commas and lines before the header are found."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from bumpstop.errors import InputError
from bumpstop.measure.reading.gauge_columns import is_unit
from bumpstop.measure.reading.written_numbers import DecimalMarks, ambiguous, as_number, decimal_mark
from bumpstop.text_files import MAX_BYTES, read_text

# Header lines of devices are at most so many.
_MAX_PREAMBLE = 200
# The last rows show what a row of the table is like.
_LATER_ROWS = 20
# The minus sign of typesetting before a number.
_MINUS = re.compile(r"^\u2212(?=[0-9.,]+$)")
_IN_BRACKETS = re.compile(r"\[.*\]|\(.*\)")
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")


@dataclass(frozen=True)
class TextTable:
    """Cells as they were written.

    Attributes:
        source: the file.
        names: of the columns, from the header; ``column 1`` and so on without one.
        rows: cells; every row as long as the header.
        preamble: lines above the header.
        beyond: cells that rows have beyond the header, by number of the row from 0.
        has_header: whether the names are those of the file.
    """

    source: str
    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    preamble: tuple[str, ...]
    beyond: dict[int, tuple[str, ...]]
    has_header: bool

    def cell(self, row: int, name: str) -> str:
        """Text of a cell."""
        return self.rows[row][self.names.index(name)]

    @cached_property
    def _marks(self) -> DecimalMarks:
        each = [DecimalMarks.of(texts) for texts in zip(*self.rows, strict=True)]
        return DecimalMarks(sum(marks.points for marks in each), sum(marks.commas for marks in each))

    def numbers(self, column: int) -> list[float]:
        """Cells of a column as numbers; NaN where they are none.

        Args:
            column: its number from 0.

        Raises:
            InputError: a mark may be a decimal one or stand between thousands.
        """
        texts = [row[column] for row in self.rows]
        mark = decimal_mark(texts, self._marks)
        if not mark:
            text = ambiguous(texts)
            raise InputError(
                f"{self.source}, column {self.names[column]!r}",
                f"{text!r} may be {re.sub('[.,]', '', text)} or have a decimal mark",
                "wanted one decimal mark in all columns, and no thousands marks",
            )
        return [as_number(text, mark) for text in texts]

    def refuse_long_rows(self, rows: Iterable[int]) -> None:
        """Refuse rows that have more cells than the header.

        Args:
            rows: their numbers, from 0.

        Raises:
            InputError: there is one.
        """
        for row in rows:
            count = len(self.names) + len(self.beyond[row])
            raise InputError(
                f"{self.source}, row {row + 1}",
                f"has {count} cells under {len(self.names)} columns",
                "wanted one cell for each column; numbers with decimal commas need semicolons between cells",
            )


def read_text_table(path: Path, wanted: str, *, max_bytes: int = MAX_BYTES) -> TextTable:
    """Read a table: comma, semicolon or tab between cells, decimal points or commas, text above the header.

    Args:
        path: of the file.
        wanted: what it should have been, as errors say it.
        max_bytes: longer files are refused.

    Raises:
        InputError: the file cannot be read, or holds no table.
    """
    text = read_text(path, wanted, max_bytes=max_bytes, of_device=True)
    lines = [line for line in text.splitlines() if line.strip(" \t,;")]
    if not lines:
        raise InputError(str(path), "is empty", wanted)
    separator = _separator(lines)
    try:
        reader = csv.reader(lines, delimiter=separator)
        ends, cells = [], []
        for row in reader:
            cells.append([_MINUS.sub("-", cell.strip()) for cell in row])
            ends.append(reader.line_num)
    except csv.Error as error:
        raise InputError(str(path), f"is not valid CSV ({error})", wanted) from None
    first = _first_numbers(cells)
    # A name may go on in the next line; a row that does has swallowed those after it.
    for number in range(max(first, 1), len(cells)):
        if ends[number] > ends[number - 1] + 1:
            line = lines[ends[number - 1]].strip()[:60]
            problem = f"has a quotation mark that is not closed, in {line!r}"
            raise InputError(f"{path}, row {number - first + 1}", problem, "wanted one row in each line")
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
    width = len(names)
    while names and not names[-1]:
        names = names[:-1]
    rows, beyond = [], {}
    for number, row in enumerate(cells[first:]):
        # Empty cells, as of a separator at the end, are beyond the header only where the header has none of them.
        if len(row) > max(len(names), width) or any(row[len(names) :]):
            beyond[number] = tuple(row[len(names) :])
        trimmed = row[: len(names)]
        rows.append(tuple(trimmed + [""] * (len(names) - len(trimmed))))
    above = cells[: header if header is not None else first]
    preamble = tuple(separator.join(row) for row in above)
    return TextTable(str(path), tuple(names), tuple(rows), preamble, beyond, header is not None)


def _separator(lines: list[str]) -> str:
    """That which is in all of the last lines, or in the first and in most of the last ones."""
    sample = lines[-50:]
    for mark in (";", "\t"):
        count = sum(mark in line for line in sample)
        if count == len(sample) or (mark in lines[0] and 2 * count > len(sample)):
            return mark
    return ","


def _first_numbers(cells: list[list[str]]) -> int:
    """First row whose cells begin with what is no name, and that later rows are like."""
    found = [i for i, row in enumerate(cells[:_MAX_PREAMBLE]) if _has_numbers(row, len(cells[0]) if i else -1)]
    first = next((i for i in found if _is_like_later(cells, i)), found[0] if found else min(1, len(cells)))
    # A cell of the first rows may be no number.
    while first - 1 in found and _may_begin(cells[first - 1], len(cells[first])):
        first -= 1
    return first


def _has_numbers(row: list[str], width: int) -> bool:
    """Whether half of the cells of a row are numbers, or two in a row of some width."""
    numbers = sum(bool(_NUMBER.fullmatch(cell)) for cell in row)
    named = sum(bool(cell) for cell in row) - numbers
    return (numbers > 0 and numbers >= named) or (numbers >= 2 and len(row) == width)


def _is_like_later(cells: list[list[str]], row: int) -> bool:
    """Whether a row has numbers where most of the last rows have some; one without later rows is as good as any."""
    later = cells[row + 1 :][-_LATER_ROWS:]
    return 2 * sum(_are_alike(cells[row], other) for other in later) >= len(later)


def _are_alike(row: list[str], other: list[str]) -> bool:
    both = [(a, b) for a, b in zip(row, other, strict=False) if a and b]
    longest = max(sum(map(bool, row)), sum(map(bool, other)))
    return 2 * len(both) > longest and all(is_figure(a) == is_figure(b) for a, b in both)


def _may_begin(row: list[str], width: int) -> bool:
    return len(row) == width and (is_figure(row[0]) or sum(map(is_figure, row)) >= 2)


def is_figure(cell: str) -> bool:
    """Whether a cell is a number, with or without thousands marks."""
    return re.fullmatch(r"[+-]?[.,]?[0-9][0-9., '\u00a0\u202f\u2019]*([eE][+-]?[0-9]+)?", cell) is not None


def _is_units(row: list[str]) -> bool:
    """Whether most cells of a row are units; what stands in brackets is one of something else."""
    filled = [cell for cell in row if cell]
    known = sum(map(is_unit, filled))
    others = sum(_IN_BRACKETS.fullmatch(cell) is not None and not is_unit(cell) for cell in filled)
    return known > 0 and 2 * (known + others) > len(filled)
