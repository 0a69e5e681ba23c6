"""Contact situations: one place, body region and motion of a cell that is judged by itself."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bumpstop.collision.scenario.spellings import other_spelling
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

    @property
    def facts(self) -> dict[str, Any]:
        """What the row says besides its scenario, by its keys."""
        reaction = self.scenario.reaction
        by_scenario = reaction.payload_kg is not None or reaction.payload_percent is not None
        found = {"payload_kg": None if by_scenario else self.payload_kg, "frequency": self.frequency, "note": self.note}
        return {key: value for key, value in found.items() if value not in (None, "")}

    def statement_of(self, key: str) -> Statement | None:
        """What the register says of a dotted key in either spelling, or else of its table; None where it says nothing.

        Of a changed value only what keeps it from passing: the rest was said of the value before.
        """
        found = self._stated(key) or self.statements.get(key.partition(".")[0])
        void = found is not None and found.status not in OPEN_STATUSES and says(self.changed, key)
        return None if void else found

    def _stated(self, key: str) -> Statement | None:
        """Of a velocity what keeps its speed or direction from passing, or the first where both are known."""
        if key in self.statements:
            return self.statements[key]
        others = other_spelling(key)
        stated = [self.statements[other] for other in others if other in self.statements]
        doubted = [one for one in stated if one.status in OPEN_STATUSES]
        return next(iter(doubted or (stated if len(stated) == len(others) else [])), None)


def common_statements(situations: Sequence[Situation]) -> dict[str, Statement]:
    """What can be said of the values of all situations together, which may be of several registers.

    What keeps one from passing keeps all from it; the rest was said of all, and of values that nobody replaced.
    """
    each = [statements_without(one.statements, one.changed) for one in situations]
    found: dict[str, Statement] = {}
    for own in each:
        for key, statement in own.items():
            if statement.status in OPEN_STATUSES or all(other.get(key) == statement for other in each):
                found[key] = statement
    return found


def statements_without(statements: Mapping[str, Statement], changed: Collection[str]) -> dict[str, Statement]:
    """The statements without those that were made of values, or of tables with values, that have changed since.

    What keeps a situation from passing stays.
    """
    return {
        key: statement
        for key, statement in statements.items()
        if statement.status in OPEN_STATUSES
        or not (says(changed, key) or any(each.startswith(f"{key}.") for each in changed))
    }


def says(keys: Collection[str], key: str) -> bool:
    """Whether one of some dotted keys is a key, an item of its list, or another way to write it."""
    spoken = {each.partition("[")[0] for each in keys}
    return not spoken.isdisjoint((key, *other_spelling(key)))
