"""Residuals of runs whose joints differ in their tails and memories, and that differ from run to run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bumpstop.detection import ResidualSeries

RATE_HZ = 100.0
KINDS = ("normal", "slow", "heavy", "spiky", "normal", "slow")


def runs(
    count: int, minutes: float, seed: int, *, spread: float = 0.0, kinds: Sequence[str] = KINDS
) -> list[ResidualSeries]:
    """Runs of a free arm, a row every 10 ms; joint j is j + 1 times as loud as the first.

    Args:
        count: of runs.
        minutes: of each.
        seed: of all.
        spread: standard deviation of the logarithm of a run's loudness.
        kinds: of joints: ``normal``, correlated over 20 rows; ``slow``, over 400; ``heavy``, driven by Student's t of 4
            degrees; ``spiky``, quiet with a blow every four seconds.
    """
    from scipy.signal import lfilter

    rng = np.random.default_rng(seed)
    n, found = round(minutes * 60 * RATE_HZ), []
    for number in range(count):
        loud = np.exp(spread * rng.standard_normal())
        columns = []
        for j, kind in enumerate(kinds):
            memory = 0.995 if kind == "slow" else 0.9
            white = rng.standard_t(4, n + 2000) if kind == "heavy" else rng.standard_normal(n + 2000)
            noise = lfilter([1.0], [1.0, -memory], white)[2000:] * np.sqrt(1 - memory**2)
            if kind == "spiky":
                blows = (rng.random(n) < 1 / (4 * RATE_HZ)) * rng.exponential(1.5, n) * rng.choice([-1, 1], n)
                noise = 0.4 * noise + lfilter([1.0], [1.0, -0.9], blows)
            columns.append(loud * (1 + j) * noise)
        found.append(ResidualSeries(np.arange(n) / RATE_HZ, np.stack(columns, axis=1), f"run {seed}-{number}"))
    return found
