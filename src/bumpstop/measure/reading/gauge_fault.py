"""A fault of a gauge recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

NAMES = (
    *("saturated", "clipped", "shifted", "inverted", "coarse", "resampled", "truncated", "wrong_unit", "wrong_column"),
    *("unreadable", "repeated", "backward", "gaps", "uneven", "drift", "spike"),
    *("touched", "several", "anew", "late", "no_pressure"),
)
"""Every fault there is."""


@dataclass(frozen=True)
class GaugeFault:
    """Something that is wrong with a recording.

    Attributes:
        name: one of :data:`NAMES`.
        count: how often.
        text: one sentence.
        repaired: whether it was taken away.
        spoils: whether the peak force cannot be relied on.
    """

    name: str
    count: int
    text: str
    repaired: bool = False
    spoils: bool = False

    def to_json(self) -> dict[str, Any]:
        """By name."""
        # Whoever compares samples has numpy's numbers, which are none of JSON's.
        return {
            "name": self.name,
            "count": int(self.count),
            "text": self.text,
            "repaired": bool(self.repaired),
            "spoils": bool(self.spoils),
        }
