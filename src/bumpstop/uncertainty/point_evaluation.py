"""What one point of the uncertain inputs comes to: probabilities over the limits, and how far they are used."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.collision import CollisionProblem, evaluate, integrate, stopping_curve
from bumpstop.collision.distribution.distribution import FAR, ExactDistribution
from bumpstop.collision.evaluation import RESAMPLED_RUNS
from bumpstop.collision.probability_text import apart, none_of, percent, small_percent
from bumpstop.collision.verdict.two_phase_use import TwoPhaseUse
from bumpstop.collision.verdict.verdict_notes import MAX_UNTOUCHED, untouched_share
from bumpstop.errors import InputError
from bumpstop.uncertainty.resolved_input import ResolvedInput, changes_of, resolve

if TYPE_CHECKING:
    from bumpstop.collision import CollisionResult, Scenario

# Exceedance probabilities at which the force of every point is kept, for the band of the curve.
LEVELS = np.array([0.99, 0.9, 0.75, 0.5, 0.25, 0.1, 0.03, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 1e-5, 1e-6])
# Far below what is accepted, nobody asks for the digits of a tail that is computed by itself.
_MARGIN = 10.0
# Where so little is accepted, sentences spell out what is next to nothing.
_SMALL = 1e-4


@dataclass(frozen=True, eq=False)
class Points:
    """Points of the inputs and what they come to.

    Attributes:
        figures: of the inputs (n, inputs): values, or factors where an input is relative.
        p_over: probability of exceeding the force or the pressure limit in one contact, the greater (n,); NaN without
            limits.
        false_alarm: probability of an alarm before contact (n,).
        utilisation: peak force that is exceeded with the accepted probability, as a share of the allowed force (n,);
            without limits the force itself [N]. Infinite where more than that are never detected.
        untouched: probability that nothing is hit (n,).
        force: peak force exceeded with the probabilities of :data:`LEVELS` (n, levels) [N]; empty where not asked for.
    """

    figures: FloatArray
    p_over: FloatArray
    false_alarm: FloatArray
    utilisation: FloatArray
    untouched: FloatArray
    force: FloatArray

    def __len__(self) -> int:
        return len(self.figures)

    @classmethod
    def joined(cls, parts: Sequence[Points]) -> Points:
        """One after the other."""
        names = ("figures", "p_over", "false_alarm", "utilisation", "untouched", "force")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


class PointEvaluator:
    """Evaluates points of the uncertain inputs of a scenario.

    Attributes:
        scenario: without ``[uncertainty]``.
        problem: of the scenario as given.
        inputs: the uncertain ones, in the order of the figures of a point.
        evaluations: points computed so far.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        samples: int | None = None,
        seed: int = 0,
        threads: int | None = None,
        told: Callable[[int], None] | None = None,
        far_tails: bool = False,
    ) -> None:
        """Prepare a scenario.

        Args:
            scenario: with or without ``[uncertainty]``.
            samples: runs to draw at every point; None: integrate, but 100 000 runs where noise was measured.
            seed: of the runs: the same at every point, so that differences are those of the inputs.
            threads: None: as many as there are processors.
            told: called with the number of points that were computed since.
            far_tails: compute probabilities below 1e-6 by themselves, as :func:`bumpstop.evaluate` does; it takes
                longer. They are so, anyway, where little more is accepted.

        Raises:
            InputError: the scenario or an uncertain input cannot be used.
        """
        self.problem = CollisionProblem.from_scenario(scenario)
        self.inputs: tuple[ResolvedInput, ...] = resolve(self.problem)
        self.scenario = scenario.without_uncertainty()
        self.evaluations = 0
        self._samples, self._seed = samples, seed
        self._threads = threads or self.processors()
        self._told = told or (lambda count: None)
        self._far_tails = far_tails or not scenario.verdict.accepted_probability > _MARGIN * FAR

    @property
    def integrated(self) -> bool:
        """Whether the probabilities of points are integrated, and not counted among drawn collisions."""
        return self._samples is None and self.problem.residuals is None

    @property
    def runs(self) -> int | None:
        """Collisions that are drawn at every point; None: none are."""
        return None if self.integrated else self._samples or RESAMPLED_RUNS

    def said(self, p: float, accepted: float) -> str:
        """A probability as sentences say it, with digits that tell it from what is accepted."""
        return self._apart(p, accepted, up=False)

    def said_up(self, p: float, accepted: float) -> str:
        """An upper end of probabilities: no less than it is."""
        return self._apart(p, accepted, up=True)

    def _apart(self, p: float, accepted: float, *, up: bool) -> str:
        text = small_percent if accepted < _SMALL else percent
        if self.runs is not None and not p > 0:
            return none_of(self.runs, text)
        return apart(p, accepted, partial(text, integrated=self.integrated, up=up), up=up)

    def said_at_most(self, p: float, accepted: float) -> str:
        """An upper end of probabilities, to follow "probability"."""
        text = self.said_up(p, accepted)
        return text if text.startswith("less") else f"{'' if text.startswith('over') else 'of at most '}{text}"

    @staticmethod
    def processors() -> int:
        """That this process may use; not every system tells."""
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

    @cached_property
    def central_figures(self) -> FloatArray:
        """Medians of distributions, given values or middles of intervals (inputs,)."""
        return np.array([each.central for each in self.inputs])

    def scenario_at(self, figures: FloatArray) -> Scenario:
        """The scenario of a point.

        Raises:
            InputError: it cannot be computed; the message names the point.
        """
        if not self.inputs:
            return self.scenario
        changes = changes_of(self.inputs, figures, self.problem)
        try:
            return self.scenario.with_values(changes)
        except InputError as error:
            raise self._at(figures, error) from None

    def result_at(self, figures: FloatArray) -> CollisionResult:
        """The whole distribution at a point.

        Raises:
            InputError: it cannot be computed; the message names the point.
        """
        scenario = self.scenario_at(figures)
        try:
            problem = CollisionProblem.from_scenario(scenario)
            if self._samples is not None or problem.residuals is not None or problem.trajectory is not None:
                return evaluate(scenario, samples=self._samples, seed=self._seed)
            return integrate(problem, stopping_curve(problem))
        except InputError as error:
            raise self._at(figures, error) from None

    def _at(self, figures: FloatArray, error: InputError) -> InputError:
        point = ", ".join(f"{each.key} {figure:.4g}" for each, figure in zip(self.inputs, figures, strict=True))
        return InputError(error.field, f"{error.problem} (at a point of [uncertainty]: {point})", error.valid)

    def at(self, figures: FloatArray, *, with_force: bool = False, far_tails: bool = False) -> Points:
        """Evaluate points.

        Args:
            figures: (n, inputs).
            with_force: keep forces for the band of the exceedance curve.
            far_tails: compute probabilities below 1e-6 by themselves, at all of these points.
        """
        far_tails = far_tails or self._far_tails
        workers = min(self._threads, len(figures))
        if workers <= 1:
            found = [self._one(row, with_force, far_tails) for row in figures]
        else:
            with ThreadPoolExecutor(workers) as pool:
                found = list(pool.map(lambda row: self._one(row, with_force, far_tails), figures))
        return Points.joined(found) if found else _no_points(len(self.inputs))

    def _one(self, row: FloatArray, with_force: bool, far_tails: bool) -> Points:
        result = self.result_at(row)
        accepted = self.scenario.verdict.accepted_probability
        over, utilisation = _over_and_utilisation(result, accepted, far_tails=far_tails)
        force = [result.peak_force.quantile(1 - level) for level in LEVELS] if with_force else []
        self.evaluations += 1
        self._told(1)
        return Points(
            row[None],
            np.array([over]),
            np.array([result.false_alarm_probability]),
            np.array([utilisation]),
            np.array([untouched_share(result)]),
            np.array([force]),
        )

    def exceedance_ratio(self, points: Points) -> FloatArray:
        """By how much a point misses the verdict: above 1 it is not acceptable (n,).

        The greater of the probability over the limits and that of a false alarm, each over what is accepted.
        """
        verdict = self.scenario.verdict
        return np.fmax(points.p_over / verdict.accepted_probability, points.false_alarm / verdict.max_false_alarm)

    def untested(self, points: Points) -> npt.NDArray[np.bool_]:
        """Whether most cases touch nothing, so that a verdict was not put to the test (n,)."""
        return np.asarray(points.untouched > MAX_UNTOUCHED)


def _no_points(inputs: int) -> Points:
    nothing = np.zeros(0)
    return Points(np.zeros((0, inputs)), nothing, nothing, nothing, nothing, np.zeros((0, 0)))


def _over_and_utilisation(result: CollisionResult, accepted: float, *, far_tails: bool) -> tuple[float, float]:
    """Probability over a limit, and the share of the limit that is used with the accepted probability."""
    problem, contact = result.problem, result.scenario.contact
    limits, transient = problem.limits, problem.transient_limits
    force = result.peak_force
    if limits is None:
        return math.nan, force.quantile(1 - accepted)
    if not limits.permitted or (transient is not None and not transient.permitted):
        return 1.0, math.inf
    if transient is not None:
        verdict = result.verdict
        used = TwoPhaseUse.of(result, transient, limits).utilisation(accepted)
        return max(verdict.p_over_force or 0.0, verdict.p_over_pressure or 0.0), used
    if isinstance(force, ExactDistribution) and not far_tails:
        force = replace(force, far_tail=None)
    allowed = limits.allowed_force_N(contact.area_cm2, contact.peak_factor)
    return force.exceedance(allowed), force.quantile(1 - accepted) / allowed
