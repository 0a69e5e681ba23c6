"""A robot program on screen: one of its segments at a time, as a trajectory with contact at its worst place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError
from bumpstop.program.cell import Cell, write_trajectory
from bumpstop.program.motion.timing import import_ruckig
from bumpstop.program.source import TextProgram, read_source

if TYPE_CHECKING:
    from pathlib import Path

    from bumpstop.collision import Scenario
    from bumpstop.program.source import Source

# Where a program does not say how fast the tool goes, as bumpstop program has it [m/s].
_MAX_SPEED = 1.0


@dataclass(frozen=True, eq=False)
class ProgramSegments:
    """The segments of a program, as ``bumpstop program`` cuts it.

    Attributes:
        cell: it is judged in.
        source: the program.
        folder: the motions of segments that were on screen are written into it.
    """

    cell: Cell
    source: Source
    folder: Path

    @classmethod
    def read(cls, path: Path, scenario: Scenario, folder: Path) -> ProgramSegments:
        """Read a program.

        Args:
            path: of URScript, KRL or RAPID.
            scenario: the cell.
            folder: for the motions of its segments.

        Raises:
            InputError: it cannot be read, or the scenario cannot judge it.
        """
        import_ruckig()
        cell = Cell(scenario, threads=2)
        return cls(cell, read_source(path, cell, _MAX_SPEED), folder)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the segments, each once."""
        found = []
        for number, segment in enumerate(self.source.segments, start=1):
            first, last = segment.lines
            lines = f"line {first}" if first == last else f"lines {first} to {last}"
            found.append(f"{number}: {segment.name}, {lines}")
        return tuple(found)

    def file(self, number: int) -> Path:
        """Where the motion of a segment, from 0, is written."""
        return self.folder / f"segment-{number + 1}.csv"

    def scenario(self, number: int, cell: Cell | None = None) -> Scenario:
        """The scenario of a segment, from 0: its motion, with contact where it is hardest.

        Args:
            number: of the segment.
            cell: it is judged in; None: that of the program.

        Raises:
            InputError: the segment cannot be judged.
        """
        cell = cell or self.cell
        segment = self.source.segments[number]
        field = f"segment {self.names[number]}"
        if segment.why:
            raise InputError(field, segment.why, "choose another segment")
        motion = segment.at(1.0)
        judgement = cell.judge(motion)
        if judgement.verdict is None:
            raise InputError(field, judgement.why, "choose another segment")
        write_trajectory(self.file(number), motion)
        return cell.of(self.file(number), judgement.worst_s)

    def changes(self, number: int, on_screen: Scenario) -> dict[str, Any]:
        """The keys that make the scenario on screen that of a segment, from 0.

        Args:
            number: of the segment.
            on_screen: where contact is hardest depends on its detector, its contact, its reaction and its arm.

        Raises:
            InputError: the segment cannot be judged.
        """
        motion = self.scenario(number, Cell(on_screen.without_uncertainty())).motion
        return {"motion.file": motion.file, "motion.contact_onset_s": motion.contact_onset_s}

    def first(self) -> Scenario:
        """The scenario of the first segment that can be judged.

        Raises:
            InputError: none can.
        """
        refused: InputError | None = None
        for number in range(len(self.source.segments)):
            try:
                return self.scenario(number)
            except InputError as error:
                refused = refused or error
        assert refused is not None
        raise refused

    @property
    def notes(self) -> tuple[str, ...]:
        """What was taken for granted, and what was not understood."""
        missed = [f"line {line} is not understood: {text}" for line, text in self.source.not_understood]
        unknown = isinstance(self.source, TextProgram) and any(not one.speed_known for one in self.source.segments)
        said = [f"A speed that the program does not say is taken for {1e3 * _MAX_SPEED:g} mm/s."] if unknown else []
        return (*self.source.notes, *missed, *said)
