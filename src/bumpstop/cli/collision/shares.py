"""Shares of a variance on the screen and in JSON, where there may be no variance."""

from __future__ import annotations

import math


def or_null(value: float) -> float | None:
    """A number for JSON, which has no NaN and no infinity."""
    return value if math.isfinite(value) else None


def share_text(share: float, *, rests: bool = False) -> str:
    """R2 in a table, or that there is none: its joint ``rests``, or nothing varies."""
    if rests:
        return "rests"
    return f"{share:.4f}" if math.isfinite(share) else "none"
