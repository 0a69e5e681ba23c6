"""Residuals of known statistics: correlated in time and between joints, with normal or heavier tails."""

from __future__ import annotations

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.detection import ResidualSeries
from bumpstop.detection.tuning.extreme_values import clusters

RATE_HZ = 100.0


def residuals(
    hours: float, seed: int, *, degrees: float | None = 5.0, joints: int = 3, memory: float = 0.9, start: float = 0.0
) -> ResidualSeries:
    """First-order autoregressive noise driven by Student's t (None: normal), a third of it common to all joints."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(seed)
    n = round(hours * 3600 * RATE_HZ)
    draw = rng.standard_normal if degrees is None else lambda size: rng.standard_t(degrees, size)
    white = draw((n + 200, joints)) + 0.5 * draw((n + 200, 1))
    noise: FloatArray = lfilter([1.0], [1.0, -memory], white, axis=0)[200:] * np.linspace(1.0, 3.0, joints)
    return ResidualSeries(start + np.arange(n) / RATE_HZ, noise, f"noise {seed}")


def achieved(series: ResidualSeries, thresholds: FloatArray, cluster_rows: int) -> int:
    """Alarms of a record: rows over a threshold, those close to each other as one."""
    return int(clusters(np.abs(series.rows / thresholds).max(axis=1), 1.0, cluster_rows)[0].size)
