"""Stopping tables that scenarios of a register name."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.stopping import fit_stopping, load_stopping_table
from bumpstop.errors import InputError
from bumpstop.report.collision.stopping import RowsPart
from bumpstop.report.markup import Html, bullets, element, paragraph, table
from bumpstop.report.section import Part
from bumpstop.terminal import in_percent

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from bumpstop.register import Situation


class StoppingDataPart(Part):
    """Each table of stopping distances with the law that it obeys, or that there is none."""

    title = "Stopping data"
    anchor = "stopping"

    def __init__(self, situations: Sequence[Situation]) -> None:
        self._named: dict[tuple[Path, int | None], list[str]] = {}
        self._without: list[str] = []
        for situation in situations:
            reaction = situation.scenario.reaction
            if reaction.stopping_table is None:
                self._without.append(situation.name)
            else:
                path = situation.scenario.folder / reaction.stopping_table
                self._named.setdefault((path, reaction.stop_category), []).append(situation.name)
        self._every = len(situations)

    def content(self) -> list[Html]:
        """Rows and law of every table, then the situations without one."""
        found: list[Html] = []
        for (path, category), names in self._named.items():
            found.append(element("h3", str(path)))
            found.append(paragraph("For ", "all situations" if len(names) == self._every else ", ".join(names), "."))
            found += _table(path, category)
        if self._without:
            none = len(self._without) == self._every
            which = "No situation names a stopping table." if none else f"None for {', '.join(self._without)}."
            found.append(paragraph(which))
            found.append(
                paragraph(
                    "Without a stopping table the deceleration is that of ",
                    element("code", "[reaction]"),
                    " among the inputs: measure it, or take the table of the maker's safety manual.",
                )
            )
        return found


def _table(path: Path, category: int | None) -> list[Html]:
    stops = load_stopping_table(path, category=category)
    if not np.isfinite(stops.distance).any():
        return [paragraph("It has no distances.")]
    try:
        fit = fit_stopping(stops)
    except InputError as error:
        return [paragraph(f"It obeys no law that can be fitted: {error}.")]
    one = fit.fits[fit.law]
    return [
        paragraph(f"{fit.law}: {one.law.formula}; median error {in_percent(one.median_error, 2)}."),
        table(*fit.numbers_by_joint(), caption=f"Numbers of {fit.law}, and the exponent", numbers=True),
        *RowsPart(fit).content(),
        *([bullets(fit.notes)] if fit.notes else []),
    ]
