"""Differences between figures that are known exactly and figures of finite samples, in standard errors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
import numpy.typing as npt
from scipy import stats

from bumpstop import CollisionResult, Distribution
from bumpstop.collision.distribution.distribution import SampledDistribution

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 0.999)

# Figures agree no better than this, relatively, however many runs there are: both distributions stand on floating
# point.
_ARITHMETIC = 1e-9


@dataclass(frozen=True)
class Score:
    """One figure, known and sampled.

    Attributes:
        what: the figure, with its unit.
        known, sampled: its two values.
        score: their difference in standard errors; a standard normal if nothing but chance is between them.
        smooth: the sample is large enough for the score to be spread like a normal one. (Five expected events leave
            gaps between its possible values.)
    """

    what: str
    known: float
    sampled: float
    score: float
    smooth: bool = True


def bonferroni(count: int, level: float = 1e-3) -> float:
    """The bound that the largest of ``count`` standard normals passes with a probability of at most ``level``."""
    return NormalDist().inv_cdf(1 - level / (2 * max(1, count)))


def probability_score(what: str, p: float, count: int, n: int) -> Score:
    """Compare a probability with ``count`` events in ``n`` runs.

    The score is that of the normal as rare as this count (mid-p): it also holds where few events are expected.
    """
    p = min(1.0, max(0.0, p))
    at = stats.binom.pmf(count, n, p)
    below, above = stats.binom.cdf(count, n, p) - at / 2, stats.binom.sf(count, n, p) + at / 2
    # Each side from its own tail: nothing is lost far out.
    score = stats.norm.ppf(below) if below < above else stats.norm.isf(above)
    return Score(what, p, count / n, float(score), min(p, 1 - p) * n > 25)


def mean_score(what: str, known: float, values: npt.NDArray[np.float64]) -> Score:
    """Compare a mean with that of a sample."""
    mean, sd = float(values.mean()), float(values.std())
    error = math.hypot(sd / math.sqrt(values.size), _ARITHMETIC * known)
    return Score(what, known, mean, (mean - known) / error if error > 0 else 0.0)


def sd_score(what: str, known: float, values: npt.NDArray[np.float64]) -> Score:
    """Compare a standard deviation with that of a sample, whose error follows from its fourth moment."""
    mean, sd = float(values.mean()), float(values.std())
    if not sd > _ARITHMETIC * abs(mean):
        # Nothing varies: both must say so.
        return Score(what, known, sd, 0.0 if known <= max(sd, 1e-6 * abs(mean)) else math.inf, smooth=False)
    kurtosis = float(np.mean(((values - mean) / sd) ** 4))
    error = math.hypot(sd / 2 * math.sqrt(max(kurtosis - 1, 0.0) / values.size), _ARITHMETIC * known)
    return Score(what, known, sd, (sd - known) / error)


def distribution_scores(what: str, unit: str, known: Distribution, sampled: SampledDistribution) -> Iterator[Score]:
    """Compare mean, standard deviation and the exceedance of seven quantiles."""
    n = sampled.values.size
    if n < 50:
        return
    if math.isfinite(sampled.mean):
        yield mean_score(f"{what}, mean [{unit}]", known.mean, sampled.values)
        yield sd_score(f"{what}, sd [{unit}]", known.sd, sampled.values)
    else:
        # Some runs have no bound: then the distribution must not have a mean either.
        score = 0.0 if not math.isfinite(known.mean) else math.inf
        yield Score(f"{what}, mean [{unit}]", known.mean, sampled.mean, score, smooth=False)
    for p in QUANTILES:
        # The share of runs above the quantile; where the quantile is an atom, above the atom.
        x = known.quantile(p) * (1 + _ARITHMETIC)
        if math.isfinite(x):
            count = round(sampled.exceedance(x) * n)
            yield probability_score(f"P({what} > its {100 * p:g} % quantile)", known.exceedance(x), count, n)


def law_scores(exact: CollisionResult, drawn: CollisionResult) -> list[Score]:
    """Compare every output of an integrated distribution with that of a sampled distribution of the same scenario."""
    assert drawn.samples is not None
    assert drawn.runs is not None
    runs, triggers = drawn.samples, drawn.runs["triggers"]
    scores = [
        probability_score(what, p, round(share * runs), runs)
        for what, p, share in (
            ("P(false alarm)", exact.false_alarm_probability, drawn.false_alarm_probability),
            ("P(undetected)", exact.undetected_probability, drawn.undetected_probability),
            ("P(no contact)", exact.no_contact_probability, drawn.no_contact_probability),
        )
    ]
    scores += trigger_scores(exact, triggers[drawn.runs["tick"] >= 0])
    for what, unit, known, sampled in (
        ("peak force", "N", exact.peak_force, drawn.peak_force),
        ("force at detection", "N", exact.force_at_detection, drawn.force_at_detection),
        ("detection delay", "s", exact.detection_delay, drawn.detection_delay),
        ("contact time", "s", exact.contact_duration, drawn.contact_duration),
    ):
        if known is not None and isinstance(sampled, SampledDistribution):
            scores += distribution_scores(what, unit, known, sampled)
    return scores


def trigger_scores(exact: CollisionResult, triggers: npt.NDArray[np.uint32]) -> list[Score]:
    """Compare which joints fire, given detection; ``triggers`` has one word a run, bit j for joint j + 1."""
    n = triggers.size
    fired = triggers[:, None] >> np.arange(exact.problem.robot.dof, dtype=np.uint32) & 1
    several = int((fired.sum(axis=1) > 1).sum())
    scores = [probability_score("P(several joints at once)", exact.multi_joint_probability, several, n)]
    for j, p in enumerate(exact.trigger_joint_probability):
        scores.append(probability_score(f"P(joint {j + 1} triggers)", float(p), int(fired[:, j].sum()), n))
    return scores


def worst(scores: Sequence[Score]) -> Score:
    """The score farthest from zero."""
    return max(scores, key=lambda score: abs(score.score))
