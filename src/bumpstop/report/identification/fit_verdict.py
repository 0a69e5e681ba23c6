"""The verdict on a fit, first on its page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bumpstop.report.markup import Html, bullets, element, paragraph
from bumpstop.report.section import Part

if TYPE_CHECKING:
    from bumpstop.identification import FitVerdict


class VerdictPart(Part):
    """Usable, usable with warnings or not usable, and every reason."""

    title = "Verdict"
    anchor = "verdict"

    def __init__(self, verdict: FitVerdict) -> None:
        self._verdict = verdict

    def content(self) -> list[Html]:
        """One sentence, and a list of reasons."""
        reasons = self._verdict.reasons()
        line = self._verdict.line().removeprefix("verdict: ")
        found = [paragraph(element("strong", line[0].upper() + line[1:] + "."))]
        return [*found, bullets(reasons)] if reasons else found
