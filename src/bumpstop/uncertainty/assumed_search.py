"""The worst and the best values of what is assumed: a bounded search."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate, pairwise, product

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.uncertainty.point_evaluation import PointEvaluator, Points

# All corners of so many intervals are looked at; of more, those that single changes point to.
_MAX_CORNERS = 5
# Values of each interval, its ends among them.
_SCAN = 9
# Values of an interval over which the force of a single contact rises and falls from control cycle to control cycle,
# not in even steps, which could be whole cycles.
_RIPPLE_SCAN = 64
_RIPPLES = ("contact.offset_mm", "motion.contact_onset_s", "motion.speed_mm_s")
_GOLDEN = (math.sqrt(5) - 1) / 2
# Points of the search that follows where something is worst in the middle, for each interval.
_POLISH = 25
# Where false alarms stay below this share of what is accepted, they decide nothing.
_NO_ALARMS = 0.02
# Logarithm beyond which utilisations are not told apart.
_BEYOND = 50.0


@dataclass(frozen=True, eq=False)
class AssumedSearch:
    """What was found.

    Attributes:
        worst: figures of all inputs where the limits are used most (inputs,).
        most_alarms: the same where false alarms are most probable; None where they decide nothing.
        best: where the verdict is kept by most (inputs,).
    """

    worst: FloatArray
    most_alarms: FloatArray | None
    best: FloatArray


def has_ripple(evaluator: PointEvaluator, key: str) -> bool:
    """Whether the force rises and falls over an input from control cycle to control cycle: of a single contact."""
    scenario = evaluator.scenario
    single = scenario.contact.offset_law == "fixed" or isinstance(scenario.motion.contact_onset_s, float)
    return single and key in _RIPPLES


def ripple_shares() -> FloatArray:
    """Where such an input is looked at, as shares of its range, both ends among them (n,)."""
    return np.sort(np.concatenate([[0.0, 1.0], np.arange(1, _RIPPLE_SCAN - 1) * _GOLDEN % 1]))


class _Ranges:
    """Ranges of the assumed inputs, all others fixed."""

    def __init__(self, evaluator: PointEvaluator, base: FloatArray, confidence: float) -> None:
        self.evaluator, self._base = evaluator, base
        self.assumed = [j for j, each in enumerate(evaluator.inputs) if each.assumed]
        self.ends = np.array([evaluator.inputs[j].limits(confidence) for j in self.assumed])
        self.ripples = [k for k, j in enumerate(self.assumed) if has_ripple(evaluator, evaluator.inputs[j].key)]
        even = np.linspace(0.0, 1.0, _SCAN)
        self.shares = [ripple_shares() if k in self.ripples else even for k in range(len(self.assumed))]
        # Rows of the scan that belong to each input.
        self.parts = [slice(first, end) for first, end in pairwise([0, *accumulate(map(len, self.shares))])]

    def rows(self, values: FloatArray) -> FloatArray:
        """Figures of all inputs (n, inputs), of those that are assumed (n, assumed)."""
        rows = np.tile(self._base, (len(values), 1))
        rows[:, self.assumed] = values
        return rows

    def scan(self) -> FloatArray:
        """One input after the other from end to end, in the rows of ``parts`` (n, assumed)."""
        base = self._base[self.assumed]
        return np.concatenate([np.zeros((0, base.size)), *(self.along(k, base) for k in range(base.size))])

    def along(self, k: int, at: FloatArray) -> FloatArray:
        """Input ``k`` from end to end, the others as ``at`` has them (n, assumed)."""
        (low, high), shares = self.ends[k], self.shares[k]
        values = np.tile(at, (shares.size, 1))
        values[:, k] = low + (high - low) * shares
        return values


def search_assumed(evaluator: PointEvaluator, base: FloatArray, confidence: float) -> AssumedSearch:
    """Look for the worst and the best case over the ranges of what is assumed.

    A scan of each range and the corners; what has a ripple once more at the worst of them; where something is worst or
    best in the middle, Nelder and Mead's simplex within the bounds goes on from there (scipy.optimize). Forces grow or
    fall with most inputs, so that a corner is mostly the answer.

    Args:
        evaluator: of the scenario.
        base: figures of all inputs (inputs,); those that are measured stay.
        confidence: of the ranges of assumed distributions; see :meth:`ResolvedInput.limits`.
    """
    ranges = _Ranges(evaluator, base, confidence)
    scan = ranges.scan()
    found = evaluator.at(ranges.rows(scan))
    corners = _corners(ranges, scan, found)
    tried = np.concatenate([scan, corners])
    points = Points.joined([found, evaluator.at(ranges.rows(corners))])
    for k in ranges.ripples if len(ranges.ends) > 1 else ():
        there = ranges.along(k, tried[int(np.argmax(_use(points)))])
        tried, points = np.concatenate([tried, there]), Points.joined([points, evaluator.at(ranges.rows(there))])
    use, alarm, score = _use(points), points.false_alarm, scores(evaluator, points)

    def extreme(values: FloatArray, judge: Callable[[Points], FloatArray]) -> FloatArray:
        start = tried[int(np.argmax(values))]
        bent = any(_bends(values[part]) for part in ranges.parts)
        found: FloatArray = ranges.rows((_polished(ranges, start, judge) if bent else start)[None])[0]
        return found

    alarms = None
    if alarm.max() > _NO_ALARMS * evaluator.scenario.verdict.max_false_alarm and alarm.max() > alarm[int(use.argmax())]:
        alarms = extreme(alarm, lambda points: points.false_alarm)
    return AssumedSearch(
        worst=extreme(use, _use),
        most_alarms=alarms,
        best=extreme(-score, lambda points: -scores(evaluator, points)),
    )


def swapping_inputs(
    evaluator: PointEvaluator, base: FloatArray, confidence: float, swapped: Callable[[Points], npt.NDArray[np.bool_]]
) -> tuple[str, ...]:
    """Keys of assumed inputs that swap the verdict by themselves.

    Args:
        evaluator: of the scenario.
        base: figures of all inputs (inputs,).
        confidence: of the ranges of assumed distributions.
        swapped: whether the verdict at a point is another one (n,).
    """
    ranges = _Ranges(evaluator, base, confidence)
    found = swapped(evaluator.at(ranges.rows(ranges.scan())))
    return tuple(
        evaluator.inputs[j].key for part, j in zip(ranges.parts, ranges.assumed, strict=True) if found[part].any()
    )


def scores(evaluator: PointEvaluator, points: Points) -> FloatArray:
    """Above 0 where a point is not acceptable, and the higher the more it misses (n,)."""
    ratio = points.false_alarm / evaluator.scenario.verdict.max_false_alarm
    with np.errstate(divide="ignore"):
        alarms = np.clip(np.log(ratio), -_BEYOND, _BEYOND)
    return np.asarray(np.maximum(_use(points), alarms))


def _use(points: Points) -> FloatArray:
    """Logarithm of the utilisation, bounded."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.clip(np.log(points.utilisation), -_BEYOND, _BEYOND))


