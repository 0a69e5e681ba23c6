"""From a scenario with ``[uncertainty]`` to a verdict with an interval."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray, as_whole_number
from bumpstop.collision.distribution.monte_carlo_blocks import Progress
from bumpstop.collision.scenario.scenario import as_scenario
from bumpstop.errors import InputError
from bumpstop.uncertainty.assumed_search import AssumedSearch, search_assumed
from bumpstop.uncertainty.conclusion import conclude
from bumpstop.uncertainty.point_evaluation import PointEvaluator, Points
from bumpstop.uncertainty.result import TornadoBar, UncertainCase, UncertainResult, rank_of

if TYPE_CHECKING:
    from bumpstop.collision import Scenario

# Points beyond the confident one, at least.
_BEYOND = 10
_MIN_POINTS, _MAX_POINTS = 64, 65_536


def evaluate_uncertain(
    scenario: Scenario,
    *,
    points: int | None = None,
    samples: int | None = None,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> UncertainResult:
    """Compute the verdict of a scenario with ``[uncertainty]``, and how sure it is.

    The inputs that have a distribution are drawn at well-spread points (Sobol's sequence, scrambled; Owen 1998), and
    the collision is integrated at each. What is assumed stays in its central case meanwhile; a bounded search then
    looks for its worst and its best values, and the points are repeated there.

    Args:
        scenario: with ``[uncertainty]``.
        points: drawn; a power of two from 64 to 65 536. None: the least with ten beyond ``verdict.confidence``.
        samples: runs to draw at every point instead of integrating.
        seed: of points and runs, 0 to 2^64 - 1. The same seed gives the same figures, whatever the threads.
        threads: that share the points, 1 to 256; None: as many as there are processors.
        progress: told the share that is done.

    Raises:
        InputError: there is no ``[uncertainty]``, or a point cannot be computed.
    """
    if not as_scenario(scenario).uncertainty:
        raise InputError("uncertainty", "is missing", "wanted a table [uncertainty]; without one see evaluate")
    confidence = scenario.verdict.confidence
    seed = as_whole_number(seed, "seed", 0, 2**64 - 1, "0 to 2^64 - 1")
    if threads is not None:
        as_whole_number(threads, "threads", 1, 256)
    count = points_for(confidence) if points is None else _checked_points(points)
    share = _Share(progress)
    evaluator = PointEvaluator(scenario, samples=samples, seed=seed, threads=threads, told=share.done)
    figures = evaluator.central_figures
    measured = [j for j, each in enumerate(evaluator.inputs) if not each.assumed]
    assumed = len(figures) - len(measured)
    share.expect((count if measured else 1) * (3 if assumed else 1) + 2 * len(figures) + 100 * assumed)

    central = evaluator.result_at(figures)
    middle = evaluator.at(figures[None])
    drawn = _drawn(evaluator, measured, count, seed)
    base = evaluator.at(drawn, with_force=True)
    at_confidence = int(np.argsort(evaluator.exceedance_ratio(base), kind="stable")[rank_of(confidence, len(base))])
    found: tuple[str, ...] = ()
    worst = best = base
    if assumed:
        search = search_assumed(evaluator, drawn[at_confidence], confidence)
        worst = _repeated(evaluator, drawn, search.worst)
        best = _repeated(evaluator, drawn, search.best)
        found = _deciding(evaluator, search)
    conclusion, reason = conclude(evaluator, middle, (best, base, worst), confidence, found)
    over = np.sort(base.p_over)
    result = UncertainResult(
        scenario=scenario,
        central=central,
        inputs=evaluator.inputs,
        cases=(
            _case("central", middle, 0, 0),
            _case("confident", base, rank_of(confidence, len(base)), at_confidence),
            _case("worst", worst, rank_of(confidence, len(worst)), at_confidence),
        ),
        p_over_interval=(
            float(over[rank_of(1 - confidence, len(over))]),
            float(over[rank_of(confidence, len(over))]),
        ),
        tornado=_tornado(evaluator, confidence),
        points=base,
        confidence=confidence,
        conclusion=conclusion,
        reason=reason,
        deciding=found,
        evaluations=evaluator.evaluations + 1,
        seed=seed,
        notes=_notes(evaluator),
    )
    share.finished()
    return result


def points_for(confidence: float) -> int:
    """The least power of two that leaves ten points beyond a confidence."""
    return max(_MIN_POINTS, 1 << math.ceil(math.log2(_BEYOND / (1 - confidence)) - 1e-9))


def _checked_points(points: int) -> int:
    count = as_whole_number(points, "points", _MIN_POINTS, _MAX_POINTS)
    if count & (count - 1):
        raise InputError("points", f"is {count}", f"wanted a power of two from {_MIN_POINTS} to {_MAX_POINTS}")
    return count


def _drawn(evaluator: PointEvaluator, measured: list[int], count: int, seed: int) -> FloatArray:
    """Points of the inputs that have a distribution, the others central (n, inputs)."""
    from scipy.stats import qmc

    if not measured:
        return evaluator.central_figures[None]
    sequence = qmc.Sobol(len(measured), scramble=True, seed=np.random.default_rng(seed))
    u = sequence.random(count)
    rows = np.tile(evaluator.central_figures, (count, 1))
    for column, j in enumerate(measured):
        rows[:, j] = evaluator.inputs[j].quantile(u[:, column])
    return rows


def _repeated(evaluator: PointEvaluator, drawn: FloatArray, assumed_as: FloatArray) -> Points:
    """The same points with other values of what is assumed."""
    rows = drawn.copy()
    for j, each in enumerate(evaluator.inputs):
        if each.assumed:
            rows[:, j] = assumed_as[j]
    return evaluator.at(rows)


def _deciding(evaluator: PointEvaluator, search: AssumedSearch) -> tuple[str, ...]:
    return tuple(evaluator.inputs[j].key for j in search.deciding)


def _case(name: str, points: Points, rank: int, representative: int) -> UncertainCase:
    p_over, false_alarm, utilisation = (
        float(np.sort(values)[rank]) for values in (points.p_over, points.false_alarm, points.utilisation)
    )
    return UncertainCase(name, p_over, false_alarm, utilisation, points.figures[representative])


def _tornado(evaluator: PointEvaluator, confidence: float) -> tuple[TornadoBar, ...]:
    """One input at a time from end to end of its range, all others central."""
    central, bars = evaluator.central_figures, []
    ends = np.array([each.limits(confidence) for each in evaluator.inputs])
    rows = np.repeat(central[None], 2 * len(central), axis=0)
    for j in range(len(central)):
        rows[2 * j : 2 * j + 2, j] = ends[j]
    points = evaluator.at(rows)
    for j, each in enumerate(evaluator.inputs):
        low, high = 2 * j, 2 * j + 1
        bars.append(
            TornadoBar(
                key=each.key,
                low=float(ends[j, 0]),
                high=float(ends[j, 1]),
                utilisation_low=float(points.utilisation[low]),
                utilisation_high=float(points.utilisation[high]),
                p_over_low=float(points.p_over[low]),
                p_over_high=float(points.p_over[high]),
                assumed=each.assumed,
                relative=each.input.relative,
            )
        )
    return tuple(sorted(bars, key=lambda bar: -bar.swing))


def _notes(evaluator: PointEvaluator) -> tuple[str, ...]:
    notes = [
        f"{each.key}: {100 * each.outside:.2g} % of its distribution are values that it cannot have, and were cut off."
        for each in evaluator.inputs
        if each.outside > 1e-6
    ]
    step = evaluator.scenario.simulation.step_s
    for each in evaluator.inputs:
        if each.key in ("reaction.latency_s", "reaction.dead_time_s"):
            notes.append(f"{each.key} counts in whole simulation steps of {1e3 * step:g} ms, rounded up.")
    return tuple(notes)


@dataclass
class _Share:
    """How far the work is, from the points that are done."""

    progress: Callable[[float], None] | None
    expected: int = 1
    count: int = 0

    def expect(self, points: int) -> None:
        self.expected = points

    def done(self, points: int) -> None:
        self.count += points
        if self.progress is not None:
            self.progress(min(0.99, self.count / self.expected))

    def finished(self) -> None:
        if self.progress is not None:
            self.progress(1.0)
