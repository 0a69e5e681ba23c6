"""The distribution of the peak force against the limits."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.report.collision.bins import bins, why_no_figure
from bumpstop.report.colours import AREA, EVENT, LAW
from bumpstop.terminal import number
from bumpstop.view.plots.chart import Chart, nothing, stairs

if TYPE_CHECKING:
    from bumpstop.report.markup import Html
    from bumpstop.view.answer import Answer

# A limit farther away than this many times the forces would press them into a corner: it is named with an arrow.
_MAX_STRETCH = 2.5
_MIN_PROBABILITY, _TAIL_POINTS = 1e-6, 120


def distribution_plot(answer: Answer, before: Answer | None = None) -> Html:
    """Density of the peak force with limits, median and p99; with ``before`` dashed in the same scale.

    Args:
        answer: of the scenario on screen.
        before: of one to compare with.
    """
    result = answer.result
    edges = bins(result.peak_force, result.samples)
    name, title = "distribution", "Peak force"
    if not edges.size:
        return nothing(title, f"No figure: {why_no_figure(result)}.", name)
    others = np.zeros(0) if before is None else bins(before.result.peak_force, before.result.samples)
    low, high = _range(answer, edges, others)
    density = result.peak_force.density(edges)
    top = float(density.max())
    if others.size and before is not None:
        top = max(top, float(before.result.peak_force.density(others).max()))
    chart = Chart(title, (low, high), (0.0, 1.35 * top), labels=("peak force [N]", "density [1/N]"), name=name)
    if answer.peak_limit_N < high:
        chart.beyond(answer.peak_limit_N)
    x, y = stairs(edges, density)
    chart.area(x, y, AREA, LAW)
    if others.size and before is not None:
        chart.line(*stairs(others, before.result.peak_force.density(others)), LAW, dash="3 3")
    for limit, force in answer.limits_N:
        if math.isfinite(force):
            chart.vertical(force, f"{limit} {number(force)} N", dash="6 3" if limit.startswith("force") else "2 3")
    for label, p, dash in (("median", 0.5, "1 0"), ("p99", 0.99, "8 3 2 3")):
        value = result.peak_force.quantile(p)
        if math.isfinite(value):
            chart.vertical(value, f"{label} {number(value)} N", EVENT, dash=dash)
    return chart.svg()


def exceedance_plot(answer: Answer) -> Html:
    """Probability that the peak is higher than a force, on a logarithmic scale, with what is accepted."""
    result = answer.result
    edges = bins(result.peak_force, result.samples)
    name, title = "exceedance", "Risk of a higher peak"
    if not edges.size:
        return nothing(title, "No figure: too few collisions have a force with a bound.", name)
    low, high = _range(answer, edges, np.zeros(0))
    marked = [min(force, high) for _, force in answer.marked_limits_N]
    x = np.unique(np.append(np.linspace(low, high, _TAIL_POINTS), marked))
    tail = np.maximum([result.peak_force.exceedance(float(force)) for force in x], _MIN_PROBABILITY)
    chart = Chart(
        title, (low, high), (_MIN_PROBABILITY, 1.0), labels=("peak force [N]", "probability"), log_y=True, name=name
    )
    chart.line(x, tail, LAW)
    accepted = answer.scenario.verdict.accepted_probability
    if answer.limits_N:
        chart.horizontal(accepted, f"accepted {accepted:g}")
        for limit, force in answer.marked_limits_N:
            if force <= high:
                chart.vertical(force, f"{limit} {number(force)} N")
                chart.mark(force, float(tail[int(np.searchsorted(x, force))]))
    return chart.svg()


def _range(answer: Answer, edges: np.ndarray, others: np.ndarray) -> tuple[float, float]:
    """From zero, unless that wastes half the width; to the lowest limit, unless it is far away."""
    both = np.concatenate([edges, others])
    low, high = float(both.min()), float(both.max())
    limit = answer.peak_limit_N
    if low < 0.5 * high or limit < low:
        low = 0.0
    if high < limit < low + _MAX_STRETCH * (high - low):
        high = limit + 0.06 * (limit - low)
    return low, high
