"""The highest speed of a segment at which no collision on its way passes the limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.errors import InputError
from bumpstop.program.motion.timing import MAX_DURATION_S
from bumpstop.study.speed.speed_search import MIN_SPEED, SearchRange, Tried, highest_met

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.program.cell import Cell, Judgement, WorstOnset
    from bumpstop.program.segment import Segment

# How closely the speed is found, as a share. Motions are no longer than this share of the longest that are judged.
_PRECISION, _LONGEST = 0.004, 0.98
# How closely the greatest factor is found, and how low it may be of a speed that is only tried.
_NEAR, _LEAST = 1.002, 1e-3
# Where the cell's own verdict does not accept what was found, it is lowered by steps.
_EASE, _EASINGS = 0.98, 8


@dataclass(frozen=True)
class SafeSpeed:
    """What is found of one segment.

    Attributes:
        factor: of the program's speed; 0 where no speed is safe.
        limited_by: ``"limits"`` of the body, ``"max_speed"`` of the tool, the joints or the language,
            ``"nothing_safe"``, or ``"slower_only"``.
        judged: the motion at that factor; None where no speed is safe.
        duration: of that motion [s]; NaN where no speed is safe.
    """

    factor: float
    limited_by: str
    judged: Judgement | None = None
    duration: float = math.nan


def greatest_factor(segment: Segment, cell: Cell, max_speed: float) -> float:
    """Beyond it nothing gets faster, or a limit of the tool, the language or the joints is passed.

    It is 1 at least of the program's speed, and 1 at most of a speed that is only tried, as the program says none.
    What bends of the path ask of the joints grows with the square of the speed: it stays within the accelerations of
    the reaction, or within the program's own where they are greater.

    Args:
        segment: that can be judged.
        cell: whose joint acceleration counts.
        max_speed: of the tool [m/s].
    """

    def load(factor: float) -> float:
        return float((segment.bends(factor) / cell.joint_acceleration).max())

    known = segment.speed_known
    most = segment.max_factor(max_speed) if known else 1.0
    low, high, allowed = 1.0 if known else _LEAST, most, max(1.0, load(1.0)) if known else 1.0
    if load(most) <= allowed:
        return most
    while high > _NEAR * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if load(middle) <= allowed else (low, middle)
    return low


def highest_safe(segment: Segment, cell: Cell, most: float, present: Judgement) -> SafeSpeed:
    """Find the greatest factor whose motion the cell accepts.

    The search is that of ``bumpstop study speed-limits``, with the force at the worst place of the motion itself. That
    is another motion at each speed: where it is faster it has less of its way at full speed.

    Args:
        segment: that can be judged.
        cell: to judge it in.
        most: no greater factor is looked at.
        present: the judgement of factor 1; without a verdict where the program does not say its speed.
    """
    motion = segment.at(1.0)
    tool = cell.tool_speed(motion)
    known: dict[float, list[WorstOnset]] = {}
    found = {1.0: present.share} if present.verdict is not None else {}
    # Where contact is too hard at one speed it mostly is at the next one tried, too: that place is looked at first.
    place = present.worst_s / motion.duration if present.share > 1 else None

    def tried(rows: npt.NDArray[np.int64], speed: FloatArray) -> Tried:
        nonlocal place
        factor = float(speed[0]) / tool
        if factor not in found:
            try:
                faster = segment.at(factor)
                known[factor] = cell.hardest(faster, place)
                time, found[factor] = max(known[factor], key=lambda one: one[1])
                if found[factor] > 1:
                    place = time / faster.duration
            except InputError:
                found[factor] = math.inf  # a motion that cannot be
        return np.array([found[factor] <= 1]), np.array([found[factor]])

    slowest = max(MIN_SPEED, tool * motion.duration / (_LONGEST * MAX_DURATION_S))
    within = SearchRange(
        first=np.array([min(most, 1.0) * tool]),
        undetected=np.zeros(1),
        min_speed=np.array([min(slowest, tool)]),
        max_speed=np.array([most * tool]),
    )
    factor = float(highest_met(tried, 1.0, within, _PRECISION)[0][0]) / tool
    if factor == 0:
        return SafeSpeed(0.0, "nothing_safe")
    limited_by = "max_speed" if factor >= most * (1 - 1e-12) else "limits"
    for _ in range(_EASINGS):
        motion = segment.at(factor)
        # At the program's own speed the judgement is known.
        same = factor == 1.0 and present.verdict is not None
        judged = present if same else cell.judge(motion, known.get(factor))
        if judged.verdict is None or judged.over <= judged.verdict.accepted_probability:
            break
        factor *= _EASE
    return SafeSpeed(factor, limited_by, judged, motion.duration)
