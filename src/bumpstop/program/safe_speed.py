"""The highest speed of a segment at which no collision on its way passes the limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bumpstop.errors import InputError
from bumpstop.study.speed.speed_limit import MIN_SPEED

if TYPE_CHECKING:
    from bumpstop.program.cell import Cell, Judgement
    from bumpstop.program.segment import Segment

# How closely the factor is found, how far below the force's own crossing it stays, and what is tried beyond a bracket.
_PRECISION, _BELOW, _STEP, _ROUNDS = 0.002, 0.002, 1.25, 40
_EASE, _EASINGS = 0.98, 8


@dataclass(frozen=True)
class SafeSpeed:
    """What is found of one segment.

    Attributes:
        factor: of the program's speed; 0 where no speed is safe.
        limited_by: ``"limits"`` of the body, ``"max_speed"`` of the tool, the joints or the language,
            ``"nothing_safe"``, or ``"slower_only"``.
    """

    factor: float
    limited_by: str


def highest_safe(segment: Segment, cell: Cell, max_speed: float, *, faster: bool) -> SafeSpeed:
    """Find the greatest factor whose motion the cell accepts.

    The search begins where the formula of ``bumpstop study`` sees the limit, and goes on with the force distributions
    of the motion itself, which is another one at each speed: where it is faster it has less of its way at full speed.

    Args:
        segment: that can be judged.
        cell: to judge it in.
        max_speed: of the tool, beyond which nothing is looked at [m/s].
        faster: look above the program's speed.
    """
    most = segment.max_factor(max_speed) if faster else 1.0
    excess = _Excess(segment, cell)
    if excess(most) <= 0:
        return SafeSpeed(_eased(segment, cell, most), "slower_only" if not faster else "max_speed")
    fails = most
    trial = most / max(_ratio(segment, cell, most), 1.02)
    met: float | None = None
    for _ in range(_ROUNDS):
        if segment_speed(segment, cell, trial) < MIN_SPEED:
            break
        if excess(trial) <= 0:
            met = trial
            if trial * _STEP >= fails or fails / trial < 1 + 0.2 * (_STEP - 1):
                break
            trial *= 1 + 0.2 * (_STEP - 1)
        else:
            fails = trial
            if met is not None:
                break
            trial /= _STEP
    if met is None:
        return SafeSpeed(0.0, "nothing_safe")
    from scipy.optimize import brentq

    if fails / met > 1 + _PRECISION:
        brentq(lambda x: excess(math.exp(x)), math.log(met), math.log(fails), xtol=_PRECISION / 2)
        met = excess.highest_met()
    return SafeSpeed(_eased(segment, cell, met), "limits")


def segment_speed(segment: Segment, cell: Cell, factor: float) -> float:
    """Greatest speed of the tip at a factor [m/s]; 0 where there is no such motion."""
    try:
        return cell.tool_speed(segment.at(factor))
    except InputError:
        return 0.0


class _Excess:
    """Logarithm of the force at the worst place over the allowed one, by factor."""

    def __init__(self, segment: Segment, cell: Cell) -> None:
        self._segment, self._cell = segment, cell
        self._known: dict[float, float] = {}

    def __call__(self, factor: float) -> float:
        if factor not in self._known:
            try:
                force = self._cell.force(self._segment.at(factor))
            except InputError:
                force = math.inf  # a motion that cannot be
            self._known[factor] = min(math.log(max(force, 1e-9) / self._cell.allowed_force), 20.0) + _BELOW
        return self._known[factor]

    def highest_met(self) -> float:
        """The highest factor looked at that is accepted, below the lowest that is not."""
        fails = min(factor for factor, value in self._known.items() if value > 0)
        return max(factor for factor, value in self._known.items() if value <= 0 and factor < fails)


def _ratio(segment: Segment, cell: Cell, factor: float) -> float:
    """Greatest speed over the one that the formula allows along the motion at a factor; 1 where there is none."""
    try:
        return cell.speed_ratio(segment.at(factor))
    except InputError:
        return 1.0


def _eased(segment: Segment, cell: Cell, factor: float) -> float:
    """The factor, or one that is lower by steps until the cell's own verdict accepts its force."""
    judged: Judgement
    for _ in range(_EASINGS):
        judged = cell.judge(segment.at(factor))
        if judged.verdict is None or judged.over <= judged.verdict.accepted_probability:
            break
        factor *= _EASE
    return factor
