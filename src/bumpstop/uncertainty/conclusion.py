"""The verdict at a confidence, and the sentence that gives its reason."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.uncertainty.result import Conclusion, rank_of, said

if TYPE_CHECKING:
    from bumpstop.uncertainty.point_evaluation import PointEvaluator, Points


def conclude(
    evaluator: PointEvaluator,
    middle: Points,
    cases: tuple[Points, Points, Points],
    confidence: float,
    deciding: tuple[str, ...],
) -> tuple[Conclusion, str]:
    """Judge what is drawn at the best, the central and the worst values of what is assumed.

    Acceptable is what holds at the confidence, and would at any admissible value. Not acceptable is what would at none.
    All else is inconclusive.

    Args:
        evaluator: of the scenario.
        middle: the central case, one point.
        cases: points with the best, the central and the worst values of what is assumed.
        confidence: share of the inputs at which the verdict must hold.
        deciding: keys of assumed inputs that swap it by themselves.

    Returns:
        The verdict in a word, and one sentence.
    """
    limits = evaluator.problem.limits
    if limits is None:
        return "no_limits", "No body region is named, so there is no limit to judge by."
    for phase in (limits, evaluator.problem.transient_limits):
        if phase is not None and not phase.permitted:
            return "not_acceptable", phase.reason
    accepted = evaluator.scenario.verdict.accepted_probability
    found = [_at_confidence(evaluator, points, confidence) for points in cases]
    over = [float(np.sort(points.p_over)[rank_of(confidence, len(points))]) for points in cases]
    alarm = [float(np.sort(points.false_alarm)[rank_of(confidence, len(points))]) for points in cases]
    sure = f"At {100 * confidence:g} % confidence"
    few = len(cases[1]) == 1
    if len(set(found)) > 1:
        names = deciding or tuple(each.key for each in evaluator.inputs if each.assumed)
        verb = "is assumed and decides" if len(names) == 1 else "are assumed and decide"
        together = "" if deciding else " together"
        if found[0] == "acceptable" or found[-1] == "not_acceptable":
            figures = f"over the limits with probability {_span(over[0], over[2], accepted)}"
            if over[0] > accepted or over[2] <= accepted:
                figures = f"false alarms with probability {_span(alarm[0], alarm[2], accepted)}"
            return "inconclusive", f"{_listed(names)} {verb}{together}: {figures}, {said(accepted, accepted)} accepted."
        return "inconclusive", _untested()
    if found[1] == "inconclusive":
        return "inconclusive", _untested()
    bound = over[2] if found[1] == "acceptable" else over[1]
    central = f"{said(float(middle.p_over[0]), accepted)} in the central case"
    if found[1] == "acceptable":
        where = "at any admissible value of what is assumed" if few else f"{sure[0].lower()}{sure[1:]}"
        return "acceptable", (
            f"One contact exceeds the limits for {limits.label} with probability {said(bound, accepted)} or less "
            f"{where}, within the accepted {said(accepted, accepted)} ({central})."
        )
    max_alarm = evaluator.scenario.verdict.max_false_alarm
    faults = []
    if bound > accepted:
        faults.append(
            f"one contact exceeds the limits for {limits.label} with probability up to {said(bound, accepted)}, more "
            f"than the accepted {said(accepted, accepted)} ({central})"
        )
    if alarm[1] > max_alarm:
        faults.append(
            f"a false alarm comes before contact with probability up to {said(alarm[1], max_alarm)} (accepted: "
            f"{said(max_alarm, max_alarm)})"
        )
    if not faults:
        faults.append("the limits or the false alarms are over what is accepted at too many points of the inputs")
    return "not_acceptable", f"{sure} " + " and ".join(faults) + "."


def _at_confidence(evaluator: PointEvaluator, points: Points, confidence: float) -> Conclusion:
    """Points at which most cases touch nothing count for neither verdict."""
    ratio, untested = evaluator.exceedance_ratio(points), evaluator.untested(points)
    rank = rank_of(confidence, len(ratio))
    if np.sort(np.where(untested & (ratio <= 1), np.inf, ratio))[rank] <= 1:
        return "acceptable"
    return "not_acceptable" if np.sort(ratio)[rank] > 1 else "inconclusive"


def _untested() -> str:
    return "At too many points of the inputs most cases touch nothing, so that the limits are not put to the test."


def _span(low: float, high: float, accepted: float) -> str:
    return f"{said(min(low, high), accepted)} to {said(max(low, high), accepted)}"


def _listed(names: tuple[str, ...]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
