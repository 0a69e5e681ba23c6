"""CSV and its relatives: any of the usual separators, with or without names, rows of wrong length set aside."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.recording.table import Table

WRONG_COUNT = "wrong field count"
_BOM = b"\xef\xbb\xbf"


def read_delimited(path: Path, header: bool | None) -> Table:
    """Take a text file apart.

    Args:
        path: of the file.
        header: whether its first line holds names; None: when most of its fields are no numbers.

    Raises:
        InputError: empty, not text, or without any row of data.
    """
    body = path.read_bytes().removeprefix(_BOM).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"\0" in body[:4096]:
        raise InputError(str(path), "is not a text file", "wanted CSV")
    skipped, first = _first_line(body)
    if not first.strip():
        raise InputError(str(path), "is empty", "wanted rows of numbers")
    separator = _separator(first)
    names: tuple[str, ...] = ()
    fields = _fields(first.lstrip(b"#").strip() if first.startswith(b"#") else first, separator)
    if header or (header is None and not _are_numbers(fields)):
        names = tuple(text.strip().strip('"') for text in fields)
        start = body.index(first) + len(first) + 1
        body = body[start:]
        skipped += 1
    decimal_comma = separator == b";" and b"," in body[:4096]
    if separator == b" ":
        body = re.sub(rb"[ \t]+", b" ", re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", body))
    else:
        body = body.replace(b" ", b"") if separator == b"\t" else body.replace(b" ", b"").replace(b"\t", b"")
    body = body.replace(b'"', b"")
    return _split(path, body, separator, names, skipped, decimal_comma)


def _split(path: Path, body: bytes, separator: bytes, names: tuple[str, ...], skipped: int, comma: bool) -> Table:
    """Find the rows that have as many fields as the header, or as most rows have where there is none."""
    if body and not body.endswith(b"\n"):
        body += b"\n"
    data = np.frombuffer(body, dtype=np.uint8)
    ends = np.flatnonzero(data == ord("\n"))
    starts = np.concatenate([[0], ends[:-1] + 1]) if ends.size else ends
    marks = np.flatnonzero(data == separator[0])
    counts = np.searchsorted(marks, ends) - np.searchsorted(marks, starts) + 1
    filled = ends > starts
    if not filled.any():
        raise InputError(str(path), "has no row of data", "wanted rows of numbers")
    usual = int(np.bincount(counts[filled]).argmax())
    width = len(names) or usual
    if names and usual != width:
        raise InputError(str(path), f"the header names {width} columns, most rows have {usual}")
    good = filled & (counts == width)
    numbers = np.arange(1, ends.size + 1) + skipped
    if not good.all():
        body = data[np.repeat(good, ends - starts + 1)].tobytes()
    bad = np.flatnonzero(filled & ~good)

    def fetch(wanted: list[int]) -> FloatArray:
        return _parse(body, separator, width, wanted, comma)

    return Table(
        names=names,
        width=width,
        rows=numbers[good],
        first_row=skipped + 1,
        rows_read=int(filled.sum()),
        numbered="line",
        fetch=fetch,
        faults=tuple((int(numbers[i]), f"{WRONG_COUNT}: {counts[i]}, not {width}") for i in bad),
    )


def _parse(body: bytes, separator: bytes, width: int, wanted: list[int], comma: bool) -> FloatArray:
    import polars as pl

    labels = [str(i) for i in range(width)]
    table = pl.read_csv(
        body,
        has_header=False,
        separator=separator.decode(),
        quote_char=None,
        # Text, not Float64, for the columns that nobody wants: they need not hold numbers.
        schema={label: pl.Float64 if i in wanted else pl.String for i, label in enumerate(labels)},
        columns=sorted(set(wanted)),
        ignore_errors=True,
        encoding="utf8-lossy",
        decimal_comma=comma,
    )
    return np.stack([table[labels[i]].fill_null(np.nan).to_numpy() for i in wanted], axis=1)


def _first_line(body: bytes) -> tuple[int, bytes]:
    """Number of lines before the first that counts, and that line: the last of the comments, if names stand there."""
    skipped, start, comment = 0, 0, b""
    while start < len(body):
        end = body.find(b"\n", start)
        line = body[start : end if end >= 0 else len(body)]
        if line.strip() and not line.lstrip().startswith(b"#"):
            separator = _separator(line)
            fields, named = _fields(line, separator), _fields(comment.lstrip(b"#").strip(), separator)
            if comment and len(named) == len(fields) and _are_numbers(fields):
                return skipped - 1, comment
            return skipped, line
        comment = line if line.strip() else comment
        skipped += 1
        start = end + 1 if end >= 0 else len(body)
    return skipped, b""


def _separator(line: bytes) -> bytes:
    for mark in (b";", b"\t", b","):
        if mark in line:
            return mark
    return b" " if b" " in line.strip() else b","


def _fields(line: bytes, separator: bytes) -> list[str]:
    text = line.decode("utf-8", errors="replace")
    return text.split() if separator == b" " else text.split(separator.decode())


def _are_numbers(fields: list[str]) -> bool:
    """Whether this is a row of data: at least half are numbers, as single ones may be garbage."""
    found = 0
    for text in fields:
        try:
            float(text.strip().strip('"').replace(",", "."))
        except ValueError:
            continue
        found += 1
    return 2 * found >= len(fields)
