"""Curves of equal risk: which pairs of two parameters just meet the limits."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.study.requirement.risk import allowed_force

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.collision import Scenario
    from bumpstop.study.range import Range

# Accepted probabilities of passing a limit, one family of curves each.
RISKS = (0.1, 0.01, 1e-3, 1e-4)
_FINE = 129
# Points of a curve that distributions of their own put where they belong.
_POINTS = 32
# Of the force over what is allowed, in the logarithm: a point this close below is on its curve.
_CLOSE = 1e-4
# How far a point may be moved, and how narrow its place is made where the force jumps, in cells of the rows.
_MAX_CELLS, _NARROW = 1.5, 1e-4
_MAX_EVALUATIONS = 24
# Without bound is far over.
_BOUNDLESS_N = 1e9


def equal_risk_curves(scenario: Scenario, first: Range, second: Range, rows: pl.DataFrame) -> dict[str, Any]:
    """Where P(peak force over what is allowed) has each of :data:`RISKS`, over two ranges.

    The quantile at 1 - risk is smooth in both, unlike the probability: its ratio to the allowed force is contoured at
    one, on a cubic spline through the rows. Points of the contours are then moved along one of the two keys to where
    their own distributions have that ratio, at whole steps of a quantised key.

    Returns:
        ``keys``, ``controls``, and ``curves``: ``{risk, lines}``, a line as points ``[first, second]``.
    """
    from contourpy import contour_generator

    from bumpstop.collision import CollisionProblem, evaluate

    own = rows.filter(
        (rows["kind"] == "pair") & (rows["key"] == first.variable.name) & (rows["key_2"] == second.variable.name)
    ).sort("value", "value_2")
    x, y = np.array(first.values), np.array(second.values)

    def at(a: float, b: float) -> Scenario:
        return second.variable.apply(first.variable.apply(scenario, a), b)

    def ratio_at(point: FloatArray, risk: float) -> float:
        result = evaluate(at(*point))
        # Aimed a little below: where single forces are probable the risk jumps at the curve.
        return _log_ratio(result.peak_force.quantile(1 - risk), allowed_force(result.problem)) + 0.5 * _CLOSE

    allowed = np.array([[allowed_force(CollisionProblem.from_scenario(at(a, b))) for a in x] for b in y])
    curves = []
    for risk, column in zip(RISKS, ("p90_N", "p99_N", "p999_N", "p9999_N"), strict=True):
        quantile = own[column].to_numpy().reshape(x.size, y.size).T
        fine = _finer(x, y, np.vectorize(_log_ratio)(quantile, allowed))
        curve = _Curve(scenario, (first, second), fine, partial(ratio_at, risk=risk))
        lines = [curve.corrected(np.asarray(line)) for line in contour_generator(*fine).lines(0.0)]
        curves.append({"risk": risk, "lines": [line.tolist() for line in lines if len(line) > 1]})
    return {
        "keys": [first.variable.name, second.variable.name],
        "labels": [first.variable.label(scenario), second.variable.label(scenario)],
        "ends": [[first.low, first.high], [second.low, second.high]],
        "controls": [first.variable.value(scenario), second.variable.value(scenario)],
        "curves": curves,
    }


def _log_ratio(force: float, allowed: float) -> float:
    """Logarithm of a force over what is allowed."""
    return math.log((max(force, 1e-9) if math.isfinite(force) else _BOUNDLESS_N) / allowed)


class _Curve:
    """Puts points of contours where they belong.

    Args:
        scenario: what all distributions share.
        ranges: of the two keys.
        fine: values of both keys, and the ratio on their grid, of which the contours are.
        ratio: that of the distribution at a point.
    """

    def __init__(
        self,
        scenario: Scenario,
        ranges: tuple[Range, Range],
        fine: tuple[FloatArray, FloatArray, FloatArray],
        ratio: Callable[[FloatArray], float],
    ) -> None:
        self.scenario, self.ranges, self.ratio = scenario, ranges, ratio
        self.x, self.y, grid = fine
        self.cell = np.array([(each.high - each.low) / (len(each.values) - 1) for each in ranges])
        self.whole = [each.variable.quantum(scenario) is not None for each in ranges]
        # By cells of the rows, so that both keys compare.
        self.slopes = [
            slope * cell for slope, cell in zip(np.gradient(grid, self.y, self.x)[::-1], self.cell, strict=True)
        ]

    def corrected(self, line: FloatArray) -> FloatArray:
        """Points of a contour, each moved to where its distribution has the ratio of one; (n, 2)."""
        if all(self.whole):
            return line
        if any(self.whole):
            line = self._at_whole_steps(line)
        chosen = np.unique(np.linspace(0, len(line) - 1, min(len(line), _POINTS)).round().astype(int))
        moved = [self._moved(point) for point in line[chosen]]
        return np.array([point for point in moved if point is not None]).reshape(-1, 2)

    def _at_whole_steps(self, line: FloatArray) -> FloatArray:
        """Where a contour passes what a quantised key can take; no distribution is between."""
        k = self.whole.index(True)
        variable = self.ranges[k].variable
        quantum = variable.quantum(self.scenario)
        assert quantum is not None
        found: list[FloatArray] = []
        for a, b in pairwise(line):
            low, high = sorted((a[k], b[k]))
            for step in range(math.ceil(low / quantum - 1e-9), math.floor(high / quantum + 1e-9) + 1):
                value = variable.quantised(self.scenario, step * quantum)
                share = (value - a[k]) / (b[k] - a[k]) if a[k] != b[k] else 0.0
                point = a + min(max(share, 0.0), 1.0) * (b - a)
                point[k] = value
                if not found or not np.array_equal(found[-1], point):
                    found.append(point)
        return np.array(found).reshape(-1, 2)

    def _moved(self, point: FloatArray) -> FloatArray | None:
        """A point, moved along the key that changes the ratio more; None where no crossing is near."""
        i, j = np.abs(self.y - point[1]).argmin(), np.abs(self.x - point[0]).argmin()
        slopes = [0.0 if whole else float(slope[i, j]) for whole, slope in zip(self.whole, self.slopes, strict=True)]
        k = int(np.argmax(np.abs(slopes)))
        low, high = (
            max(self.ranges[k].low, point[k] - _MAX_CELLS * self.cell[k]),
            min(self.ranges[k].high, point[k] + _MAX_CELLS * self.cell[k]),
        )

        def place(value: float) -> FloatArray:
            new = point.copy()
            new[k] = min(max(value, low), high)
            return new

        here = point
        ratio = self.ratio(here)
        # Toward the crossing, ever farther, until it is passed.
        reach = max(abs(ratio / slopes[k]) if slopes[k] else 1.0, 1e-3) * self.cell[k]
        toward = -math.copysign(1.0, ratio * slopes[k])
        beyond, other = here, ratio
        for _ in range(_MAX_EVALUATIONS):
            if abs(ratio) < 0.5 * _CLOSE or ratio * other < 0:
                break
            here, ratio = beyond, other
            beyond = place(beyond[k] + 1.1 * toward * reach)
            if beyond[k] == here[k]:
                return None
            other, reach = self.ratio(beyond), 2 * reach
        for turn in range(_MAX_EVALUATIONS):
            if abs(ratio) < 0.5 * _CLOSE:
                return here
            if abs(other) < 0.5 * _CLOSE:
                return beyond
            if ratio * other > 0:
                return None
            if abs(beyond[k] - here[k]) < _NARROW * self.cell[k]:
                break
            share = 0.5 if turn % 3 == 2 else ratio / (ratio - other)
            between = place(here[k] + share * (beyond[k] - here[k]))
            middle = self.ratio(between)
            if middle * ratio > 0:
                here, ratio = between, middle
            else:
                beyond, other = between, middle
        # A jump of the force: the side that is allowed.
        return here if ratio < 0 else beyond


def _finer(x: FloatArray, y: FloatArray, ratio: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The ratio between the rows, where there are enough of them and none is beyond all bounds."""
    from scipy.interpolate import RectBivariateSpline

    if min(x.size, y.size) < 4 or np.abs(ratio).max() > 15:
        return x, y, ratio
    fine_x, fine_y = (np.interp(np.linspace(0, v.size - 1, _FINE), np.arange(v.size), v) for v in (x, y))
    return fine_x, fine_y, np.asarray(RectBivariateSpline(y, x, ratio, s=0)(fine_y, fine_x))
