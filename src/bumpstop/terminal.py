"""The door to the terminal: tables, and numbers as people read them."""

from __future__ import annotations

import io
import math
import os
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import IO, TYPE_CHECKING, cast

from bumpstop.rounding import on_its_side, rounded

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

UNBOUNDED = "unbounded"
NONE = "none"
MIN_PRINTED_NUMBER = 1e-6  # in any unit that a person reads: digits of rounding, not of a quantity
_LEAST_PERCENT = "0.0001"
_WIDTH = 120  # of a table in a text: no terminal folds it


def no_more_than(value: float) -> str:
    """Four significant digits of a positive number, rounded down: what is safe up to it is safe up to what is told."""
    return f"{rounded(value, 4, up=False):.4g}"


def number(value: float, *limits: float | None) -> str:
    """Four significant digits, ``"0"`` below a millionth.

    Infinity is ``"unbounded"``, a quantity that never exists ``"none"``.

    Args:
        value: any.
        limits: that stand beside it :func:`as_written`: as many more digits tell it from them. None, and zero, which
            permits nothing, are passed over.
    """
    if math.isnan(value):
        return NONE
    if math.isinf(value):
        return UNBOUNDED
    if abs(value) < MIN_PRINTED_NUMBER:
        return "0"
    return beside_limits((_digits(value, digits) for digits in range(4, 18)), value, limits)


def _digits(value: float, digits: int) -> str:
    text = f"{value:.{digits}g}"
    # Newtons by the ten thousand are still newtons: no powers of ten.
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e7 else text


def beside_limits(texts: Iterable[str], value: float, limits: Iterable[float | None]) -> str:
    """The first of more and more exact texts that tells a value from its limits, as of :func:`number`."""
    return on_its_side(texts, value, *((limit, float(as_written(limit))) for limit in limits if limit))


def as_written(value: float) -> str:
    """A number with all of the digits that somebody wrote, as of a measured peak or a limit."""
    return f"{value:.15g}"


def counted(count: int, noun: str, verb: str = "") -> str:
    """How many there are: ``"1 row"``, ``"2 rows"``; with a verb, as ``"is"``, ``"was"`` or ``"lies"``, that too."""
    plural = {"is": "are", "was": "were", "has": "have"}.get(verb, verb.removesuffix("s"))
    words = f"{count} {noun}" if count == 1 else f"{count} {noun}s"
    return f"{words} {verb if count == 1 else plural}" if verb else words


def named(names: Sequence[str]) -> str:
    """Names in a row for a sentence."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def correlation(value: float) -> str:
    """A rank correlation; ``"none"`` where there is none, as with a quantity that is everywhere the same."""
    return NONE if math.isnan(value) else f"{value:.3f}"


def share(value: float, *, rests: bool = False) -> str:
    """R2 or another share of a variance; ``"rests"`` of a joint that does, ``"none"`` where there is no variance."""
    if rests:
        return "rests"
    return f"{value:.4f}" if math.isfinite(value) else NONE


def in_percent(value: float, digits: int = 3) -> str:
    """A share, an error or a spread in percent: so many digits, whole where it is larger, and ``"none"`` without one.

    Probabilities, which must not be rounded to certainty, are told by :mod:`bumpstop.collision.probability_text`.
    """
    if not math.isfinite(value):
        return NONE
    text = f"{100 * value:.{digits}g}"
    if "e-" in text:
        return f"less than {_LEAST_PERCENT} %" if value > 0 else f"more than -{_LEAST_PERCENT} %"
    return f"{100 * value:.0f} %" if "e+" in text else f"{text} %"


def terminal(file: io.TextIOBase | None = None) -> Console:
    """The terminal, which prints text as it is and folds only tables that are wider.

    A pipe or a file has no width of its own: tables are not folded to the 80 columns that rich takes for it.

    Args:
        file: to print into; None: standard output.
    """
    from rich.console import Console

    console = Console(file=cast("IO[str] | None", file), highlight=False, markup=False, soft_wrap=True)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = _WIDTH
    return console


def text_of(show: Callable[[Console], None], width: int = _WIDTH, *, wrapped: bool = False) -> str:
    """What ``show`` prints, without spaces at the ends of lines and without the last line's end.

    Args:
        show: prints on the console it is given.
        width: of tables in letters, and of lines if they are ``wrapped``.
        wrapped: fold long lines, too.
    """
    from rich.console import Console

    file = io.StringIO()
    # In a notebook rich would show the text by itself, and write none.
    console = Console(
        file=file,
        width=width,
        highlight=False,
        markup=False,
        color_system=None,
        soft_wrap=not wrapped,
        force_jupyter=False,
    )
    show(console)
    return "\n".join(line.rstrip() for line in file.getvalue().splitlines())


def table(headings: Sequence[str], rows: Iterable[Sequence[str]], left: Collection[str] = ()) -> Table:
    """A table without lines.

    Args:
        headings: of the columns.
        rows: cells.
        left: headings of the columns that begin at the left; the others end at the right.
    """
    from rich.table import Table

    made = Table(box=None, pad_edge=False)
    for heading in headings:
        made.add_column(heading, justify="left" if heading in left else "right", overflow="fold")
    for row in rows:
        made.add_row(*row)
    return made
