"""What reading a recording found: rows, bad rows, gaps, notes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from bumpstop.terminal import named


@dataclass(frozen=True, kw_only=True)
class ReadReport:
    """What was read and what was left out.

    Attributes:
        rows_read: rows of the file, bad ones included.
        dropped: the first 20 bad rows: their number and why they were dropped (reason, then the value).
        counts: number of dropped rows by reason.
        gaps: (start [s], length [s]) of every interval longer than three times the median one.
        notes: what is unusual about the recording, one sentence each.
        time_doubts: those of the notes that say why its times are hardly seconds.
        faults: what contradicts itself, one sentence each; a fit to it is not usable.
        base_motion: from when to when joints moved that carry the base of the robot [s], by their names.
        repaired: rows whose angles were turned back by whole turns.
        other_joints: messages of a bag's topic that have other joints, and are left out.
        other_robot: the robot that the file names, where it was read as one of another.
        numbered: what the row numbers count: ``"line"`` of a text file, ``"row"`` or ``"message"``, from 1.
    """

    rows_read: int = 0
    dropped: tuple[tuple[int, str], ...] = ()
    counts: Mapping[str, int] = field(default_factory=dict)
    gaps: tuple[tuple[float, float], ...] = ()
    notes: tuple[str, ...] = ()
    time_doubts: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    base_motion: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    repaired: int = 0
    other_joints: int = 0
    other_robot: str = ""
    numbered: str = "row"

    @property
    def rows_dropped(self) -> int:
        """Number of all dropped rows."""
        return sum(self.counts.values())

    @property
    def contradictions(self) -> tuple[str, ...]:
        """The faults, and what moves the base that is taken to stand still."""
        if not self.base_motion:
            return self.faults
        moving = named([repr(name) for name in self.base_motion])
        return (*self.faults, f"the base is taken to stand still, and is moved by {moving}")

    def with_payload(self, mass: float, center: Sequence[float]) -> ReadReport:
        """Without the note on the payload that the controller was told of, where it is the one that is declared.

        Args:
            mass: of the declared payload [kg].
            center: (3,) of it, in the frame of the tip [m].
        """
        said = payload_note(mass, center)
        return replace(self, notes=tuple(note for note in self.notes if note != said))


def payload_note(mass: float, center: Sequence[float]) -> str:
    """What a reader must know of a payload that the controller was told of, as ``--payload`` takes it [kg, m]."""
    # Digits beyond these are those of turning the centre from one frame into another.
    figures = ",".join(f"{round(float(value), 9) + 0.0:.6g}" for value in (mass, *center))
    return f"The controller was told of a payload of {mass:.4g} kg: --payload {figures}"
