"""Numbers as options give them."""

from __future__ import annotations

import math

from bumpstop.errors import InputError
from bumpstop.text_files import list_items


def numbers(text: str, option: str, count: int) -> list[float]:
    """Finite numbers with commas between them."""
    try:
        values = [float(part) for part in list_items(text)]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise InputError(option, f"{text[:80]!r} cannot be used", f"wanted {count} numbers with commas between them")
    return values
