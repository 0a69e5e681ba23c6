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
from bumpstop.uncertainty.assumed_search import (
    AssumedSearch,
    has_ripple,
    ripple_shares,
    search_assumed,
    swapping_inputs,
)
from bumpstop.uncertainty.cases import TornadoBar, UncertainCase
from bumpstop.uncertainty.conclusion import JudgedCases, at_rank, conclude, rank_of, verdict_of
from bumpstop.uncertainty.dependence import dependence_note
from bumpstop.uncertainty.point_evaluation import PointEvaluator, Points
from bumpstop.uncertainty.result import UncertainResult

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
    assumed = sum(each.assumed for each in evaluator.inputs)
    drawn = count if assumed < len(figures) else 1
    share.expect(drawn * (3 if assumed else 1) + 2 * len(figures) + 50 * assumed)

    central = evaluator.result_at(figures)
    rows = drawn_rows(evaluator, count, seed)
    base = evaluator.at(rows, with_force=True)
    at_confidence = int(np.argsort(evaluator.exceedance_ratio(base), kind="stable")[rank_of(confidence, len(base))])
    worst: tuple[Points, ...] = ()
    best: Points | None = None
    deciding: tuple[str, ...] = ()
    if assumed:
        search = search_assumed(evaluator, figures, confidence)
        worst = tuple(evaluator.at(with_assumed(evaluator, rows, at)) for at in worst_of(search))
        if verdict_of(evaluator, base, confidence) != "acceptable":
            best = evaluator.at(with_assumed(evaluator, rows, search.best))
    cases = JudgedCases(evaluator.at(figures[None], far_tails=True), base, worst, best)
    found, others = cases.conclusions(evaluator, confidence)
    if set(others) - {found}:
        holds = found == "acceptable"
        deciding = swapping_inputs(
            evaluator,
            rows[at_confidence],
            confidence,
            lambda points: (evaluator.exceedance_ratio(points) <= 1) != holds,
        )
    conclusion, reason = conclude(evaluator, cases, confidence, deciding)
    notes = _notes(evaluator)
    if conclusion == "acceptable":
        together = dependence_note(evaluator, confidence, worst_of(search)[0] if assumed else figures)
        notes = notes if together is None else (together, *notes)
    over = np.sort(base.p_over)
    result = UncertainResult(
        scenario=scenario,
        central=central,
        inputs=evaluator.inputs,
        cases=(
            _case("central", (cases.middle,), confidence, 0),
            _case("confident", (base,), confidence, at_confidence),
            _case("worst", worst or (base,), confidence, at_confidence),
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
        deciding=deciding,
        evaluations=evaluator.evaluations + 1,
        seed=seed,
        notes=notes,
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


def drawn_rows(evaluator: PointEvaluator, count: int, seed: int) -> FloatArray:
    """Points of the inputs that have a distribution, what is assumed in its central case (n, inputs).

    Args:
        evaluator: of the scenario.
        count: of the points, where there is something to draw.
        seed: of the scrambling.
    """
    from scipy.stats import qmc

    drawn = [j for j, each in enumerate(evaluator.inputs) if not each.assumed]
    if not drawn:
        return evaluator.central_figures[None]
    sequence = qmc.Sobol(len(drawn), scramble=True, seed=np.random.default_rng(seed))
    u = sequence.random(count)
    rows = np.tile(evaluator.central_figures, (count, 1))
    for column, j in enumerate(drawn):
        rows[:, j] = evaluator.inputs[j].quantile(u[:, column])
    return rows


def with_assumed(evaluator: PointEvaluator, rows: FloatArray, figures: FloatArray) -> FloatArray:
    """The same points with other figures of what is assumed."""
    changed = rows.copy()
    for j, each in enumerate(evaluator.inputs):
        if each.assumed:
            changed[:, j] = figures[j]
    return changed


def worst_of(search: AssumedSearch) -> list[FloatArray]:
    """Where forces are worst, and false alarms where they count."""
    return [search.worst] if search.most_alarms is None else [search.worst, search.most_alarms]


def _case(name: str, runs: tuple[Points, ...], confidence: float, representative: int) -> UncertainCase:
    p_over, false_alarm, utilisation = (
        max(at_rank(getattr(points, name), confidence) for points in runs)
        for name in ("p_over", "false_alarm", "utilisation")
    )
    return UncertainCase(name, p_over, false_alarm, utilisation, runs[0].figures[representative])


def _tornado(evaluator: PointEvaluator, confidence: float) -> tuple[TornadoBar, ...]:
    """One input at a time from end to end of its range, all others central.

    The use of the limit by a single contact rises and falls over its distance, onset and speed: of these from its least
    to its greatest.
    """
    central, bars = evaluator.central_figures, []
    ends = np.array([each.limits(confidence) for each in evaluator.inputs])
    rows = np.repeat(central[None], 2 * len(central), axis=0)
    for j, each in enumerate(evaluator.inputs):
        if has_ripple(evaluator, each.key):
            shares = ripple_shares()
            along = np.tile(central, (shares.size, 1))
            along[:, j] = ends[j, 0] + np.ptp(ends[j]) * shares
            use = evaluator.at(along).utilisation
            ends[j] = along[[int(use.argmin()), int(use.argmax())], j]
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
