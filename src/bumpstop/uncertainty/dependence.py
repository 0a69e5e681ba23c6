"""Whether a verdict rests on inputs being independent of one another."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.probability_text import accepted_percent

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.uncertainty.point_evaluation import PointEvaluator


def dependence_note(evaluator: PointEvaluator, confidence: float, figures: FloatArray) -> str | None:
    """A sentence where an acceptable verdict would not hold, were all inputs to go together.

    Each input that has a distribution is put at the end of its range, its quantile 1 - c or c, at which more of the
    limit is used. Where the use grows or falls with every input, that is the quantile c of inputs that go together.

    Args:
        evaluator: of the scenario.
        confidence: c.
        figures: of what is assumed; those of the others do not count (inputs,).

    Returns:
        None with fewer than two distributions, or where the verdict holds even so.
    """
    drawn = [j for j, each in enumerate(evaluator.inputs) if not each.assumed]
    if len(drawn) < 2:
        return None
    middle = figures.copy()
    middle[drawn] = evaluator.central_figures[drawn]
    ends = np.array([evaluator.inputs[j].limits(confidence) for j in drawn])
    rows = np.repeat(middle[None], 2 * len(drawn), axis=0)
    for place, j in enumerate(drawn):
        rows[2 * place : 2 * place + 2, j] = ends[place]
    points = evaluator.at(rows)
    ratio, used = evaluator.exceedance_ratio(points).reshape(-1, 2), points.utilisation.reshape(-1, 2)
    worse = np.where(used[:, 0] == used[:, 1], ratio.argmax(axis=1), used.argmax(axis=1))
    middle[drawn] = ends[np.arange(len(drawn)), worse]
    together = evaluator.at(middle[None])
    if not evaluator.exceedance_ratio(together)[0] > 1:
        return None
    names = ", ".join(evaluator.inputs[j].key for j in drawn)
    verdict, over = evaluator.scenario.verdict, float(together.p_over[0])
    what, most, accepted = "one contact would exceed a limit", over, verdict.accepted_probability
    if not over > accepted:
        what, most, accepted = "a false alarm would come", float(together.false_alarm[0]), verdict.max_false_alarm
    said = f"{evaluator.said_up(most, accepted)}, {accepted_percent(accepted)} accepted"
    return (
        f"This holds for inputs that are independent of one another. Were {names} to go together, {what} at "
        f"{100 * confidence:g} % confidence with probability up to {said}."
    )
