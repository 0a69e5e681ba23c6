"""From a program to its safe speeds, segment by segment."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import as_whole_number
from bumpstop.errors import InputError
from bumpstop.program.cell import Cell, Judgement
from bumpstop.program.motion.timing import import_ruckig
from bumpstop.program.safe_speed import greatest_factor, highest_safe
from bumpstop.program.source import Source, read_source
from bumpstop.study.answer_warnings import AnswerWarnings, told_once
from bumpstop.study.requirement.sampling_ripple import SLOWER_MAY_FAIL, force_may_fall

if TYPE_CHECKING:
    from bumpstop.collision import Scenario
    from bumpstop.collision.trajectory.trajectory import Trajectory
    from bumpstop.program.segment import Segment

_WORDS = {"acceptable": "PASS", "not_acceptable": "FAIL"}
_MAX_SPEED_MM_S = (1.0, 1e4)
_UNSEEN = "what is not understood may move the arm, and is not judged"
# An acceptable speed that could be raised by less stays: what is written once is written so again.
_WORTH_IT = 1.02
# A tool that is nearer to where contact is [m] is there.
_TOOL_AWAY = 0.01
# What is timed anew only beside what changes is not looked at below this share of its speed.
_LEAST_ANEW = 0.7


@dataclass(frozen=True, eq=False)
class SegmentResult:
    """What is found of a segment.

    Attributes:
        segment: the motion.
        present: the verdict of the motion as the program has it; without one where it cannot be judged.
        present_s: its duration [s]; NaN where it is not known.
        factor: what its speed is multiplied by in the program that is written; 1 where it stays.
        safe_factor: the highest safe one; 0: none is; NaN where it cannot be judged. Where the motion fails with finer
            simulation steps it is safe by those of the cell only.
        limited_by: what limits it.
        written: the verdict of the motion as it is written.
        written_s: its duration [s]; NaN where it is not known.
        refused: the verdict of a faster motion that is not written, as it fails with finer simulation steps; or None.
    """

    segment: Segment
    present: Judgement
    present_s: float = math.nan
    factor: float = 1.0
    safe_factor: float = math.nan
    limited_by: str = ""
    written: Judgement = field(default_factory=lambda: Judgement(None))
    written_s: float = math.nan
    refused: Judgement | None = None

    @property
    def won_s(self) -> float:
        """Time that is won, negative where it is lost [s]."""
        return self.present_s - self.written_s

    @property
    def safe_speed_mm_s(self) -> float:
        """Of the tool at the factor that is written; 0: none is safe; NaN where that is not known."""
        if self.safe_factor == 0:
            return 0.0
        known = not math.isnan(self.safe_factor) and not self.written.fails_with_finer_steps
        return 1e3 * self.written.tool_speed if known else math.nan

    @property
    def open_questions(self) -> tuple[str, ...]:
        """Why the segment is inconclusive as given, and why it does not pass as written."""
        told = [self.present.reason] if self.present.conclusion == "inconclusive" else []
        if self.written.conclusion != "acceptable" and self.written.reason not in told:
            told.append(f"as written: {self.written.reason}")
        return tuple(told)

    def to_json(self) -> dict[str, Any]:
        """As ``--json`` prints it."""
        first, last = self.segment.lines
        return {
            "name": self.segment.name,
            "lines": [first, last],
            "present": _judgement_json(self.present, self.segment, 1.0, self.present_s),
            "safe_factor": None if self.written.fails_with_finer_steps else _finite(self.safe_factor),
            "limited_by": self.limited_by or None,
            "factor": self.factor,
            "written": _judgement_json(self.written, self.segment, self.factor, self.written_s),
            "won_s": _finite(self.won_s),
        }


@dataclass(frozen=True, eq=False)
class ProgramResult:
    """What is found of a program.

    Attributes:
        source: the program.
        cell: it was judged in.
        segments: in its order.
    """

    source: Source
    cell: Cell
    segments: Sequence[SegmentResult]

    @property
    def present(self) -> str:
        """``"PASS"``, ``"FAIL"`` or ``"INCONCLUSIVE"`` of the program as it is."""
        return _worst([*(one.present for one in self.segments), *self._unseen])

    @property
    def won_words(self) -> str:
        """Time that all segments win or lose together, each once; empty where none has a duration both ways."""
        won = [one.won_s for one in self.segments if math.isfinite(one.won_s)]
        return f"{abs(sum(won)):.2f} s {'won' if sum(won) >= 0 else 'lost'}" if won else ""

    @property
    def written_outcome(self) -> str:
        """The same of the program as it is written."""
        return _worst([*(one.written for one in self.segments), *self._unseen])

    @property
    def _unseen(self) -> Sequence[Judgement]:
        return [Judgement(None, _UNSEEN)] if self.source.moves_unseen else []

    @property
    def factors(self) -> Mapping[Segment, float]:
        """Of the segments that are judged, or change with one that is."""
        return {one.segment: one.factor for one in self.segments if one.safe_factor > 0 or one.factor != 1.0}

    @property
    def assumptions(self) -> tuple[str, ...]:
        """What was assumed of the program, and what is doubted of the robot."""
        return (*self.cell.robot.doubts, *self.source.notes)

    @property
    def beside(self) -> tuple[str, ...]:
        """What ``bumpstop evaluate`` says beside the verdicts, each sentence once, and whether slower ones may fail."""
        may_fall = any(force_may_fall(cell.scenario) for cell in self.cell.bodies)
        slower = (SLOWER_MAY_FAIL,) if may_fall and self.factors else ()
        found = []
        for number, one in enumerate(self.segments, start=1):
            found.append(AnswerWarnings(f"segment {number} as given", one.present.warnings))
            if one.written is not one.present:
                found.append(AnswerWarnings(f"segment {number} as written", one.written.warnings))
            if one.refused is not None:
                found.append(AnswerWarnings(f"segment {number} faster, which is not written", one.refused.warnings))
        beside = (*(one.reason for one in self._unseen), *self._tool_elsewhere, *slower)
        return (*beside, *told_once(found, self.assumptions))

    @property
    def _tool_elsewhere(self) -> Sequence[str]:
        """A sentence where contact is at the tip for want of another place, and the program's own tool is not there."""
        robot, bodies = self.cell.robot, self.cell.bodies
        contacts = [body.scenario.contact for body in bodies]
        if not any(contact.link is None and "point_m" not in contact.model_fields_set for contact in contacts):
            return []
        hit = [point for link, point in (body.at_rest.contact_point for body in bodies) if link == robot.dof - 1]
        found = []
        for visit in (visit for one in self.segments for visit in getattr(one.segment, "visits", ()) if visit.leg):
            tool = visit.leg.tool[:3, 3]
            away = min(float(np.linalg.norm(robot.frame(None, tool)[1] - point)) for point in hit)
            found.append((away, visit.move.line, ", ".join(f"{x:.6g}" for x in tool + 0.0)))
        away, line, place = max(found, key=lambda one: round(one[0], 6), default=(0.0, 0, ""))
        if away < _TOOL_AWAY:
            return []
        return [
            f"Contact is at {robot.tip_name}, {1e3 * away:.0f} mm from the tool that line {line} moves, which may hit "
            f"harder: contact.point_m = [{place}] looks there."
        ]

    @property
    def notes(self) -> tuple[str, ...]:
        """What is to be read beside the verdicts, then what was assumed."""
        return (*self.beside, *self.assumptions)

    @property
    def fails_with_finer_steps(self) -> bool:
        """Some segment, as given or as written, is acceptable but for finer simulation steps."""
        return any(each.fails_with_finer_steps for one in self.segments for each in (one.present, one.written))

    def to_json(self) -> dict[str, Any]:
        """As ``--json`` prints it."""
        known = [one for one in self.segments if math.isfinite(one.won_s)]
        return {
            "language": self.source.language,
            "present": self.present,
            "written": self.written_outcome,
            "bodies": [body.to_json() for body in self.cell.bodies],
            "won_s": sum(one.won_s for one in known),
            "segments": [one.to_json() for one in self.segments],
            "not_understood": [{"line": line, "text": text} for line, text in self.source.not_understood],
            "fails_with_finer_steps": self.fails_with_finer_steps,
            "notes": list(self.notes),
        }


