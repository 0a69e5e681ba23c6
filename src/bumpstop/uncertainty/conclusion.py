"""The verdict at a confidence, and the sentence that gives its reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.collision.probability_text import accepted_percent, within

if TYPE_CHECKING:
    from bumpstop.collision.verdict.verdict import Conclusion
    from bumpstop.uncertainty.point_evaluation import PointEvaluator, Points

UNTESTED = "At too many points of the inputs most cases touch nothing, so that the limits are not put to the test."


def rank_of(p: float, count: int) -> int:
    """Place of the quantile p among ``count`` ascending values, from 0.

    Of independent values the one at rank k lies above a further one with probability k / (count + 1), so that
    k = p (count + 1), rounded away from the middle, covers with probability p at least.
    """
    rank = np.ceil(p * (count + 1) - 1e-9) if p >= 0.5 else np.floor(p * (count + 1) + 1e-9)
    return int(min(max(rank, 1), count)) - 1


def at_rank(values: FloatArray, p: float) -> float:
    """The quantile p of values, at the place of :func:`rank_of`."""
    return float(np.sort(values)[rank_of(p, len(values))])


def concluded(ratio: FloatArray, untested: npt.NDArray[np.bool_], confidence: float, count: int) -> Conclusion | None:
    """The verdict of ``count`` points of which some are known; None: those decide nothing yet.

    Points at which most cases touch nothing count for neither verdict.

    Args:
        ratio: of :meth:`PointEvaluator.exceedance_ratio` (n,), n <= count.
        untested: of :meth:`PointEvaluator.untested` (n,).
        confidence: share of the points at which the verdict must hold.
        count: of all points.
    """
    wanted = rank_of(confidence, count) + 1
    if (ratio > 1).sum() > count - wanted:
        return "not_acceptable"
    if ((ratio <= 1) & ~untested).sum() >= wanted:
        return "acceptable"
    return "inconclusive" if len(ratio) == count else None


@dataclass(frozen=True, eq=False)
class JudgedCases:
    """Points with the best, the central and the worst values of what is assumed.

    Attributes:
        middle: the central case, one point.
        base: what is assumed is central.
        worst: for the force, and for false alarms where they count.
        best: None where the base is acceptable already.
    """

    middle: Points
    base: Points
    worst: tuple[Points, ...]
    best: Points | None

    def conclusions(self, evaluator: PointEvaluator, confidence: float) -> tuple[Conclusion, tuple[Conclusion, ...]]:
        """Of the base, and of the others."""
        others = self.worst if self.best is None else (*self.worst, self.best)
        return verdict_of(evaluator, self.base, confidence), tuple(
            verdict_of(evaluator, points, confidence) for points in others
        )


def verdict_of(evaluator: PointEvaluator, points: Points, confidence: float) -> Conclusion:
    """The verdict of all points."""
    found = concluded(evaluator.exceedance_ratio(points), evaluator.untested(points), confidence, len(points))
    assert found is not None
    return found


def without_points(evaluator: PointEvaluator) -> tuple[Conclusion, str] | None:
    """Verdict and reason where no point changes them; None where points decide."""
    limits = evaluator.problem.limits
    if limits is None:
        return "no_limits", "No body region is named, so there is no limit to judge by."
    for phase in (limits, evaluator.problem.transient_limits):
        if phase is not None and not phase.permitted:
            return "not_acceptable", phase.reason
    return None


def conclude(
    evaluator: PointEvaluator, cases: JudgedCases, confidence: float, deciding: tuple[str, ...]
) -> tuple[Conclusion, str]:
    """Judge the cases.

    Acceptable is what holds at the confidence, and would at any admissible value. Not acceptable is what would at none.
    All else is inconclusive.

    Args:
        evaluator: of the scenario.
        cases: their points.
        confidence: share of the inputs at which the verdict must hold.
        deciding: keys of assumed inputs that swap it by themselves.

    Returns:
        The verdict in a word, and one sentence.
    """
    fixed = without_points(evaluator)
    if fixed is not None:
        return fixed
    base, others = cases.conclusions(evaluator, confidence)
    if "inconclusive" in (base, *others):
        return "inconclusive", UNTESTED
    if set(others) - {base}:
        return "inconclusive", _swap(evaluator, cases, confidence, deciding)
    accepted = evaluator.scenario.verdict.accepted_probability
    max_alarm = evaluator.scenario.verdict.max_false_alarm
    label = evaluator.problem.limits.label if evaluator.problem.limits is not None else ""
    sure, said = _sure(evaluator, confidence), evaluator.said
    central = f"{said(float(cases.middle.p_over[0]), accepted)} in the central case"
    if base == "acceptable":
        over = max(at_rank(points.p_over, confidence) for points in (cases.base, *cases.worst))
        return "acceptable", (
            f"{sure} one contact exceeds the limits for {label} with probability "
            f"{evaluator.said_at_most(over, accepted)}, {within(over, accepted, evaluator.runs)} ({central})."
        )
    over, alarm = at_rank(cases.base.p_over, confidence), at_rank(cases.base.false_alarm, confidence)
    faults = []
    if over > accepted or alarm <= max_alarm:
        faults.append(
            f"one contact exceeds the limits for {label} with probability "
            f"{evaluator.said_at_most(over, accepted)}, {accepted_percent(accepted)} accepted ({central})"
        )
    if alarm > max_alarm or over <= accepted:
        faults.append(
            f"a false alarm comes before contact with probability {evaluator.said_at_most(alarm, max_alarm)}, "
            f"{accepted_percent(max_alarm)} accepted"
        )
    return "not_acceptable", f"{sure} " + " and ".join(faults) + "."


def _sure(evaluator: PointEvaluator, confidence: float) -> str:
    """Of what a sentence holds."""
    drawn = any(not each.assumed for each in evaluator.inputs)
    assumed = any(each.assumed for each in evaluator.inputs)
    words = [f"at {100 * confidence:g} % confidence"] if drawn else []
    if assumed:
        words.append("whatever is assumed")
    text = " and ".join(words)
    return f"{text[0].upper()}{text[1:]}"


def _swap(evaluator: PointEvaluator, cases: JudgedCases, confidence: float, deciding: tuple[str, ...]) -> str:
    """What is assumed and decides, and between which probabilities."""
    verdict, said = evaluator.scenario.verdict, evaluator.said
    together = "" if deciding else " together"
    names = deciding or tuple(each.key for each in evaluator.inputs if each.assumed)
    verb = "is assumed and decides" if len(names) == 1 else "are assumed and decide"
    every = (cases.base, *cases.worst, *(() if cases.best is None else (cases.best,)))
    spans = []
    for what, name, accepted in (
        ("one contact exceeds a limit", "p_over", verdict.accepted_probability),
        ("a false alarm comes before contact", "false_alarm", verdict.max_false_alarm),
    ):
        found = [at_rank(getattr(points, name), confidence) for points in every]
        if max(found) > accepted:
            span = f"{said(min(found), accepted)} to {evaluator.said_up(max(found), accepted)}"
            spans.append(f"{what} with probability {span}, {accepted_percent(accepted)} accepted")
    return f"{_listed(names)} {verb}{together}: {' and '.join(spans) or 'force and false alarms'}."


def _listed(names: tuple[str, ...]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
