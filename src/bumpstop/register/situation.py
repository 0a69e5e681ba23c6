"""Contact situations: one place, body region and motion of a cell that is judged by itself."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bumpstop.register.statements import OPEN_STATUSES, Statement

if TYPE_CHECKING:
    from bumpstop.collision import Scenario


@dataclass(frozen=True, kw_only=True)
class Situation:
    """One contact situation of a register.

    Attributes:
        name: unique in its register.
        scenario: the checked scenario.
        file: the register or scenario file that it comes from, as it was given.
        scenario_file: the scenario that the row stands on; ``file`` itself where that is a scenario.
        place: where in ``file`` the row is, ``row 3`` or ``[[situation]] 3``; empty for a scenario file.
        frequency: how often it may happen, in the words of the register; empty: not told.
        payload_kg: what the arm carries [kg], of a stopping table that with which it is read; None: not told.
        note: remark of the register; empty: none.
        given: dotted keys that the row sets, and their values.
        changed: dotted keys whose values were replaced when the register was read.
        statements: where values come from, by dotted key or table.
    """

    name: str
    scenario: Scenario
    file: Path
    scenario_file: Path
    place: str = ""
    frequency: str = ""
    payload_kg: float | None = None
    note: str = ""
    given: Mapping[str, Any] = field(default_factory=dict)
    changed: frozenset[str] = frozenset()
    statements: Mapping[str, Statement] = field(default_factory=dict)

    def statement_of(self, key: str) -> Statement | None:
        """What the register says of a dotted key, or else of its table; None where it says nothing.

        Of a changed value only what keeps it from passing: the rest was said of the value before.
        """
        found = self.statements.get(key) or self.statements.get(key.partition(".")[0])
        void = found is not None and found.status not in OPEN_STATUSES and says(self.changed, key)
        return None if void else found


def says(keys: Collection[str], key: str) -> bool:
    """Whether one of some dotted keys is a key, an item of its list, or another way to write it."""
    spoken = {each.partition("[")[0] for each in keys}
    return key in spoken or (key == "motion.velocity_mm_s" and bool(_SPEED & spoken))


_SPEED = {"motion.speed_mm_s", "motion.direction"}
