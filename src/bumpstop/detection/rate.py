"""The rate of rows, and that a detector and its thresholds are made for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.detection.settings import DetectorSettings
    from bumpstop.detection.thresholds import Thresholds

_TOLERANCE = 0.1  # of a period, between what is stated, and what is stated elsewhere or recorded


def same_period(one: float, stated: float) -> bool:
    """Whether a period is near enough to the one that is stated elsewhere [s]."""
    return abs(one - stated) <= _TOLERANCE * stated


def check_rates(settings: DetectorSettings, thresholds: Thresholds) -> None:
    """Refuse thresholds that were found at another rate than the settings have, where both say one.

    Args:
        settings: of a detector.
        thresholds: its own.

    Raises:
        InputError: the rates differ.
    """
    ours, theirs = settings.period_s, thresholds.period_s
    if ours and theirs and not same_period(ours, theirs):
        raise InputError("period_s", f"is {ours:g}", f"the thresholds were found at {theirs:g}")


def recorded_period(t: FloatArray) -> float | None:
    """Median interval of rows as they came in (N,) [s]; None: no time rises."""
    steps = np.diff(t)
    steps = steps[np.isfinite(steps) & (steps > 0)]
    return float(np.median(steps)) if steps.size else None


def period_of(t: FloatArray, settings: DetectorSettings, thresholds: Thresholds) -> float:
    """Time from row to row: that of the settings, or else the median interval [s].

    Args:
        t: (N,) of the rows as they came in [s].
        settings: may say a period.
        thresholds: likewise.

    Raises:
        InputError: either says another than the rows have, or nothing says one.
    """
    recorded = recorded_period(t)
    for name, wanted in (("period_s", settings.period_s), ("thresholds period_s", thresholds.period_s)):
        if wanted and recorded and not same_period(recorded, wanted):
            raise InputError(
                "recording", f"has a row every {recorded:.6g} s", f"the detector is made for {name} = {wanted:g}"
            )
    period = settings.period_s or recorded
    if period is None:
        raise InputError("t", "has no interval", "wanted rising times, or period_s in the settings")
    return period
