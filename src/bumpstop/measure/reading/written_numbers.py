"""Numbers of one column as people and devices write them: decimal points or commas, thousands marks."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

_EXPONENT = r"(?:[eE][+-]?[0-9]+)?"


def _in_threes(mark: str) -> str:
    """Digits in groups of three: 1.962 and 1.000.000, not 0.125."""
    return rf"[1-9][0-9]{{0,2}}(?:\{mark}[0-9]{{3}})+"


def _decimal(mark: str, other: str) -> str:
    """Numbers whose mark can only be a decimal one."""
    plain = rf"(?!{_in_threes(mark)}$)(?=\{mark}?[0-9])[0-9]*\{mark}[0-9]*{_EXPONENT}"
    return rf"^[+-]?(?:{plain}|{_in_threes(other)}\{mark}[0-9]*)$"


_OTHER = {".": ",", ",": "."}
_DECIMAL = {mark: re.compile(_decimal(mark, other), re.MULTILINE) for mark, other in _OTHER.items()}
_THOUSANDS = {mark: re.compile(rf"^[+-]?{_in_threes(mark)}$", re.MULTILINE) for mark in _OTHER}
_WHOLE = re.compile(r"^[+-]?[0-9]+$", re.MULTILINE)
_GROUPED = {
    mark: re.compile(rf"[+-]?{_in_threes(other)}(?:\{mark}[0-9]*)?{_EXPONENT}") for mark, other in _OTHER.items()
}
# Spaces and apostrophes between thousands.
_SPACED = re.compile(r"[+-]?[0-9]{1,3}(?:[ \u00a0\u202f'\u2019][0-9]{3})+(?:[.,][0-9]*)?")


@dataclass(frozen=True)
class DecimalMarks:
    """How often some cells can only be read with a decimal point, and with a decimal comma."""

    points: int
    commas: int

    @classmethod
    def of(cls, texts: Sequence[str]) -> DecimalMarks:
        """Those of some cells."""
        joined = "\n".join(texts)
        counts = (sum(1 for _ in _DECIMAL[mark].finditer(joined)) if mark in joined else 0 for mark in ".,")
        return cls(*counts)

    @property
    def mark(self) -> str:
        """The one of most cells; empty: none tells."""
        if self.points == self.commas:
            return ""
        return "." if self.points > self.commas else ","


def decimal_mark(texts: Sequence[str], elsewhere: DecimalMarks) -> str:
    """The decimal mark of a column; empty where it cannot be told.

    A mark before three digits each time, as in 1.962, stands between thousands where other columns have the other
    decimal mark, or where whole numbers without it stand beside, as they do below a thousand.

    Args:
        texts: cells of the column.
        elsewhere: marks of all columns.
    """
    own = DecimalMarks.of(texts).mark
    if own:
        return own
    joined = "\n".join(texts)
    seen = [mark for mark in _OTHER if mark in joined and _THOUSANDS[mark].search(joined)]
    if len(seen) != 1:
        return "" if seen else (elsewhere.mark or ".")
    (mark,) = seen
    whole = _WHOLE.search(joined) is not None
    if not elsewhere.mark:
        return _OTHER[mark] if whole else mark
    if elsewhere.mark == mark:
        return mark
    return elsewhere.mark if whole else ""


def ambiguous(texts: Sequence[str]) -> str:
    """The first cell whose mark may be a decimal one or stand between thousands; empty: none."""
    return next((text for text in texts if any(each.match(text) for each in _THOUSANDS.values())), "")


def as_number(text: str, mark: str) -> float:
    """A cell as a number; NaN where it is none.

    Args:
        text: as written.
        mark: decimal mark of its column; a cell that can only be read with the other one is.
    """
    text = text.strip().strip('"')
    if _SPACED.fullmatch(text):
        text = re.sub(r"[^0-9.,+-]", "", text)
    other = _OTHER[mark]
    if other in text:
        if _GROUPED[mark].fullmatch(text):
            text = text.replace(other, "")
        elif _DECIMAL[other].fullmatch(text):
            text, mark = text.replace(mark, ""), other
        else:
            return math.nan
    if text.count(mark) > 1:
        return math.nan
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
