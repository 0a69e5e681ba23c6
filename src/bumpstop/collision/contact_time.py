"""How long the contact lasts: from touch until the reversing arm has let go."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.collision.distribution import CellDistribution

if TYPE_CHECKING:
    from bumpstop.collision.problem import Problem

# Cells per panel: inside a panel the time of release bends a little with the offset.
_CELLS = 8


class ReleaseTimes:
    """When the contact force is gone after a reaction that reverses, by tick of detection and offset."""

    def __init__(self, problem: Problem, curve: Any, ticks: np.ndarray, least_offset: np.ndarray) -> None:
        """Simulate the reactions to ``ticks`` until the point is back behind the ``least_offset`` [m] of each."""
        self._step = problem.scenario.simulation.step_s
        self._begin = {int(k): int(k) * problem.period_steps + 1 + problem.latency_steps for k in ticks}
        paths = curve.reaction_paths([int(k) for k in ticks], [float(o) for o in least_offset])
        self._path = {int(k): path for k, path in zip(ticks, paths, strict=True)}
        self._distance = curve.distance
        self._period = problem.period_steps

    def at(self, tick: int, offset: FloatArray) -> FloatArray:
        """Times [s] at which the distance falls below each offset for good; NaN where it never does."""
        begin = self._begin[tick]
        # From the tick on: what is left of the line, then the reaction.
        line = self._distance[tick * self._period + 1 : begin]
        path = np.concatenate([line, self._path[tick]])
        first = begin - line.size
        # Release is the last time the path is above the offset: search the falling envelope from the end.
        envelope = np.maximum.accumulate(path[::-1])[::-1]
        index = np.searchsorted(-envelope, -offset, side="left")  # first step at or below the offset, for good
        inside = (index > 0) & (index < path.size)
        last = np.clip(index, 1, path.size - 1)
        drop = path[last - 1] - path[last]
        part = np.where(drop > 0, (path[last - 1] - offset) / np.where(drop > 0, drop, 1.0), 0.0)
        return np.where(inside, (first + last - 1 + part) * self._step, np.nan)


def contact_times(distance: FloatArray, offset: FloatArray, step: float) -> FloatArray:
    """Times [s] at which the undisturbed path first passes each offset, linear between steps; NaN beyond its end."""
    reach = np.maximum.accumulate(distance)
    index = np.searchsorted(reach, offset, side="right")
    inside = index < reach.size
    last = np.clip(index, 1, reach.size - 1)
    rise = reach[last] - reach[last - 1]
    part = np.where(rise > 0, (offset - reach[last - 1]) / np.where(rise > 0, rise, 1.0), 0.0)
    return np.where(inside, (last - 1 + part) * step, np.nan)


def exact_contact_time(problem: Problem, curve: Any, law: Any) -> CellDistribution:
    """Contact time [s] of the exact law, given that the reaction ends a contact."""
    coefficients = law.coefficients
    mid, half, first_tick = law.panel_mid, law.panel_half, law.panel_first_tick
    slots, order, _ = coefficients.shape
    edges = np.linspace(-1.0, 1.0, _CELLS + 1)
    inside = _cell_integrals(order, edges)  # (cells, order)
    cells: dict[int, list[tuple[int, int]]] = {}
    for slot in range(slots - 1):
        for panel in np.flatnonzero(coefficients[slot, 0] > 1e-15):
            tick = int(first_tick[panel]) + slot - law.slots_before
            if 0 <= tick < curve.ticks:
                cells.setdefault(tick, []).append((slot, int(panel)))
    ticks = np.array(sorted(cells), dtype=np.int64)
    if not ticks.size:
        empty = np.zeros(0)
        return CellDistribution(empty, empty, empty)
    least = np.array([min(mid[p] - half[p] for _, p in cells[int(k)]) for k in ticks])
    release = ReleaseTimes(problem, curve, ticks, least)
    low, high, mass = [], [], []
    for k in ticks:
        slot, panel = np.array(cells[int(k)]).T
        offset = mid[panel, None] + half[panel, None] * edges
        touch = contact_times(curve.distance, offset.ravel(), problem.scenario.simulation.step_s).reshape(offset.shape)
        # Reactions to a false alarm touch later, on their own stopping path: no time of touch on the line.
        duration = release.at(int(k), offset.ravel()).reshape(offset.shape) - touch
        weight = np.einsum("cl,pl->pc", inside, coefficients[slot, :, panel])
        ends = np.stack([duration[:, :-1], duration[:, 1:]])
        known = np.isfinite(ends).all(axis=0) & (ends.min(axis=0) >= 0)
        low.append(ends.min(axis=0)[known])
        high.append(ends.max(axis=0)[known])
        mass.append(weight[known])
    return CellDistribution(np.concatenate(low), np.concatenate(high), np.concatenate(mass))


def sampled_contact_time(problem: Problem, curve: Any, tick: np.ndarray, offset: FloatArray) -> FloatArray:
    """Contact time [s] of every run (runs,); NaN for runs without contact or without a reaction that ends it."""
    result = np.full(tick.shape, np.nan)
    detected = tick >= 0
    ticks = np.unique(tick[detected])
    if not ticks.size:
        return result
    groups = {int(k): np.flatnonzero(tick == k) for k in ticks}
    least = np.array([offset[groups[int(k)]].min() for k in ticks])
    release = ReleaseTimes(problem, curve, ticks, least)
    touch = contact_times(curve.distance, offset, problem.scenario.simulation.step_s)
    for k, runs in groups.items():
        duration = release.at(k, offset[runs]) - touch[runs]
        result[runs] = np.where(duration > 0, duration, np.nan)
    return result


def _cell_integrals(order: int, edges: FloatArray) -> FloatArray:
    """Integral of every Legendre polynomial below ``order`` over every cell, (cells, order)."""
    values = np.polynomial.legendre.legvander(edges, order)
    antiderivative = np.empty((edges.size, order))
    antiderivative[:, 0] = edges
    for degree in range(1, order):
        antiderivative[:, degree] = (values[:, degree + 1] - values[:, degree - 1]) / (2 * degree + 1)
    return np.diff(antiderivative, axis=0)
