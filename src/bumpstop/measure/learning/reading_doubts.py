"""Readings that no cell gives: another unit, a gauge that shows too little, shots at odds, or a latency below zero."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.measure.parameters import LATENCY, nominal
from bumpstop.terminal import in_percent

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.measure.learning.peak_force_ensemble import Condition
    from bumpstop.measure.learning.shots import MeasuredShot

# More than half of the shots below what was believed; in the middle by a factor of two no parameter is so far off.
# Readings that are too high are told by their limits, and make nothing look safe.
_MANY, _LOW_RATIO = 0.5, 0.5
# By so many standard deviations a parameter is far from what was believed: 2 of 120 honest series show one.
_FAR = 2.3
# Of a parameter that the shots tell little of they take no less than this share of its variance.
_MIN_TAKEN = 0.1
# Honest shots of the told gauge have their error found up to 1.17 times as large.
_AT_ODDS = 1.3
_TOO_LOW = (
    "Are readings in another unit, or does the gauge show too little? What was learned only hides it: do not use the "
    "calibrated scenarios before that is settled."
)
_LOW = (
    "Parameters explain that, and so does a gauge that shows too little, or was hit more slowly or elsewhere: check "
    "gauge, speed and place before the calibrated scenarios are used."
)


def reading_doubts(
    before: Sequence[tuple[float, float, float]],
    shots: Sequence[MeasuredShot],
    conditions: Sequence[Condition],
    latency_shift: tuple[float, float],
    gauge_error: tuple[float, float],
) -> tuple[str, ...]:
    """Why measured shots are hardly those of their cell, a sentence for each reason.

    Args:
        before: median and central 95 % of the peak force of each shot, as believed before any was measured [N].
        shots: measured.
        conditions: whose scenarios the latency is of.
        latency_shift: what the shots add to it, median and end of the central 95 % [s].
        gauge_error: of a shot, as told and as the shots show it [1].
    """
    ratio = float(np.median([shot.force_N / median for shot, (median, _, _) in zip(shots, before, strict=True)]))
    low = sum(shot.force_N < least for shot, (_, least, _) in zip(shots, before, strict=True))
    doubts = []
    many_low = low > _MANY * len(shots)
    too_low = many_low and ratio < _LOW_RATIO
    if many_low:
        asked = _TOO_LOW if too_low else _LOW
        doubts.append(
            f"{low} of {len(shots)} shots lie below the least that was believed before, {ratio:.2g} times the "
            f"expected force in the middle. {asked}"
        )
    told, shown = gauge_error
    if shown > _AT_ODDS * told:
        doubts.append(
            f"A single shot is off by {in_percent(shown, 2)} beyond its own scatter, and {in_percent(told, 2)} was "
            "told of the gauge: shots contradict each other. Are all rows of the place, the speed and the gauge that "
            "they name? What was learned lies between them."
        )
    return (*doubts, *_latency_doubt(latency_shift, conditions, too_low=too_low))


def far_from_told(labels: Sequence[str], mean: FloatArray, sd: FloatArray) -> tuple[str, ...]:
    """Parameters that shots put far from what was believed of them, a sentence for each.

    Before the shots the mean that they find is normal, with the variance that they take from the parameter.

    Args:
        labels: of the parameters.
        mean: after the shots, in standard deviations before them (parameters,).
        sd: likewise.
    """
    off = mean / np.sqrt(np.maximum(1 - sd**2, _MIN_TAKEN))
    return tuple(
        f"The shots put the {label} {abs(own):.2g} standard deviations {'above' if own > 0 else 'below'} what was told "
        "or assumed of it before, farther than chance does. Check that, or give it a wider spread: what was learned "
        "goes part of the way only, and blames other parameters for the rest."
        for label, own, far in zip(labels, mean, np.abs(off) > _FAR, strict=True)
        if far
    )


def _latency_doubt(shift: tuple[float, float], conditions: Sequence[Condition], *, too_low: bool) -> tuple[str, ...]:
    """A latency below zero counts as zero in the scenarios. Of one near zero chance alone makes a median below it."""
    given = min(float(nominal(condition.scenario, LATENCY)) for condition in conditions)
    median, high = shift
    if given + high >= 0:
        return ()
    why = "readings are too low to be explained by a latency" if too_low else "a latency alone does not explain them"
    return (
        f"The shots ask for a latency {1e3 * -median:.3g} ms shorter than the {1e3 * given:.3g} ms of the scenario, "
        f"which would be below zero and counts as 0: {why}.",
    )
