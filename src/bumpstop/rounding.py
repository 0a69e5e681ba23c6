"""Numbers of a few digits that stay on the safe side of what they tell, and on their side of a limit."""

from __future__ import annotations

import math
from collections.abc import Iterable
from decimal import ROUND_CEILING, ROUND_FLOOR, Context

_HAIR = 1e-12  # as a share of a value: its own rounding, which no digit tells


def rounded(value: float, digits: int, *, up: bool) -> float:
    """The nearest number of so many significant digits that is not above a value; with ``up``, not below it."""
    return float(
        Context(prec=digits, rounding=ROUND_CEILING if up else ROUND_FLOOR).create_decimal(_inside(value, up=up))
    )


def to_decimals(value: float, decimals: int, *, up: bool) -> float:
    """The same of so many decimals; infinity, NaN and what is whole in any case stay as they are."""
    parts = 10.0**decimals
    if not abs(value) < 2.0**52:
        return value
    return (math.ceil if up else math.floor)(_inside(value, up=up) * parts) / parts


def _inside(value: float, *, up: bool) -> float:
    """So little on the other side that a rounding of the value is no digit of it."""
    return value * (1 - _HAIR if up == (value > 0) else 1 + _HAIR)


def on_its_side(texts: Iterable[str], value: float, *limits: tuple[float, float]) -> str:
    """A value in so many digits that it is above, at or below each limit as it stands on the page.

    Args:
        texts: that tell the value in more and more digits; each begins with a number.
        value: what they tell.
        limits: each with the number that stands for it on the page.

    Returns:
        The first text that does; the first of all if none does.
    """
    tried = iter(texts)
    first = next(tried)

    def tells(text: str) -> bool:
        shown = float(text.split()[0])
        return all(_side(shown, beside) == _side(value, limit) for limit, beside in limits)

    return next((text for text in (first, *tried) if tells(text)), first)


def _side(value: float, limit: float) -> int:
    return (value > limit) - (value < limit)
