"""How long the contact lasts: from touch until the reversing arm has let go."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.collision.distribution.mixture import MixtureDistribution

if TYPE_CHECKING:
    from bumpstop._native import CollisionDistribution, LineStoppingCurve
    from bumpstop.collision.problem import CollisionProblem

# Cells per piece, and nodes for the moments: inside a panel the time of release bends a little with the offset. Where a
# force grows slowly there are millions of pieces, each a sliver of the whole: then they have fewer, but at least one
# cell and two nodes.
_CELLS, _NODES = 16, 12
_MAX_CELLS = 400_000
# But pieces of panels that span more than this share of all offsets count by themselves: where a reaction goes far
# beyond the line a few panels, as wide as the offset's density allows, may hold much of the probability.
_SLIVER = 1 / 64
# Pieces with less probability than this are left out: there may be thousands of them.
_NEGLIGIBLE = 1e-11


class ReleaseTimes:
    """How long the contact lasts when the arm reverses, by tick of detection and offset."""

    def __init__(
        self, problem: CollisionProblem, curve: LineStoppingCurve, ticks: np.ndarray, least_offset: np.ndarray
    ) -> None:
        """Simulate the reactions to ``ticks`` until the point is back behind the ``least_offset`` [m] of each."""
        self._step = problem.scenario.simulation.step_s
        # Where a line ends while the latency runs, the arm brakes from there.
        last = len(curve.distance) - 1
        self._begin = {int(k): min(int(k) * problem.period_steps + 1 + problem.latency_steps, last) for k in ticks}
        paths = curve.reaction_paths([int(k) for k in ticks], [float(o) for o in least_offset])
        self._path = {int(k): path for k, path in zip(ticks, paths, strict=True)}
        self._distance = curve.distance

    def phases(self, tick: int, offset: FloatArray, first_s: float) -> tuple[FloatArray, FloatArray]:
        """Deepest compression in the first ``first_s`` seconds of contact, and after: two arrays like ``offset`` [m].

        An arm whose path ends in contact stays there; one that has reversed has let go by then.
        """
        path = np.concatenate([self._distance[: self._begin[tick]], self._path[tick]])
        touch = np.nan_to_num(first_passage_times(path, offset, self._step), nan=np.inf)
        end = (touch + first_s) / self._step  # of the first phase, within a step
        turn = np.minimum(np.ceil(end - 1e-9), path.size).astype(np.int64)
        between = np.interp(end, np.arange(path.size), path)
        reached = np.maximum.accumulate(path)
        rest = path[-1]  # where the arm stays, unless it has let go
        ahead = np.append(np.maximum.accumulate(np.append(path, rest)[::-1])[::-1][: path.size], rest)
        first = np.where(np.isfinite(touch), np.maximum(reached[np.maximum(turn - 1, 0)], between) - offset, 0.0)
        late = np.where(np.isfinite(touch), np.maximum(ahead[turn], between) - offset, 0.0)
        return np.maximum(first, 0.0), np.maximum(late, 0.0)

    def max_distance(self, tick: int) -> float:
        """Greatest distance [m] of the case that is detected at a tick."""
        return float(max(self._path[tick].max(), self._distance[: self._begin[tick]].max(initial=-np.inf)))

    def left_in_contact(self, tick: int, offset: FloatArray) -> np.ndarray:
        """Whether the arm still presses a body at each offset where its reaction is followed no farther."""
        return np.asarray(self._path[tick][-1] > offset)

    def at(self, tick: int, offset: FloatArray) -> FloatArray:
        """Times [s] from the first touch until the distance is below each offset for good; NaN without contact."""
        # The whole path of this case: the line up to the reaction, then the reaction.
        path = np.concatenate([self._distance[: self._begin[tick]], self._path[tick]])
        touch = first_passage_times(path, offset, self._step)
        # Release is the last time the path is above the offset: search the falling envelope from the end.
        envelope = np.maximum.accumulate(path[::-1])[::-1]
        index = np.searchsorted(-envelope, -offset, side="left")  # first step at or below the offset, for good
        inside = (index > 0) & (index < path.size)
        last = np.clip(index, 1, path.size - 1)
        drop = path[last - 1] - path[last]
        part = np.where(drop > 0, (path[last - 1] - offset) / np.where(drop > 0, drop, 1.0), 0.0)
        return np.where(inside, (last - 1 + part) * self._step - touch, np.nan)


def first_passage_times(distance: FloatArray, offset: FloatArray, step: float) -> FloatArray:
    """Times [s] at which a path first passes each offset, linear between steps; NaN beyond its end."""
    index = np.searchsorted(np.maximum.accumulate(distance), offset, side="right")
    inside = index < distance.size
    last = np.clip(index, 1, distance.size - 1)
    # A point that comes forward again may have been farther than a step ago.
    rise = distance[last] - distance[last - 1]
    part = np.where(rise > 0, (offset - distance[last - 1]) / np.where(rise > 0, rise, 1.0), 0.0)
    return np.where(inside, (last - 1 + part) * step, np.nan)


@dataclass(frozen=True, eq=False)
class Cells:
    """The integrated distribution's detections at one tick, cut into cells of offset.

    Attributes:
        spans: the paths of these collisions.
        tick: of detection.
        edge: ends of the cells (pieces, cells + 1) [m].
        mass: probability of each cell (pieces, cells).
        node, node_mass: offsets [m] and probabilities of a quadrature (pieces, nodes), finer than cells.
        mid, half: of each piece's panel (pieces,) [m].
        series: Legendre series of the offset's density over that panel, per unit of it (pieces, order).
    """

    spans: ReleaseTimes
    tick: int
    edge: FloatArray
    mass: FloatArray
    node: FloatArray
    node_mass: FloatArray
    mid: FloatArray
    half: FloatArray
    series: FloatArray

    def finer(self, wanted: np.ndarray, parts: int) -> tuple[FloatArray, FloatArray]:
        """Some cells cut into equal parts: their ends (n, parts + 1) [m] and probabilities (n, parts).

        Args:
            wanted: which cells (pieces, cells).
            parts: of each.
        """
        piece, cell = np.nonzero(wanted)
        low, high = self.edge[piece, cell][:, None], self.edge[piece, cell + 1][:, None]
        edge = low + (high - low) * np.linspace(0.0, 1.0, parts + 1)
        unit = (edge - self.mid[piece][:, None]) / self.half[piece][:, None]
        below = np.einsum("pel,pl->pe", antiderivatives(unit, self.series.shape[1]), self.series[piece])
        return edge, np.diff(below, axis=1)


def _cell_count(pieces: int) -> int:
    return int(np.clip(_MAX_CELLS // max(pieces, 1), 1, _CELLS))


@cache
def _unit_quadrature(nodes: int) -> tuple[FloatArray, FloatArray]:
    """Gauss nodes and weights on 0 to 1."""
    node, weight = np.polynomial.legendre.leggauss(nodes)
    unit = (node + 1) / 2, weight / 2
    for values in unit:
        values.flags.writeable = False  # of all who ask
    return unit


@dataclass(frozen=True, eq=False)
class _Detections:
    """Where the integrated distribution has detections, tick by tick.

    Attributes:
        slot, panel: of each piece of the distribution (pieces,), by tick.
        ticks: of detection, each once.
        begin: where in the pieces each tick begins.
        least_offset: of the panels of each tick [m].
        span: of all offsets with a piece, also those after the last tick [m].
    """

    slot: npt.NDArray[np.int64]
    panel: npt.NDArray[np.int64]
    ticks: npt.NDArray[np.int64]
    begin: npt.NDArray[np.int64]
    least_offset: FloatArray
    span: float

    @classmethod
    def of(cls, curve: LineStoppingCurve, law: CollisionDistribution) -> _Detections:
        slots = law.coefficients.shape[0]
        slot, panel = np.nonzero(law.coefficients[: slots - 1, 0] > _NEGLIGIBLE)
        detection = np.asarray(law.panel_first_tick)[panel].astype(np.int64) + slot - law.slots_before
        # One tick after the last stand the bodies that an arm reaches only while it brakes at the end of its line.
        known = (detection >= 0) & (detection <= curve.ticks)
        order = np.flatnonzero(known)[np.argsort(detection[known], kind="stable")]
        ticks, begin = np.unique(detection[order], return_index=True)
        low, high = law.panel_mid - law.panel_half, law.panel_mid + law.panel_half
        least = np.minimum.reduceat(low[panel[order]], begin) if ticks.size else np.zeros(0)
        span = float(high[panel].max() - low[panel].min()) if panel.size else 0.0
        return cls(slot[order], panel[order], ticks, begin, least, span)


def may_be_left_in_contact(problem: CollisionProblem, curve: LineStoppingCurve, law: CollisionDistribution) -> bool:
    """Whether any reaction of an integrated distribution ends ahead of the nearest body that it may have detected."""
    found = _Detections.of(curve, law)
    if not found.ticks.size:
        return False
    spans = ReleaseTimes(problem, curve, found.ticks, found.least_offset)
    return any(
        k < curve.ticks and spans.left_in_contact(int(k), least).any()
        for k, least in zip(found.ticks, found.least_offset[:, None], strict=True)
    )


def exact_cells(problem: CollisionProblem, curve: LineStoppingCurve, law: CollisionDistribution) -> Iterator[Cells]:
    """Cut all detections of an integrated distribution into cells, tick by tick; those of wide panels by themselves."""
    coefficients, mid, half = law.coefficients, law.panel_mid, law.panel_half
    order = coefficients.shape[1]
    found = _Detections.of(curve, law)
    if not found.ticks.size:
        return
    wide = 2 * half[found.panel] > _SLIVER * found.span
    cells_in = {group: _cell_count(int(np.sum(wide == group))) for group in (False, True)}
    spans = ReleaseTimes(problem, curve, found.ticks, found.least_offset)
    parts = [
        (int(k), own[wide[own] == group], cells)
        for k, own in zip(found.ticks, np.split(np.arange(found.slot.size), found.begin[1:]), strict=True)
        for group, cells in cells_in.items()
    ]
    for k, own, cells in parts:
        if not own.size:
            continue
        unit_node, unit_weight = _unit_quadrature(max(2, _NODES * cells // _CELLS))
        slot, panel = found.slot[own], found.panel[own]
        # Where a stopping path barely arrives, its contact grows from nothing like a square root: the panel ends at the
        # farthest point, and places crowd there.
        top = np.clip((spans.max_distance(k) - mid[panel]) / np.maximum(half[panel], 1e-300), -1.0, 1.0)
        grazing = slot < law.slots_before
        top = np.where(grazing, top, 1.0)[:, None]
        power = np.where(grazing, 2.0, 1.0)[:, None]
        width = top + 1.0
        edge = top - width * np.linspace(1.0, 0.0, cells + 1) ** power
        node = top - width * unit_node**power
        series = coefficients[slot, :, panel]
        below = np.einsum("pel,pl->pe", antiderivatives(edge, order), series)
        density = np.einsum("pnl,pl->pn", np.polynomial.legendre.legvander(node, order - 1), series)
        place = mid[panel][:, None], half[panel][:, None]
        yield Cells(
            spans=spans,
            tick=k,
            edge=place[0] + place[1] * edge,
            mass=np.diff(below, axis=1),
            node=place[0] + place[1] * node,
            node_mass=density * width * power * unit_node ** (power - 1) * unit_weight,
            mid=mid[panel],
            half=half[panel],
            series=series,
        )


def integrated_contact_duration(
    problem: CollisionProblem, curve: LineStoppingCurve, law: CollisionDistribution
) -> tuple[MixtureDistribution, float]:
    """Contact time [s] of the integrated distribution, given that the reaction ends a contact.

    Also the probability that a reaction does not, as far as it is followed.
    """
    parts: list[tuple[FloatArray, ...]] = [(np.zeros(0),) * 5]
    unended = 0.0
    for cells in exact_cells(problem, curve, law):
        ends = cells.spans.at(cells.tick, cells.edge.ravel()).reshape(cells.edge.shape)
        value = cells.spans.at(cells.tick, cells.node.ravel()).reshape(cells.node.shape)
        low, high = np.minimum(ends[:, 1:], ends[:, :-1]), np.maximum(ends[:, 1:], ends[:, :-1])
        known, lasts = np.isfinite(low) & np.isfinite(high), np.isfinite(value)
        parts.append((low[known], high[known], cells.mass[known], value[lasts], cells.node_mass[lasts]))
        if cells.tick < curve.ticks:
            left = cells.spans.left_in_contact(cells.tick, cells.node)
            unended += float(cells.node_mass[left].sum())
    return MixtureDistribution.of_cells(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True))), unended


def monte_carlo_contact_duration(
    problem: CollisionProblem, curve: LineStoppingCurve, tick: np.ndarray, offset: FloatArray
) -> FloatArray:
    """Contact time [s] of every run (runs,); NaN for runs without contact or without a reaction that ends it."""
    result = np.full(tick.shape, np.nan)
    spans, groups = _runs_by_tick(problem, curve, tick, offset)
    for k, runs in groups.items():
        result[runs] = spans.at(k, offset[runs])
    return result


def monte_carlo_left_in_contact(
    problem: CollisionProblem, curve: LineStoppingCurve, tick: np.ndarray, offset: FloatArray
) -> float:
    """Share of all runs that the arm still presses where its reaction is followed no farther."""
    spans, groups = _runs_by_tick(problem, curve, tick, offset)
    left = (int(spans.left_in_contact(k, offset[runs]).sum()) for k, runs in groups.items() if k < curve.ticks)
    return sum(left) / tick.size


def _runs_by_tick(
    problem: CollisionProblem, curve: LineStoppingCurve, tick: np.ndarray, offset: FloatArray
) -> tuple[ReleaseTimes, dict[int, np.ndarray]]:
    """The reactions of all detected runs, and the runs of each by its tick."""
    ticks = np.unique(tick[tick >= 0])
    groups = {int(k): np.flatnonzero(tick == k) for k in ticks}
    least = np.array([offset[runs].min() for runs in groups.values()])
    return ReleaseTimes(problem, curve, ticks, least), groups


def antiderivatives(x: FloatArray, order: int) -> FloatArray:
    """Antiderivative of every Legendre polynomial below ``order`` at x, (..., order)."""
    values = np.polynomial.legendre.legvander(x, order)
    result = np.empty((*x.shape, order))
    result[..., 0] = x
    for degree in range(1, order):
        result[..., degree] = (values[..., degree + 1] - values[..., degree - 1]) / (2 * degree + 1)
    return result
