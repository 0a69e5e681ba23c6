"""PASS, FAIL or INCONCLUSIVE of contact situations, with no more points than the answer needs."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from bumpstop.arrays import FloatArray, as_whole_number
from bumpstop.collision.distribution.monte_carlo_blocks import Progress
from bumpstop.collision.probability_text import accepted_percent
from bumpstop.collision.scenario.scenario import as_scenario
from bumpstop.errors import InputError
from bumpstop.uncertainty.assumed_search import search_assumed
from bumpstop.uncertainty.conclusion import (
    UNTESTED,
    concluded,
    rank_of,
    without_points,
)
from bumpstop.uncertainty.dependence import dependence_note
from bumpstop.uncertainty.evaluation import drawn_rows, points_for, with_assumed, worst_of
from bumpstop.uncertainty.point_evaluation import PointEvaluator, Points

if TYPE_CHECKING:
    from bumpstop.collision import Scenario
    from bumpstop.collision.verdict.verdict import Conclusion

# Points that are computed before the next look at whether they decide.
_CHUNK = 32

JudgementWord = Literal["PASS", "FAIL", "INCONCLUSIVE"]


@dataclass(frozen=True)
class Judgement:
    """The verdict of one contact situation.

    Attributes:
        word: ``"PASS"``, ``"FAIL"`` or ``"INCONCLUSIVE"``; the last, too, where there is no limit to judge by.
        reason: one sentence.
        p_over: probability that one contact exceeds a limit, in the central case; NaN without limits.
        utilisation: in the central case, of the limit; without limits a force [N].
        confidence: at which the word holds; None without ``[uncertainty]``, where it is about the scenario as given.
        evaluations: distributions that were computed.
        conclusion: the verdict in a word of :class:`bumpstop.collision.Verdict`.
    """

    word: JudgementWord
    reason: str
    p_over: float
    utilisation: float
    confidence: float | None
    evaluations: int
    conclusion: Conclusion


def judge_situation(
    scenario: Scenario, *, samples: int | None = None, seed: int = 0, threads: int | None = None
) -> Judgement:
    """Judge a scenario with or without ``[uncertainty]``.

    The word is that of :func:`evaluate_uncertain` with the same samples and seed, and of :func:`bumpstop.evaluate`
    where there is no ``[uncertainty]``.

    Args:
        scenario: what happens.
        samples: runs to draw at every point instead of integrating.
        seed: of the points, and of the runs, 0 to 2^64 - 1.
        threads: that share the points, 1 to 256; None: as many as there are processors.

    Raises:
        InputError: the scenario cannot be computed.
    """
    as_whole_number(seed, "seed", 0, 2**64 - 1, "0 to 2^64 - 1")
    if threads is not None:
        as_whole_number(threads, "threads", 1, 256)
    evaluator = PointEvaluator(as_scenario(scenario), samples=samples, seed=seed, threads=threads)
    figures = evaluator.central_figures
    middle = evaluator.at(figures[None], far_tails=True)
    confidence = scenario.verdict.confidence if evaluator.inputs else None
    fixed = without_points(evaluator)
    if fixed is not None:
        conclusion, reason = fixed
    elif confidence is None:
        verdict = evaluator.result_at(figures).verdict
        conclusion, reason = verdict.conclusion, verdict.reason
    else:
        conclusion, reason = _Stages(evaluator, middle, confidence, seed).judged()
    word: JudgementWord = "PASS" if conclusion == "acceptable" else "INCONCLUSIVE"
    return Judgement(
        "FAIL" if conclusion == "not_acceptable" else word,
        reason,
        float(middle.p_over[0]),
        float(middle.utilisation[0]),
        confidence,
        evaluator.evaluations,
        conclusion,
    )


def judge_situations(
    scenarios: Sequence[Scenario],
    *,
    samples: int | None = None,
    seed: int = 0,
    processes: int | None = None,
    progress: Progress | None = None,
) -> list[Judgement | InputError]:
    """Judge many scenarios, each by itself.

    Args:
        scenarios: in any order.
        samples: runs to draw at every point of each instead of integrating.
        seed: of the points of each, and of the runs.
        processes: that share them; None: as many as there are processors, but none besides for fewer than eight.
        progress: told the share that is done.

    Returns:
        A judgement for each, or the refusal of one that cannot be computed.
    """
    workers = PointEvaluator.processors() if processes is None else as_whole_number(processes, "processes", 1, 256)
    judge = partial(_judged_or_refused, samples=samples, seed=seed)
    found: list[Judgement | InputError] = []
    if workers == 1 or (processes is None and len(scenarios) < _FEW):
        judge = partial(judge, threads=workers)
        for scenario in scenarios:
            found.append(judge(scenario))
            _tell(progress, len(found), len(scenarios))
        return found
    import multiprocessing

    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        for judgement in pool.map(partial(judge, threads=1), scenarios, chunksize=2):
            found.append(judgement)
            _tell(progress, len(found), len(scenarios))
    return found


# A process takes longer to begin than these to be judged.
_FEW = 8


def _tell(progress: Progress | None, done: int, count: int) -> None:
    if progress is not None:
        progress(done / count)


def _judged_or_refused(scenario: Scenario, *, samples: int | None, seed: int, threads: int) -> Judgement | InputError:
    try:
        return judge_situation(scenario, samples=samples, seed=seed, threads=threads)
    except InputError as error:
        return error


class _Stages:
    """First the worst of what is assumed, then the central case, then the best; each only where it matters."""

    def __init__(self, evaluator: PointEvaluator, middle: Points, confidence: float, seed: int) -> None:
        self._evaluator, self._middle, self._confidence = evaluator, middle, confidence
        self._rows = drawn_rows(evaluator, points_for(confidence), seed)

    def judged(self) -> tuple[Conclusion, str]:
        evaluator = self._evaluator
        if not any(each.assumed for each in evaluator.inputs):
            conclusion, points = self._at(self._rows)
            return self._said(conclusion, [points], evaluator.central_figures)
        search = search_assumed(evaluator, evaluator.central_figures, self._confidence)
        worst = [self._at(with_assumed(evaluator, self._rows, at)) for at in worst_of(search)]
        conclusions = [each[0] for each in worst]
        if all(each == "acceptable" for each in conclusions):
            # What holds at the worst holds in the central case.
            return self._said("acceptable", [each[1] for each in worst], worst_of(search)[0])
        base, base_points = self._at(self._rows)
        failing = [points for each, points in ((base, base_points), *worst) if each == "not_acceptable"]
        if base == "acceptable":
            return self._said("inconclusive", failing, search.worst, untested="inconclusive" in conclusions)
        best, _ = self._at(with_assumed(evaluator, self._rows, search.best))
        found = {base, best, *conclusions}
        if found == {"not_acceptable"}:
            return self._said("not_acceptable", [base_points], search.worst)
        return self._said("inconclusive", failing, search.worst, untested="inconclusive" in found)

    def _at(self, rows: FloatArray) -> tuple[Conclusion, Points]:
        """The verdict of points, and those that it took."""
        evaluator, parts = self._evaluator, []
        ratio, untested = np.zeros(0), np.zeros(0, dtype=bool)
        for first in range(0, len(rows), _CHUNK):
            parts.append(evaluator.at(rows[first : first + _CHUNK]))
            ratio = np.append(ratio, evaluator.exceedance_ratio(parts[-1]))
            untested = np.append(untested, evaluator.untested(parts[-1]))
            found = concluded(ratio, untested, self._confidence, len(rows))
            if found is not None:
                return found, Points.joined(parts)
        raise AssertionError("all points decide")

    def _said(
        self, conclusion: Conclusion, known: list[Points], assumed: FloatArray, *, untested: bool = False
    ) -> tuple[Conclusion, str]:
        """The verdict and its reason, of points that are known and what was assumed at them."""
        evaluator, verdict = self._evaluator, self._evaluator.scenario.verdict
        accepted, central = verdict.accepted_probability, float(self._middle.p_over[0])
        limits, said = evaluator.problem.limits, evaluator.said
        assert limits is not None
        sure = f"at {100 * self._confidence:g} % confidence"
        over = f"one contact exceeds the limits for {limits.label} with probability"
        in_case = f"{said(central, accepted)} in the central case"
        if conclusion == "acceptable":
            most = max(float(np.sort(points.p_over)[rank_of(self._confidence, len(points))]) for points in known)
            text = f"{over[0].upper()}{over[1:]} {evaluator.said_at_most(most, accepted)} {sure} ({in_case})."
            together = dependence_note(evaluator, self._confidence, assumed)
            return conclusion, text if together is None else f"{text} {together}"
        if conclusion == "inconclusive" and (untested or not any(each.assumed for each in evaluator.inputs)):
            return conclusion, UNTESTED
        points = Points.joined(known)
        more: list[str] = []
        if (points.p_over > accepted).any():
            more.append(f"{over} above {accepted_percent(accepted)} ({in_case})")
        if (points.false_alarm > verdict.max_false_alarm).any():
            more.append("a false alarm comes before contact too often")
        if conclusion == "not_acceptable":
            text = f"{sure} not excluded: {' and '.join(more)}."
            return conclusion, f"{text[0].upper()}{text[1:]}"
        names = ", ".join(each.key for each in evaluator.inputs if each.assumed)
        return conclusion, f"What is assumed ({names}) decides whether {' and '.join(more)}."
