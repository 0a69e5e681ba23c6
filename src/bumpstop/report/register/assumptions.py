"""What the verdicts of a register rest on: deviations, assumptions, and what is not claimed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from bumpstop.report.markup import Html, bullets, element, paragraph, table
from bumpstop.report.section import Part

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.register import SituationResult

_CLAIMS = (
    "bumpstop is an engineering tool, not a certified safety function. A risk assessment and a validation on the real "
    "cell are not replaced by it.",
    "The limits are transcriptions. Before claiming compliance with a standard, compare them with a bought copy of it, "
    "in its current edition.",
    "The model is not validated on the arm of this cell: noise, thresholds, deceleration and latency are those of the "
    "inputs.",
    "The register judges the situations that it names. Whether it names all of them, the risk assessment tells.",
    "Probabilities far below the accepted one are statements about the tails of the model, not about an arm.",
)


class AssumptionsPart(Part):
    """Deviations and assumptions with the situations that they hold for."""

    title = "Assumptions and deviations"
    anchor = "assumptions"

    def __init__(self, results: Sequence[SituationResult]) -> None:
        self._results = results

    def content(self) -> list[Html]:
        """Two tables and a list."""
        results = self._results
        warned = {text for result in results for text in result.warnings}
        deviations = self._by_text(lambda result: result.warnings)
        assumptions = self._by_text(lambda result: [note for note in result.notes if note not in warned])
        found = []
        if deviations:
            found.append(table(("deviation", "situations"), deviations, caption="What makes a verdict mean less"))
        else:
            found.append(paragraph("No verdict has a warning beside it."))
        found.append(table(("assumption", "situations"), assumptions, caption="What was assumed"))
        return [*found, element("h3", "What is not claimed"), bullets(_CLAIMS)]

    def _by_text(self, texts_of: Callable[[SituationResult], Sequence[str]]) -> list[tuple[str, str]]:
        """Each sentence once, with the names of the situations that have it."""
        named: dict[str, list[str]] = {}
        for result in self._results:
            for text in dict.fromkeys(texts_of(result)):
                named.setdefault(text, []).append(result.situation.name)
        every = len(self._results)
        return [(text, "all" if len(names) == every > 1 else ", ".join(names)) for text, names in named.items()]