def evaluate_program(
    path: Path | str,
    scenario: Scenario,
    *others: Scenario,
    max_speed_mm_s: float = 1000.0,
    faster: bool = True,
    columns: Path | None = None,
    topic: str | None = None,
    threads: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> ProgramResult:
    """Judge every segment of a program, and find its highest safe speed.

    Args:
        path: of a program, a trajectory or a recording.
        scenario: the cell: robot, body, detector, reaction and limits. Of a line, its pose is where the program starts.
        others: of the same arm, against other bodies or with other places of it; the hardest contact counts.
        max_speed_mm_s: no speed of the tip is raised above it.
        faster: raise speeds that are lower than safe; else they are only lowered.
        columns: of a recording: its column file.
        topic: of a recording: that of a bag with several.
        threads: that share the times of contact, 1 to 256; they do not change what is found.
        progress: is told the share that is done.

    Raises:
        InputError: the file cannot be read or the scenario cannot judge it.
    """
    low, high = _MAX_SPEED_MM_S
    if not low <= max_speed_mm_s <= high:
        raise InputError("--max-speed", f"{max_speed_mm_s:g} mm/s cannot be used", f"wanted {low:g} to {high:g}")
    as_whole_number(threads, "threads", 1, 256)
    import_ruckig()
    cell = Cell(scenario, *others, threads=threads)
    source = read_source(Path(path), cell, max_speed_mm_s / 1e3, columns=columns, topic=topic)
    found: list[SegmentResult] = []
    for number, segment in enumerate(source.segments):
        found.append(_found(source, segment, cell, max_speed_mm_s / 1e3, faster=faster))
        progress((number + 1) / len(source.segments))
    factors = _shared(source, found)
    return ProgramResult(source, cell, [_written(one, factors[one.segment], cell) for one in found])


def _found(source: Source, segment: Segment, cell: Cell, max_speed: float, *, faster: bool) -> SegmentResult:
    if segment.why:
        return SegmentResult(segment, Judgement(None, segment.why))
    present, duration = Judgement(None, "its speed is set outside the program"), math.nan
    try:
        motion = segment.at(1.0)
    except InputError as error:
        return SegmentResult(segment, Judgement(None, error.problem))
    if segment.speed_known:
        present, duration = cell.judge(motion), motion.duration
        if present.verdict is None:
            return SegmentResult(segment, present, duration)
    if not segment.speed_known and not all(source.may_be_raised(place) for place in segment.places()):
        return SegmentResult(segment, Judgement(None, "what is written for it may hold for what is not known"))
    raised = faster and segment.speed_known
    most = greatest_factor(segment, cell, max_speed) if faster or not segment.speed_known else 1.0
    safe = highest_safe(segment, cell, most, present)
    limited_by = "slower_only" if safe.limited_by == "max_speed" and not raised else safe.limited_by
    found = SegmentResult(segment, present, duration, safe.factor, safe.factor, limited_by)
    if present.verdict is not None and safe.judged is not None and safe.judged.conclusion == "not_acceptable":
        # Its force is safe: a false alarm comes too often. Slower motions are longer, and have more of them.
        kept = replace(found, factor=1.0, safe_factor=0.0, limited_by="false_alarms")
        return replace(kept, written=present, written_s=duration)
    if present.conclusion == "acceptable" and 1.0 <= safe.factor < _WORTH_IT:
        return replace(found, factor=1.0, written=present, written_s=duration)
    if present.verdict is not None and safe.factor > 1.0 and safe.judged and safe.judged.fails_with_finer_steps:
        # What the steps decide is no reason to go faster.
        kept = replace(found, factor=1.0, safe_factor=1.0, limited_by="simulation_steps")
        return replace(kept, written=present, written_s=duration, refused=safe.judged)
    return replace(found, written=safe.judged or present, written_s=safe.duration)


def _shared(source: Source, found: Sequence[SegmentResult]) -> dict[Segment, float]:
    """Factor of every segment: the lowest of all that share a place with it, and 1 where that is not known.

    What goes over into a segment that changes, and would stay, is timed anew at a little less than its speed.
    """
    factors = {one.segment: one.factor if one.safe_factor > 0 else 1.0 for one in found}
    judged = {one.segment: one.safe_factor > 0 for one in found}
    changed = True
    while changed:
        changed = False
        lowest: dict[object, float] = {}
        for segment, factor in factors.items():
            for place in segment.places():
                own = factor if judged[segment] else min(factor, 1.0)
                least = own if source.may_be_raised(place) else min(own, 1.0)
                lowest[place] = min(lowest.get(place, math.inf), least)
        for segment, factor in factors.items():
            least = min([factor, *(lowest[place] for place in segment.places())])
            if least < factor:
                factors[segment], changed = least, True
    while anew := _beside_changed(factors):
        factors.update(dict.fromkeys(anew, 1 / _WORTH_IT))
    return factors


def _beside_changed(factors: Mapping[Segment, float]) -> Sequence[Segment]:
    """What keeps its speed beside what is timed anew: its motion would end otherwise than it was judged."""
    changed = {place for segment, factor in factors.items() if factor != 1.0 for place in segment.joins()}
    return [one for one, factor in factors.items() if factor == 1.0 and not changed.isdisjoint(one.joins())]


def _written(one: SegmentResult, factor: float, cell: Cell) -> SegmentResult:
    if one.segment.why or (not one.segment.speed_known and not one.safe_factor > 0):
        return replace(one, factor=1.0, written=one.present, written_s=one.present_s)
    if factor == one.factor and one.safe_factor > 0:
        return one
    if factor == 1.0 and one.segment.speed_known:
        return replace(one, factor=1.0, written=one.present, written_s=one.present_s)
    try:
        motion: Trajectory = one.segment.at(factor)
    except InputError as error:
        return replace(one, factor=factor, written=Judgement(None, error.problem))
    written = cell.judge(motion)
    worse = one.present.conclusion == "acceptable" != written.conclusion
    if worse and one.segment.joins() and factor > _LEAST_ANEW:
        return _written(one, factor / _WORTH_IT, cell)  # timed anew at its own speed it may be harder
    return replace(one, factor=factor, written=written, written_s=motion.duration)


def _worst(judgements: Any) -> str:
    words = {_WORDS.get(judgement.conclusion, "INCONCLUSIVE") for judgement in judgements}
    return next((word for word in ("FAIL", "INCONCLUSIVE", "PASS") if word in words), "INCONCLUSIVE")


def outcome_word(judgement: Judgement) -> str:
    """``"PASS"``, ``"FAIL"`` or ``"INCONCLUSIVE"``."""
    return _WORDS.get(judgement.conclusion, "INCONCLUSIVE")


def worst_line(judgement: Judgement, segment: Segment, factor: float) -> int | None:
    """Line of the file that moves where contact is hardest; None without a verdict."""
    return None if judgement.verdict is None else segment.line_at(judgement.worst_s, segment.at(factor))


def _judgement_json(judgement: Judgement, segment: Segment, factor: float, duration: float) -> dict[str, Any]:
    return {
        "outcome": outcome_word(judgement),
        "reason": judgement.reason,
        "warnings": list(judgement.warnings),
        "body": None if judgement.cell is None else judgement.cell.scenario.contact.body,
        "force_N": _finite(judgement.force),
        "worst_line": worst_line(judgement, segment, factor),
        "worst_s": _finite(judgement.worst_s),
        "worst_m": list(judgement.worst_m) or None,
        "tool_speed_mm_s": _finite(1e3 * judgement.tool_speed),
        "duration_s": _finite(duration),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
