"""What a comparison finds: checks, tables, pictures and words, in the order in which they are told."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from bumpstop.report.markup import Html
from bumpstop.report.picture import Picture

# A cell of a table: text, a number, or None where there is none.
Cell = str | float | int | bool | None

# Format of a column of probabilities, see :func:`probability`.
PROBABILITY = "probability"


@dataclass(frozen=True)
class Check:
    """One statement that is true or not.

    Attributes:
        what: the statement.
        passed: whether it holds.
        detail: the figures that decided it.
    """

    what: str
    passed: bool
    detail: str

    @property
    def line(self) -> str:
        """The check as it is printed."""
        return f"{'PASS' if self.passed else 'FAIL'}  {self.what}" + (f": {self.detail}" if self.detail else "")


@dataclass(frozen=True)
class Table:
    """Rows of raw values, and how to show them.

    Attributes:
        caption: what the table holds.
        headings: one per column, with units.
        formats: one per column, as :func:`format` takes them, or :data:`PROBABILITY`; text is shown as it is.
        rows: cells, one per column; the first names the row.
    """

    caption: str
    headings: Sequence[str]
    formats: Sequence[str]
    rows: Sequence[Sequence[Cell]]

    def shown(self) -> list[list[str]]:
        """The rows as text."""
        return [[show(cell, spec) for cell, spec in zip(row, self.formats, strict=True)] for row in self.rows]


@dataclass
class Findings:
    """Everything one comparison has to say.

    Attributes:
        name: as ``--only`` takes it.
        title: heading of its section.
        items: checks, tables, drawn pictures (Html) and paragraphs (str), in order.
        figures: numbers for ``results.json`` that no table holds.
        seconds: how long it took.
    """

    name: str
    title: str
    items: list[Check | Table | Html | str] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0

    def say(self, text: str) -> None:
        """Add a paragraph."""
        self.items.append(text)

    def progress(self, text: str) -> None:
        """Tell on standard error how far the comparison is; nothing of it is kept."""
        print(f"      {self.name}: {text}", file=sys.stderr, flush=True)

    def check(self, what: str, passed: object, detail: str = "") -> None:
        """Add and print a check; ``passed`` counts by its truth."""
        check = Check(what, bool(passed), detail)
        self.items.append(check)
        print(f"  {check.line}", flush=True)

    def table(
        self, caption: str, headings: Sequence[str], formats: Sequence[str], rows: Sequence[Sequence[Cell]]
    ) -> None:
        """Add a table; see :class:`Table`."""
        if any(len(row) != len(headings) for row in rows) or len(formats) != len(headings):
            raise ValueError(f"table {caption!r}: every row and the formats need {len(headings)} cells")
        self.items.append(Table(caption, headings, formats, rows))

    def picture(self, picture: Picture) -> None:
        """Draw a picture and add it."""
        self.items.append(picture.render().html())

    @property
    def checks(self) -> list[Check]:
        """The checks, in order."""
        return [item for item in self.items if isinstance(item, Check)]

    @property
    def passed(self) -> bool:
        """There are checks, and all of them hold: a comparison that compared nothing has not passed."""
        return bool(self.checks) and all(check.passed for check in self.checks)


def show(cell: Cell, spec: str) -> str:
    """A cell as text; a dash for what does not exist or is not a number."""
    if cell is None:
        return "\N{EN DASH}"
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, str):
        return cell
    if math.isnan(cell):
        return "\N{EN DASH}"
    if math.isinf(cell):
        return "unbounded"
    return probability(cell) if spec == PROBABILITY else format(cell, spec)


def probability(p: float) -> str:
    """A probability in few digits. Below 1e-15 curves and offsets are cut, and no digit of it means anything."""
    if 0 < p < 1e-15:
        return "below 1e-15"
    # Never round up to certainty.
    return f"1 - {1 - p:.1g}" if 0.9999 < p < 1 else f"{p:.3g}"
