"""Curves of equal risk: which pairs of two parameters just meet the limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.study.risk import allowed_force

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.collision import Scenario
    from bumpstop.study.variable import Range

# Accepted probabilities of passing a limit, one family of curves each.
RISKS = (0.1, 0.01, 1e-3, 1e-4)
_FINE = 129


def equal_risk_curves(scenario: Scenario, first: Range, second: Range, rows: pl.DataFrame) -> dict[str, Any]:
    """Where P(peak force over what is allowed) has each of :data:`RISKS`, over two ranges.

    The quantile at 1 - risk is smooth in both, unlike the probability: its ratio to the allowed force is contoured at
    one, on a cubic spline through the rows.

    Returns:
        ``keys``, ``controls``, and ``curves``: ``{risk, lines}``, a line as points ``[first, second]``.
    """
    from contourpy import contour_generator

    from bumpstop.collision import Problem

    own = rows.filter(
        (rows["kind"] == "pair") & (rows["key"] == first.variable.name) & (rows["key_2"] == second.variable.name)
    ).sort("value", "value_2")
    x, y = np.array(first.values), np.array(second.values)

    def at(a: float, b: float) -> Scenario:
        return second.variable.apply(first.variable.apply(scenario, a), b)

    allowed = np.array([[allowed_force(Problem.from_scenario(at(a, b))) for a in x] for b in y])
    curves = []
    for risk, column in zip(RISKS, ("p90_N", "p99_N", "p999_N", "p9999_N"), strict=True):
        quantile = own[column].to_numpy().reshape(x.size, y.size).T
        # Without bound is far over.
        ratio = np.log(np.where(np.isfinite(quantile), np.maximum(quantile, 1e-9), 1e9) / allowed)
        lines = contour_generator(*_finer(x, y, ratio)).lines(0.0)
        curves.append({"risk": risk, "lines": [np.asarray(line).tolist() for line in lines]})
    return {
        "keys": [first.variable.name, second.variable.name],
        "labels": [first.variable.label, second.variable.label],
        "ends": [[first.low, first.high], [second.low, second.high]],
        "controls": [first.variable.value(scenario), second.variable.value(scenario)],
        "curves": curves,
    }


def _finer(x: FloatArray, y: FloatArray, ratio: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The ratio between the rows, where there are enough of them and none is beyond all bounds."""
    from scipy.interpolate import RectBivariateSpline

    if min(x.size, y.size) < 4 or np.abs(ratio).max() > 15:
        return x, y, ratio
    fine_x, fine_y = (np.interp(np.linspace(0, v.size - 1, _FINE), np.arange(v.size), v) for v in (x, y))
    return fine_x, fine_y, np.asarray(RectBivariateSpline(y, x, ratio, s=0)(fine_y, fine_x))
