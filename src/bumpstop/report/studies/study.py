"""What the pages of all studies share."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bumpstop.report.collision.tables import flat
from bumpstop.report.document import Document, write_document
from bumpstop.report.markup import Html, bullets, element, table
from bumpstop.report.section import Part

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from bumpstop.study import Study


class StudySettingsPart(Part):
    """The study's settings and its scenario in full."""

    title = "Settings"
    anchor = "settings"

    def __init__(self, study: Study) -> None:
        self._study = study

    def content(self) -> list[Html]:
        """Two tables: the study, the scenario."""
        study = self._study
        own = [(element("code", key), value) for key, value in flat(study.settings())]
        scenario = [(element("code", key), value) for key, value in flat(study.scenario.to_dict())]
        return [
            table(("setting", "value"), own, caption="The study"),
            table(("key", "value"), scenario, caption="Scenario, defaults included"),
        ]


class StudyNotesPart(Part):
    """What is to be read beside every figure of a study or campaign."""

    title = "Beside these figures"
    anchor = "beside"

    def __init__(self, notes: Sequence[str]) -> None:
        self._notes = notes

    def applies(self) -> bool:
        """There is something to be said."""
        return bool(self._notes)

    def content(self) -> list[Html]:
        """The notes of the summary."""
        return [bullets(self._notes)]


class StudyAssumptionsPart(Part):
    """What nobody should read into a study."""

    title = "Assumptions and limits of this study"
    anchor = "assumptions"

    def __init__(self, notes: Sequence[str]) -> None:
        self._notes = notes

    def content(self) -> list[Html]:
        """The study's own notes, then what holds for all."""
        claims = [
            "bumpstop is an engineering tool, not a certified safety function. A risk assessment and a validation on "
            "the real cell are not replaced by it.",
            "The model is not validated on your arm: noise, thresholds, deceleration and latency are those of the "
            "scenario.",
            "Limits of body regions are transcriptions. Before claiming compliance with a standard, compare them with "
            "a bought copy of it.",
        ]
        notes = [element("h3", "What was assumed"), bullets(self._notes)] if self._notes else []
        return [*notes, element("h3", "What is not claimed"), bullets(claims)]


def write_study_report(
    study: Study,
    title: str,
    parts: Sequence[Part],
    folder: Path,
    *,
    beside: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> Path:
    """Write ``report.html`` of a study, its own parts first, and its figures; returns the page's path.

    Args:
        study: what was run.
        title: of the page.
        parts: of this study alone.
        folder: for page and figures.
        beside: notes of the summary, which stand before all parts.
        notes: what was assumed.

    Raises:
        InputError: the folder cannot be written.
    """
    everything = [StudyNotesPart(beside), *parts, StudySettingsPart(study), StudyAssumptionsPart(notes)]
    return write_document(Document(title, f"bumpstop study: {study.title}", "study", everything), folder)
