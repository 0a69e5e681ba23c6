"""Every input of a register: what kind it is, how well it is known, and where it comes from."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bumpstop.register.inputs import KIND_WORDS, Input
from bumpstop.report.markup import Html, breakable, element, paragraph, table, whole, whole_figures
from bumpstop.report.section import Part

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.register import SituationResult

_ORDER = tuple(KIND_WORDS)


class InputsPart(Part):
    """Inputs that all situations share, and those by which they differ."""

    title = "Inputs"
    anchor = "inputs"

    def __init__(self, results: Sequence[SituationResult]) -> None:
        self._results = results

    def content(self) -> list[Html]:
        """Two tables."""
        results = self._results
        common = [one for one in results[0].inputs if all(one in other.inputs for other in results)]
        found = [
            paragraph(
                "Required: a fact of the cell that must be known. From a standard: from a table of limits. "
                "Engineering choice: somebody chose it, or bumpstop did where the status is “default”. A status is the "
                "register's own word where it gives one; “given” is a value whose source nobody has told."
            ),
            table(
                ("input", "value", "kind", "status", "source"),
                [_cells(one) for one in sorted(common, key=lambda one: _ORDER.index(one.kind))],
                caption="Inputs of all situations" if len(results) > 1 else "Inputs",
            ),
        ]
        own = [
            (result.situation.name, *_cells(one))
            for result in results
            for one in sorted(result.inputs, key=lambda one: _ORDER.index(one.kind))
            if one not in common
        ]
        if own:
            headings = ("situation", "input", "value", "kind", "status", "source")
            found.append(table(headings, own, caption="Inputs by which the situations differ"))
        return found


def _cells(one: Input) -> tuple[str, ...]:
    key = element("code", breakable(one.key)) if " " not in one.key else one.key
    status, source = whole(one.status or "not told"), breakable(one.source or "not told")
    return key, whole_figures(one.value), whole(KIND_WORDS[one.kind]), status, source
