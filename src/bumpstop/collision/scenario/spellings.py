"""Keys that say one thing in two spellings: a file gives one of them, and setting one replaces the other."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from bumpstop.errors import InputError

# Either the keys of the first or those of the second, and the words for what to give.
SPELLINGS = (
    (("pose_deg",), ("pose_rad",)),
    (("contact.stiffness_N_m",), ("contact.stiffness_N_mm",)),
    (("reaction.payload_kg",), ("reaction.payload_percent",)),
    (("motion.velocity_mm_s",), ("motion.speed_mm_s", "motion.direction")),
)


def check_one_spelling(given: Iterable[str]) -> None:
    """Refuse dotted keys that say one thing twice.

    Raises:
        InputError: names one key of either spelling.
    """
    keys = list(given)
    for one, other in SPELLINGS:
        first = next((key for key in keys if key in one), None)
        second = next((key for key in keys if key in other), None)
        if first is not None and second is not None:
            raise InputError(
                first,
                f"and {second} are both given",
                f"give {' with '.join(one)} or {' with '.join(other)}, one of them",
            )


def other_spelling(key: str) -> tuple[str, ...]:
    """The dotted keys that say the same as a key in its other spelling; none where it has no other."""
    return next((other if key in one else one for one, other in SPELLINGS if key in one + other), ())


def replace_other_spelling(tables: dict[str, Any], key: str) -> None:
    """Make room for a dotted key: its other spelling goes, and what that said besides stays.

    A speed set beside a velocity keeps its direction, and a direction its speed.
    """
    for one, other in SPELLINGS:
        if key not in one + other:
            continue
        table_name, _, _ = key.rpartition(".")
        table = tables.get(table_name, {}) if table_name else tables
        if not isinstance(table, dict):
            return
        last = key.rpartition(".")[2]
        velocity = table.get("velocity_mm_s") if last in ("speed_mm_s", "direction") else None
        for replaced in other if key in one else one:
            table.pop(replaced.rpartition(".")[2], None)
        if _is_vector(velocity):
            assert velocity is not None
            if last == "speed_mm_s":
                table.setdefault("direction", velocity)
            else:
                table.setdefault("speed_mm_s", math.hypot(*velocity))


def _is_vector(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(isinstance(v, int | float) for v in value)
