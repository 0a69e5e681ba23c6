"""The probability over the limits, averaged over the uncertain inputs, however small it is."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray, as_whole_number
from bumpstop.collision.scenario.scenario import as_scenario
from bumpstop.errors import InputError
from bumpstop.uncertainty.point_evaluation import PointEvaluator
from bumpstop.uncertainty.rare_exceedance import RareProbability

if TYPE_CHECKING:
    from bumpstop.collision import Scenario

# Rounds of fitting to powers of the probability, which lead to where it comes from; and how wide the first looks.
_POWERS, _FIRST_SD = (0.25, 0.5, 1.0, 1.0), 2.0
_MIN_SD, _MAX_SD = 0.3, 2.0
# Share of the points that is drawn from the inputs themselves: no weight is above its reciprocal.
_DEFENSIVE = 0.2


def overall_probability(
    scenario: Scenario, *, points: int = 1024, seed: int = 0, threads: int | None = None
) -> RareProbability:
    """Estimate the probability that one contact exceeds a limit, over its own chance and that of the inputs.

    Where rare inputs make most of it, points of the inputs themselves miss them. So some rounds fit a normal
    distribution to where the probability comes from (the cross-entropy method; Rubinstein and Kroese 2004), and the
    last points are drawn from it and the inputs mixed, and weighted (Hesterberg 1995). What has an interval stays in
    its central case.

    Args:
        scenario: with ``[uncertainty]`` and a body region.
        points: 256 to 65 536; half of them for the fit.
        seed: 0 to 2^64 - 1.
        threads: that share the points; None: as many as there are processors.

    Returns:
        The estimate, with the standard error that independent points would have.

    Raises:
        InputError: no limits, no input with a distribution, or an argument out of its range.
    """
    from scipy.special import ndtr

    count = as_whole_number(points, "points", 256, 65_536)
    as_whole_number(seed, "seed", 0, 2**64 - 1, "0 to 2^64 - 1")
    evaluator = PointEvaluator(as_scenario(scenario), threads=threads, far_tails=True)
    drawn = [j for j, each in enumerate(evaluator.inputs) if not each.is_interval]
    if evaluator.problem.limits is None:
        raise InputError("contact.body", "is missing", "a probability over the limits needs them: name a body region")
    if not drawn:
        raise InputError("uncertainty", "has no distribution", "wanted an input that is more than an interval")
    rng = np.random.default_rng(seed)

    def over(scores: FloatArray) -> FloatArray:
        rows = np.tile(evaluator.central_figures, (len(scores), 1))
        for column, j in enumerate(drawn):
            rows[:, j] = evaluator.inputs[j].quantile(ndtr(scores[:, column]))
        return evaluator.at(rows).p_over

    mean, sd = np.zeros(len(drawn)), np.full(len(drawn), _FIRST_SD)
    for power in _POWERS:
        scores = mean + sd * _spread(rng, len(drawn), count // (2 * len(_POWERS)))
        share = over(scores) ** power * np.exp(_log_density(scores, 0.0, 1.0) - _log_density(scores, mean, sd))
        if not share.sum() > 0:
            break
        share /= share.sum()
        mean = share @ scores
        sd = np.clip(np.sqrt(share @ (scores - mean) ** 2), _MIN_SD, _MAX_SD)
    last = count - len(_POWERS) * (count // (2 * len(_POWERS)))
    scores = _spread(rng, len(drawn), last)
    fitted = rng.permutation(last) >= round(_DEFENSIVE * last)
    scores[fitted] = mean + sd * scores[fitted]
    plain, own = _log_density(scores, 0.0, 1.0), _log_density(scores, mean, sd)
    weight = 1 / (_DEFENSIVE + (1 - _DEFENSIVE) * np.exp(own - plain))
    value = weight * over(scores)
    return RareProbability(float(value.mean()), float(value.std(ddof=1)) / math.sqrt(last), evaluator.evaluations)


def _spread(rng: np.random.Generator, dimensions: int, count: int) -> FloatArray:
    """Standard normal scores of well-spread points (count, dimensions)."""
    from scipy.special import ndtri
    from scipy.stats import qmc

    u = qmc.LatinHypercube(dimensions, seed=rng).random(count)
    return np.asarray(ndtri(np.clip(u, 1e-12, 1 - 1e-12)))


def _log_density(scores: FloatArray, mean: FloatArray | float, sd: FloatArray | float) -> FloatArray:
    """Of independent normal distributions, without the constant (n,)."""
    z = (scores - mean) / sd
    return np.asarray(-0.5 * (z * z).sum(axis=1) - np.log(np.broadcast_to(sd, z.shape[1:])).sum())
