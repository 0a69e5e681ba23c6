"""The least and the most favourable values of what is assumed: a bounded search."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.uncertainty.point_evaluation import PointEvaluator, Points

# All corners of so many intervals are looked at; of more, those that single changes point to.
_MAX_CORNERS = 5
# Values of each interval, its ends among them.
_SCAN = 9
# Points of the search that follows, for each interval.
_POLISH = 20
# Probabilities below are one.
_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class AssumedSearch:
    """What was found.

    Attributes:
        worst, best: figures of all inputs where the verdict is missed by most, and kept by most (inputs,).
        deciding: numbers of the assumed inputs that swap the verdict by themselves, from 0.
    """

    worst: FloatArray
    best: FloatArray
    deciding: tuple[int, ...]


def search_assumed(evaluator: PointEvaluator, base: FloatArray, confidence: float) -> AssumedSearch:
    """Look for the worst and the best case over the ranges of what is assumed.

    Corners, a scan of each range, and from the best of them on Nelder and Mead's simplex within the bounds
    (scipy.optimize). The probabilities grow or fall with most inputs, so that a corner is mostly the answer; the scan
    finds what is worst in the middle.

    Args:
        evaluator: of the scenario.
        base: figures of all inputs (inputs,); those that are measured stay.
        confidence: of the ranges of assumed distributions; see :meth:`ResolvedInput.limits`.
    """
    assumed = [j for j, each in enumerate(evaluator.inputs) if each.assumed]
    ends = np.array([evaluator.inputs[j].limits(confidence) for j in assumed])

    def moved(values: FloatArray) -> FloatArray:
        rows = np.tile(base, (len(values), 1))
        rows[:, assumed] = values
        return rows

    scans = []
    for k, (low, high) in enumerate(ends):
        values = np.tile(base[assumed], (_SCAN, 1))
        values[:, k] = np.linspace(low, high, _SCAN)
        scans.append(values)
    tried = np.concatenate([base[assumed][None], *scans])
    scores = _scores(evaluator, evaluator.at(moved(tried)))
    swaps = (scores > 0) != (scores[0] > 0)
    deciding = tuple(j for k, j in enumerate(assumed) if swaps[1 + k * _SCAN : 1 + (k + 1) * _SCAN].any())
    corners = _corners(ends, tried, scores)
    tried = np.concatenate([tried, corners])
    scores = np.concatenate([scores, _scores(evaluator, evaluator.at(moved(corners)))])
    found = []
    for sign in (-1.0, 1.0):
        start = int(np.argmin(sign * scores))
        # The direction that the verdict does not depend on is worth no more points.
        keep = (scores[start] > 0) == (sign > 0) and sign > 0
        values = tried[start] if keep else _polished(evaluator, moved, tried[start], ends, sign)
        found.append(moved(values[None])[0])
    return AssumedSearch(worst=found[0], best=found[1], deciding=deciding)


def _scores(evaluator: PointEvaluator, points: Points) -> FloatArray:
    """Above 0 where a point is not acceptable; where probabilities are one or none, the force goes on ranking."""
    ratio = np.log(np.maximum(evaluator.exceedance_ratio(points), _TINY))
    return np.asarray(ratio + 1e-3 * np.sign(ratio) * np.minimum(np.abs(np.log1p(points.utilisation)), 50.0))


def _corners(ends: FloatArray, tried: FloatArray, scores: FloatArray) -> FloatArray:
    """All of a few intervals; of many, those where each goes the way that it made things worse or better alone."""
    count = len(ends)
    if count <= _MAX_CORNERS:
        return np.array([[ends[k, side] for k, side in enumerate(sides)] for sides in product((0, 1), repeat=count)])
    at = 1 + _SCAN * np.arange(count)
    worse = np.where(scores[at] > scores[at + _SCAN - 1], ends[:, 0], ends[:, 1])
    best_of_scan = [tried[at[k] + np.argmin(scores[at[k] : at[k] + _SCAN]), k] for k in range(count)]
    worst_of_scan = [tried[at[k] + np.argmax(scores[at[k] : at[k] + _SCAN]), k] for k in range(count)]
    return np.array([worse, ends.sum(axis=1) - worse, best_of_scan, worst_of_scan])


def _polished(
    evaluator: PointEvaluator,
    moved: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    ends: FloatArray,
    sign: float,
) -> FloatArray:
    from scipy.optimize import minimize

    span = ends[:, 1] - ends[:, 0]

    def score(share: FloatArray) -> float:
        values = np.clip(ends[:, 0] + share * span, ends[:, 0], ends[:, 1])
        return sign * float(_scores(evaluator, evaluator.at(moved(values[None])))[0])

    at = (start - ends[:, 0]) / span
    simplex = np.tile(at, (len(at) + 1, 1))
    for k in range(len(at)):
        simplex[k + 1, k] += 0.1 if at[k] < 0.5 else -0.1
    found = minimize(
        score,
        at,
        method="Nelder-Mead",
        bounds=[(0.0, 1.0)] * len(at),
        options={"initial_simplex": simplex, "maxfev": _POLISH * len(at), "xatol": 1e-3, "fatol": 1e-3},
    )
    return np.asarray(np.clip(ends[:, 0] + found.x * span, ends[:, 0], ends[:, 1]))
