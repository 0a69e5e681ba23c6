"""Labels: when something really touched the arm."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bumpstop.csv_table import read_csv_table
from bumpstop.errors import InputError
from bumpstop.text_files import read_text

_WANTED = "wanted CSV with the header start_s,end_s or start_s,end_s,kind"


@dataclass(frozen=True)
class Label:
    """One contact.

    Attributes:
        start_s, end_s: from first touch to release, in the time of the recording [s].
        kind: what it was; may be empty.
    """

    start_s: float
    end_s: float
    kind: str = ""


def time_text(t: float) -> str:
    """A time as people are told it [s]: to a tenth of a millisecond, also where the clock counts from long ago."""
    return f"{t:.4f}".rstrip("0").rstrip(".") if abs(t) < 1e10 else f"{t:.15g}"


def load_labels(path: str | Path) -> tuple[Label, ...]:
    """Read labels, in order of time: CSV with the header ``start_s,end_s[,kind]``.

    Raises:
        InputError: the file cannot be read, its header is another, or a line holds no contact: a missing or non-finite
            time, an end that is not after the start, or contacts that overlap.
    """
    known = ["start_s", "end_s", "kind"]
    table = read_csv_table(read_text(path, _WANTED), Path(path), _WANTED, "contact", may_lack=("kind",), known=known)
    if table.names not in (known[:2], known):
        raise InputError(str(path), f"has the header {table.delimiter.join(table.names)[:80]!r}", _WANTED)
    labels = []
    for number, cells in table.rows:
        where = f"{path} row {number}"
        if isinstance(cells, InputError):
            raise cells
        start, end = (_time(cell, where) for cell in cells[:2])
        labels.append(Label(start, end, cells[2].strip() if len(cells) > 2 else ""))
    return checked_labels(labels, str(path))


def checked_labels(labels: Sequence[Label], where: str = "labels") -> tuple[Label, ...]:
    """Labels in order of time; an end that is not after its start and overlapping contacts are refused."""
    ordered = tuple(sorted(labels, key=lambda label: label.start_s))
    for label in ordered:
        if not label.start_s < label.end_s:
            raise InputError(
                where,
                f"a contact from {time_text(label.start_s)} to {time_text(label.end_s)} s",
                "wanted an end after its start",
            )
    for before, after in itertools.pairwise(ordered):
        if after.start_s < before.end_s:
            raise InputError(
                where,
                f"the contact at {time_text(after.start_s)} s begins before that at {time_text(before.start_s)} s ends",
                "wanted contacts one after the other",
            )
    return ordered


def _time(cell: str, where: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(where, f"{cell.strip()[:40]!r} is no time", "wanted seconds")
    return value
