"""Numbers of a few digits that stay on the safe side of what they tell."""

from __future__ import annotations

from decimal import ROUND_CEILING, ROUND_FLOOR, Context

_HAIR = 1e-12  # as a share of a value: its own rounding, which no digit tells


def rounded(value: float, digits: int, *, up: bool) -> float:
    """The nearest number of so many significant digits that is not above a value; with ``up``, not below it."""
    inside = value * (1 - _HAIR if up == (value > 0) else 1 + _HAIR)
    return float(Context(prec=digits, rounding=ROUND_CEILING if up else ROUND_FLOOR).create_decimal(inside))
