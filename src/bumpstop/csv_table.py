"""Tables that people write as CSV: one row in each line, and no row that is passed over in silence."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bumpstop.errors import InputError

_NO_CONTENT = " \t,;"


@dataclass(frozen=True, kw_only=True)
class CsvTable:
    """A table as it is written.

    Attributes:
        head_line: number of the line with the names of columns, from 1.
        names: of the columns, not checked.
        delimiter: comma, semicolon or tab.
        rows: number of each line, and its cells, one for each column but those that may lack, or why it is no row.
    """

    head_line: int
    names: list[str]
    delimiter: str
    rows: list[tuple[int, list[str] | InputError]]


def read_csv_table(
    text: str, path: Path, wanted: str, row_in_words: str, may_lack: Sequence[str] = (), known: Sequence[str] = ()
) -> CsvTable:
    """Read a table; lines without content, and comments that begin with ``#`` and stand alone, are passed over.

    Each line is read by itself: a quotation mark that is not closed would swallow the rows after it.

    Args:
        text: of the file.
        path: of the file, as errors call it.
        wanted: what the file should have been.
        row_in_words: what a row stands for, ``situation``.
        may_lack: columns whose cells a row may leave out, where they are the last.
        known: names of columns, which count whatever the case of their letters: spreadsheets begin them with capitals.

    Raises:
        InputError: there is no head, or it is no CSV.
    """
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip(_NO_CONTENT)]
    heads = [(number, line) for number, line in lines if not _is_comment(line)]
    if not heads:
        raise InputError(str(path), "is empty", wanted)
    head_line, head = heads[0]
    delimiter = max((";", "\t", ","), key=lambda mark: (head.count(mark), mark == ";"))
    valid = f"wanted one {row_in_words} in each line"
    spelling = {name.casefold(): name for name in known}
    given = (name.strip() for name in cells_of(head, delimiter, f"{path} row {head_line}", valid))
    names = [spelling.get(name.casefold(), name) for name in given]
    least = len(names)
    while least > 0 and names[least - 1] in may_lack:
        least -= 1
    rows = [
        (number, row)
        for number, line in lines
        if number > head_line
        and (row := _row(line, delimiter, names, least, f"{path} row {number}", valid)) is not None
    ]
    return CsvTable(head_line=head_line, names=names, delimiter=delimiter, rows=rows)


def _row(
    line: str, delimiter: str, names: list[str], least: int, where: str, valid: str
) -> list[str] | InputError | None:
    """Its cells, or what is wrong with it; None for a comment."""
    if _is_comment(line):
        return None if _stands_alone(line, delimiter, len(names)) else _row_as_comment(where)
    try:
        cells = cells_of(line, delimiter, where, valid)
    except InputError as error:
        return error
    if least <= len(cells) <= len(names):
        return cells
    problem = f"has {len(cells)} cells, and there are {len(names)} columns"
    return InputError(
        where, problem, f"wanted one for each column; a cell that holds {delimiter!r} stands in quotation marks"
    )


def cells_of(line: str, delimiter: str, where: str, valid: str) -> list[str]:
    """The cells of one line, read by itself; an error says ``where``, and ``valid``: what would be."""
    try:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True, strict=True))
    except csv.Error as error:
        problem = f"is not valid CSV ({error})"
        if "unexpected end" in str(error):
            problem = "has a cell that goes on in the next line, or a quotation mark that is not closed"
        raise InputError(where, problem, valid) from None


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith("#")


def _stands_alone(comment: str, delimiter: str, columns: int) -> bool:
    """Whether a comment is no row that somebody called ``#2``; spreadsheets write it with empty cells behind it."""
    cells = comment.split(delimiter)
    return len(cells) < columns or not any(cell.strip() for cell in cells[1:])


def _row_as_comment(where: str) -> InputError:
    problem = "begins with '#' and has a cell for each column"
    valid = "remove the mark, or the row: only a comment that stands alone is passed over"
    return InputError(where, problem, valid)
