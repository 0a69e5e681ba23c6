"""Bins over the part of a distribution that is worth showing, and why there are none."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.probability_text import percent
from bumpstop.collision.verdict.verdict_notes import untouched_share

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import Distribution
    from bumpstop.collision.outcome import CollisionOutcome

# Less is not told in percent.
_MIN_PROBABILITY = 1e-6


def bins(distribution: Distribution, samples: int | None, most: float = math.inf) -> FloatArray:
    """Bin edges over the bounded part of a distribution; empty where there is none, or nothing but zeros.

    Args:
        distribution: in any unit.
        samples: behind a sampled one; None: exact.
        most: nothing is shown beyond.
    """
    high = _highest(distribution)
    if math.isfinite(most):
        high = min(high, most)
    if not high > 0:
        return np.zeros(0)
    low = distribution.quantile(1e-4)
    # A single value still needs a bin around it.
    margin = max(0.03 * (high - low), 0.01 * abs(high), 1e-9)
    low, high = max(0.0, low - margin), high + margin
    count = 160 if samples is None else int(min(60, max(12, 2 * samples**0.5)))
    return np.linspace(low, high, count + 1)


def _highest(distribution: Distribution) -> float:
    """A quantile at the upper end of the bounded part; NaN where less than half is bounded."""
    bounded, unbounded = 0.5, 0.9999
    value, high = distribution.quantile(unbounded), distribution.quantile(bounded)
    if math.isfinite(value) or not math.isfinite(high):
        return value if math.isfinite(value) else math.nan
    while unbounded - bounded > 1e-4:
        middle = (bounded + unbounded) / 2
        value = distribution.quantile(middle)
        if math.isfinite(value):
            bounded, high = middle, value
        else:
            unbounded = middle
    return high


def why_no_figure(result: CollisionOutcome) -> str:
    """Why too few collisions have a force to be drawn: what has none, and what has no bound."""
    integrated = result.kind == "exact"
    shares = (
        (result.undetected_probability, "of collisions are never detected, so that their force is unbounded"),
        (untouched_share(result), "of cases touch nothing"),
    )
    return ", and ".join(
        f"{percent(share, integrated=integrated)} {words}" for share, words in shares if share > _MIN_PROBABILITY
    )
