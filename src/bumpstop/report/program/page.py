"""The page of a robot program: its segments, how hard they hit, and how fast they may be."""

from __future__ import annotations

import math
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.program.evaluation import outcome_word
from bumpstop.report.collision.tables import flat
from bumpstop.report.document import Document, write_document
from bumpstop.report.markup import Html, bullets, element, paragraph, table
from bumpstop.report.picture import LAW, LIMIT, Picture, axes
from bumpstop.report.section import Part
from bumpstop.report.studies.study import StudyNotesPart

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from bumpstop.program.evaluation import ProgramResult, SegmentResult

_LIMITED_BY = {
    "limits": "limits of the body",
    "max_speed": "joints, language or highest speed looked at",
    "slower_only": "only lowered",
    "nothing_safe": "no speed is safe",
    "false_alarms": "false alarms before contact",
    "simulation_steps": "coarse simulation steps",
}
_CLAIMS = (
    "bumpstop is an engineering tool, not a certified safety function. A risk assessment and a validation on the real "
    "cell are not replaced by it.",
    "Each segment is judged with contact at its worst place. Ramps, blends and paths are those of the model; the "
    "controller's own may differ.",
    "Override, singularity handling and limits of the teach pendant are not in the program, and not in the verdict.",
)


class SegmentsPart(Part):
    """A row and a pair of bars for every segment."""

    title = "Segments"
    anchor = "segments"

    def __init__(self, result: ProgramResult) -> None:
        self._result = result

    def content(self) -> list[Html]:
        """Verdicts, places, forces and speeds."""
        result = self._result
        headings = ("segment", "line", "as given", "worst at, mm", "body", "force, N", "tool, mm/s", "safe, mm/s")
        rows = [
            (
                f"{number} {one.segment.name}",
                _lines(one),
                outcome_word(one.present),
                ", ".join(f"{1e3 * x:.0f}" for x in one.present.worst_m) or "-",
                "-" if one.present.cell is None else str(one.present.cell.scenario.contact.body),
                _number(one.present.force),
                _number(1e3 * one.present.tool_speed),
                "none" if one.safe_speed_mm_s == 0 else _number(one.safe_speed_mm_s),
                outcome_word(one.written),
                _number(one.won_s, "+.2f"),
                _LIMITED_BY.get(one.limited_by, "-"),
            )
            for number, one in enumerate(result.segments, start=1)
        ]
        won = result.won_words
        text = f"{result.present} as given, {result.written_outcome} as written" + (
            f", {won} over all segments, each once." if won else "."
        )
        return [paragraph(text), table((*headings, "as written", "won, s", "limited by"), rows, caption="Segments")]

    def pictures(self) -> list[Picture]:
        """Force by segment."""
        return [
            Picture(
                "segments",
                "Peak force at the worst place of every segment, as given and as written.",
                "Bars of the force that is exceeded with the accepted probability, and the force that is allowed. A "
                "segment without bars could not be judged.",
                self._draw,
            )
        ]

    def _draw(self, figure: Figure) -> None:
        plot, result = axes(figure), self._result
        place = np.arange(1, len(result.segments) + 1)
        for shift, colour, label, forces in (
            (-0.2, LIMIT, "as given", [one.present.force for one in result.segments]),
            (0.2, LAW, "as written", [one.written.force for one in result.segments]),
        ):
            plot.bar(place + shift, np.nan_to_num(np.array(forces)), 0.38, color=colour, label=label)
        for body, style in zip(result.cell.bodies, cycle(("--", ":", "-.")), strict=False):
            label = f"allowed, {body.scenario.contact.body}"
            plot.axhline(body.allowed_force, color="black", linestyle=style, label=label)
        plot.set(xlabel="segment", ylabel="peak force [N]", xticks=place)
        plot.legend(loc="best")


class LeftAsItIsPart(Part):
    """What was not understood, what could not be judged, what was assumed and what is not claimed."""

    title = "Assumptions and limits of this page"
    anchor = "assumptions"

    def __init__(self, result: ProgramResult) -> None:
        self._result = result

    def content(self) -> list[Html]:
        """Lists; the claims that are not made."""
        result = self._result
        unjudged = [
            f"segment {number}, {'line' if len(set(one.segment.lines)) == 1 else 'lines'} {_lines(one)}: {question}"
            for number, one in enumerate(result.segments, start=1)
            for question in one.open_questions
        ]
        found: list[Html] = []
        for heading, items in (
            ("Not understood", [f"line {line}: {text[:200]}" for line, text in result.source.not_understood]),
            ("Inconclusive", unjudged),
            ("What was assumed", list(result.assumptions)),
            ("What is not claimed", list(_CLAIMS)),
        ):
            if items:
                found += [element("h3", heading), bullets(items)]
        return found


class CellPart(Part):
    """The scenarios in full."""

    title = "Cell"
    anchor = "cell"

    def __init__(self, result: ProgramResult) -> None:
        self._result = result

    def content(self) -> list[Html]:
        """Its keys, but for the motion."""
        tables: list[Html] = []
        for body in self._result.cell.bodies:
            data = {key: value for key, value in body.scenario.to_dict().items() if key != "motion"}
            rows = [(element("code", key), value) for key, value in flat(data)]
            tables.append(table(("key", "value"), rows, caption="Scenario, defaults included"))
        return tables


def write_program_report(result: ProgramResult, name: str, folder: Path) -> Path:
    """Write ``report.html`` of a program and its figure; returns the page's path.

    Raises:
        InputError: the folder cannot be written.
    """
    parts = [StudyNotesPart(result.beside), SegmentsPart(result), LeftAsItIsPart(result), CellPart(result)]
    robot = result.cell.robot
    about = f"{result.source.language}, {robot.title or robot.name}"
    return write_document(Document(name, "bumpstop program", "program", parts, about), folder)


def _lines(one: SegmentResult) -> str:
    first, last = one.segment.lines
    return str(first) if first == last else f"{first} to {last}"


def _number(value: float, form: str = ".4g") -> str:
    return format(value, form) if math.isfinite(value) else "-"
