"""CSV and its relatives: any of the usual separators, with or without names, rows of wrong length set aside."""

from __future__ import annotations

import codecs
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.recording.formats.table import Table, side_by_side

if TYPE_CHECKING:
    import polars as pl

WRONG_COUNT = "wrong field count"
_BOM = b"\xef\xbb\xbf"
_OF_SPREADSHEETS = re.compile(rb'\s*"?sep=.?"?\s*', re.IGNORECASE)  # tells them the separator, above the header
_AT_ONCE = 1 << 18  # bytes whose marks are looked for


def read_delimited(path: Path, header: bool | None) -> Table:
    """Take a text file apart.

    Args:
        path: of the file.
        header: whether its first line holds names; None: when most of its fields are no numbers.

    Raises:
        InputError: empty, not text, or without any row of data.
    """
    body = path.read_bytes().removeprefix(_BOM)
    if body.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        body = body.decode("utf-16", errors="replace").encode()
    if b"\r" in body:
        body = body.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"\0" in body[:4096]:
        raise InputError(str(path), "is not a text file", "wanted CSV in UTF-8, UTF-16 with its mark, or Windows-1252")
    skipped, first = _first_line(body)
    if not first.strip():
        raise InputError(str(path), "is empty", "wanted rows of numbers")
    separator = _separator(first)
    names: tuple[str, ...] = ()
    fields = _fields(first.lstrip(b"#").strip() if first.startswith(b"#") else first, separator)
    if header or (header is None and not are_numbers(fields)):
        names = tuple(text.strip().strip('"') for text in fields)
        skipped += 1
    start = _line_start(body, skipped)
    # Anywhere: an arm that stands still at first may have written whole numbers until then. Points are read as ever.
    decimal_comma = separator in (b";", b"\t") and body.find(b",", start) >= 0
    if any(mark in body for mark in (b'"', b" ", *(() if separator == b"\t" else (b"\t",)))):
        body, start = _bare(_commas_in_quotes(body[start:], separator, path, skipped), separator), 0
    return _split(path, body, start, separator, names, skipped, decimal_comma)


def _line_start(body: bytes, line: int) -> int:
    """Where a line begins, numbered from 0; the end where there are not so many."""
    start = 0
    for _ in range(line):
        start = body.find(b"\n", start) + 1
        if start == 0:
            return len(body)
    return start