def _bends(values: FloatArray) -> bool:
    """Whether values neither only rise nor only fall, but for rounding."""
    steps = np.diff(values)
    slack = 1e-9 * max(1.0, float(np.abs(values).max()))
    return bool((steps > slack).any() and (steps < -slack).any())


def _corners(ranges: _Ranges, scan: FloatArray, found: Points) -> FloatArray:
    """All of a few intervals; of many, where each alone makes most and least of forces, and of false alarms."""
    count = len(ranges.ends)
    if count <= _MAX_CORNERS:
        return np.array([[ends[side] for ends, side in zip(ranges.ends, sides, strict=True)]
                         for sides in product((0, 1), repeat=count)])  # fmt: skip
    rows = []
    for values in (_use(found), found.false_alarm):
        for extreme in (np.argmax, np.argmin):
            rows.append([scan[part][int(extreme(values[part])), k] for k, part in enumerate(ranges.parts)])
    return np.array(rows)


def _polished(ranges: _Ranges, start: FloatArray, judge: Callable[[Points], FloatArray]) -> FloatArray:
    from scipy.optimize import minimize

    low, span = ranges.ends[:, 0], np.ptp(ranges.ends, axis=1)

    def values(share: FloatArray) -> FloatArray:
        return np.asarray(low + np.clip(share, 0.0, 1.0) * span)

    at = np.clip((start - low) / span, 0.0, 1.0)
    simplex = np.tile(at, (len(at) + 1, 1))
    for k in range(len(at)):
        simplex[k + 1, k] += 1 / _SCAN if at[k] < 0.5 else -1 / _SCAN
    found = minimize(
        lambda share: -float(judge(ranges.evaluator.at(ranges.rows(values(share)[None])))[0]),
        at,
        method="Nelder-Mead",
        bounds=[(0.0, 1.0)] * len(at),
        options={"initial_simplex": simplex, "maxfev": _POLISH * len(at), "xatol": 1e-3, "fatol": 1e-4},
    )
    return values(found.x)
