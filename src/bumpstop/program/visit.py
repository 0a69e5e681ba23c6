"""Runs of moves: their paths, and which are the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bumpstop.program.languages.statements import Move, SpeedSlot
from bumpstop.program.motion.path import Leg
from bumpstop.program.state import equal


@dataclass(frozen=True, eq=False)
class Visit:
    """One run of a move.

    Attributes:
        move: the statement.
        leg: its path; None where it is not known.
        slots: where its speed is written.
        why: it cannot be judged; else empty.
        still: the arm stands at its target already.
    """

    move: Move
    leg: Leg | None
    slots: tuple[SpeedSlot, ...]
    why: str = ""
    still: bool = False


def identity(chain: Sequence[Visit]) -> object:
    """Of the moves of a chain, with what is told of each and where its speed is written."""
    return tuple((v.move.line, v.move.word, id(v.move), v.why, v.slots, v.still) for v in chain)


def same_motion(chain: Sequence[Visit], other: Sequence[Visit]) -> bool:
    """Whether two runs are of the same moves and take the same paths with the same tool, acceleration and blends."""
    if identity(chain) != identity(other):
        return False
    for one, two in zip((v.leg for v in chain), (v.leg for v in other), strict=True):
        if (one is None) != (two is None):
            return False
        if one is not None and two is not None:
            same = (one.acceleration, one.blend) == (two.acceleration, two.blend) and equal(one.tool, two.tool)
            if not same or not equal(one.q, two.q):
                return False
    return True