def _bare(body: bytes, separator: bytes) -> bytes:
    """Text without what may stand about numbers: blanks and quotes.

    A blank between two numbers stays, where something else separates fields: together they would be a third.
    """
    if separator == b" ":
        body = re.sub(rb"[ \t]+", b" ", re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", body))
    else:
        # Mostly that is all of them, and the pattern below would take long over columns that are aligned.
        while b"  " in body:
            body = body.replace(b"  ", b" ")
        for mark in (separator, b"\n"):
            body = body.replace(mark + b" ", mark).replace(b" " + mark, mark)
        body = body.strip(b" ")
        blank = b" " if separator == b"\t" else b" \t"
        if b" " in body or (separator != b"\t" and b"\t" in body):
            about = rb"(?<![0-9.%b])[%b]++|(?<![%b])[%b]++(?![0-9.+-])" % ((blank,) * 4)
            body = re.sub(about, b"", body)
    return body.replace(b'"', b"")


def _commas_in_quotes(body: bytes, separator: bytes, path: Path, skipped: int) -> bytes:
    """Text whose quoted fields hold no separator: without their quotes they would be several.

    Raises:
        InputError: such a field is a number, as with decimal commas: which number, nobody can know.
    """
    if b'"' not in body or separator == b" ":
        return body

    def without(found: re.Match[bytes]) -> bytes:
        inside = found[1]
        if re.fullmatch(rb"[-+0-9.,eE ]*[0-9][-+0-9.,eE ]*", inside):
            line = skipped + body.count(b"\n", 0, found.start()) + 1
            raise InputError(
                f"{path} line {line}",
                f"the quoted field {inside.decode()!r} holds a {separator.decode()!r}, which separates fields here",
                "wanted decimal points, or semicolons or tabs between fields",
            )
        return b'"' + inside.replace(separator, b" ") + b'"'

    # From the beginning of a field on: what stands between two quoted fields is not quoted.
    mark = re.escape(separator)
    return re.sub(rb'(?m)(?:^|(?<=%b))(?: *)"([^"\n%b]*%b[^"\n]*)"' % (mark, mark, mark), without, body)


def _split(
    path: Path, body: bytes, start: int, separator: bytes, names: tuple[str, ...], skipped: int, comma: bool
) -> Table:
    """Find the rows that have as many fields as the header, or as most rows have where there is none.

    ``start``: where the first of them begins, after ``skipped`` lines.
    """
    if len(body) > start and not body.endswith(b"\n"):
        body += b"\n"
    data = np.frombuffer(body, dtype=np.uint8)[start:]
    ends, counts = _lines(data, separator)
    filled = np.diff(ends, prepend=-1) > 1
    if not filled.any():
        raise InputError(str(path), "has no row of data", "wanted rows of numbers")
    usual = int(np.bincount(counts[filled]).argmax())
    width = len(names) or usual
    if names and usual != width:
        raise InputError(
            str(path),
            f"line {skipped} names {width} columns, most rows have {usual}",
            "wanted the names of the columns above the rows; what stands above these, delete or begin with #",
        )
    good = filled & (counts == width)
    lines = np.arange(1, ends.size + 1) + skipped
    if not good.all():
        body, start = data[np.repeat(good, np.diff(ends, prepend=-1))].tobytes(), 0
    bad = np.flatnonzero(filled & ~good)
    top = _fields(_first_good(data, ends, good), separator)

    def fetch(wanted: list[int]) -> FloatArray:
        before = body.count(b"\n", 0, start)
        if comma:
            texts = _columns(body, before, separator, width, wanted, decimal_comma=False, numbers=False)
            for i, text in zip(wanted, texts, strict=True):
                _refuse_thousands(text, path, repr(names[i]) if names else str(i + 1))
        columns = _columns(body, before, separator, width, wanted, decimal_comma=comma, numbers=True)
        return side_by_side(columns)

    return Table(
        names=names,
        width=width,
        rows=lines[good],
        filled=lines[filled],
        numbered="line",
        fetch=fetch,
        faults=tuple((int(lines[i]), f"{WRONG_COUNT}: {counts[i]}, not {width}") for i in bad),
        text_row=tuple(top) if are_text(top) else (),
    )


def _first_good(data: npt.NDArray[np.uint8], ends: npt.NDArray[np.int64], good: npt.NDArray[np.bool_]) -> bytes:
    """The first line that is one."""
    at = int(np.argmax(good))
    return data[int(ends[at - 1]) + 1 if at else 0 : int(ends[at])].tobytes() if good[at] else b""


def _lines(data: npt.NDArray[np.uint8], separator: bytes) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Where lines end, and how many fields each has; a piece of the text at a time, which stays in the cache."""
    ends, marks, before = [], [], 0
    for start in range(0, data.size, _AT_ONCE):
        piece = data[start : start + _AT_ONCE]
        places = np.flatnonzero((piece == separator[0]) | (piece == ord("\n")))
        last = np.flatnonzero(piece[places] == ord("\n"))
        ends.append(places[last] + start)
        marks.append(last + before)
        before += places.size
    if not ends:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    upto = np.concatenate([[-1], *marks])
    return np.concatenate(ends), upto[1:] - upto[:-1]


def _refuse_thousands(text: pl.Series, path: Path, column: str) -> None:
    """Refuse a column whose numbers have marks of thousands: 1.012 beside 987 is 1012, and would be read as 1.012.

    Raises:
        InputError: every number with a mark has three digits behind it, beside whole ones of three digits; or one has
            marks of both kinds.
    """
    marked = text.filter(text.str.contains(r"[.,]"))
    both = marked.filter(marked.str.contains(r"\d[.,'\s]\d{3}(?:[.,'\s]\d{3})*[.,]\d") & ~_as_groups(marked))
    whole = text.str.contains(r"^[+-]?[1-9]\d\d$").any() and _as_groups(marked).all()
    found = both if both.len() else marked if whole else marked.clear()
    if found.len():
        raise InputError(
            str(path),
            f"column {column} has {found[0]}: is that a mark of thousands?",
            "wanted numbers without such marks",
        )


def _as_groups(text: pl.Series) -> pl.Series:
    return text.str.contains(r"^[+-]?[1-9]\d{0,2}(?:\.\d{3})+$|^[+-]?[1-9]\d{0,2}(?:,\d{3})+$")


def _columns(
    body: bytes, skipped: int, separator: bytes, width: int, wanted: list[int], *, decimal_comma: bool, numbers: bool
) -> list[pl.Series]:
    """Columns of rows that all have ``width`` fields, after so many lines that are left out; as numbers or as text."""
    import polars as pl

    labels = [str(i) for i in range(width)]
    table = pl.read_csv(
        body,
        has_header=False,
        skip_lines=skipped,
        separator=separator.decode(),
        quote_char=None,
        # Text, not Float64, for columns that are not used: they need not hold numbers.
        schema={label: pl.Float64 if numbers and i in wanted else pl.String for i, label in enumerate(labels)},
        columns=sorted(set(wanted)),
        ignore_errors=True,
        encoding="utf8-lossy",
        decimal_comma=decimal_comma,
    )
    return [table[labels[i]] for i in wanted]


def _first_line(body: bytes) -> tuple[int, bytes]:
    """Number of lines before the first that counts, and that line: the last of the comments, if names stand there."""
    skipped, start, comment = 0, 0, b""
    while start < len(body):
        end = body.find(b"\n", start)
        line = body[start : end if end >= 0 else len(body)]
        if line.strip() and not line.lstrip().startswith(b"#") and not _OF_SPREADSHEETS.fullmatch(line):
            separator = _separator(line)
            fields, named = _fields(line, separator), _fields(comment.lstrip(b"#").strip(), separator)
            if comment and len(named) == len(fields) and are_numbers(fields):
                return skipped - 1, comment
            return skipped, line
        comment = line if line.lstrip().startswith(b"#") else comment
        skipped += 1
        start = end + 1 if end >= 0 else len(body)
    return skipped, b""


def _separator(line: bytes) -> bytes:
    for mark in (b";", b"\t", b","):
        if mark in line:
            return mark
    return b" " if b" " in line.strip() else b","


def _fields(line: bytes, separator: bytes) -> list[str]:
    try:
        text = line.decode("utf-8")
    except UnicodeDecodeError:  # programs of instruments on Windows write Windows-1252
        text = line.decode("cp1252", errors="replace")
    return text.split() if separator == b" " else text.split(separator.decode())


def are_numbers(fields: list[str]) -> bool:
    """Whether this is a row of data: at least half are numbers, as single ones may be garbage."""
    return 2 * sum(map(_is_number, fields)) >= len(fields)


def are_text(fields: list[str]) -> bool:
    """Whether nothing in a row is a number, and something stands there."""
    filled = [text for text in fields if text.strip()]
    return bool(filled) and not any(map(_is_number, filled))


def _is_number(text: str) -> bool:
    try:
        float(text.strip().strip('"').replace(",", "."))
    except ValueError:
        return False
    return True
