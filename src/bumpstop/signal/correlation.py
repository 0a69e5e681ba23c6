"""Correlation time of a series."""

from __future__ import annotations

import numpy as np

from bumpstop.arrays import FloatArray

# Sokal's window: the sum of correlations ends at this many times itself.
_WINDOW = 5


def correlation_time(x: FloatArray) -> float:
    """Integrated correlation time of a series, in samples: 1 + 2 sum of its correlations, at least 1.

    The sum ends at five times itself (A. Sokal, "Monte Carlo methods in statistical mechanics", 1996): beyond that the
    estimates of the correlations are noise.

    Args:
        x: (N,) evenly sampled series.
    """
    from scipy.fft import next_fast_len

    centred = np.asarray(x, dtype=np.float64) - np.mean(x)
    n = centred.size
    size = next_fast_len(2 * n, real=True)
    power = np.abs(np.fft.rfft(centred, size)) ** 2
    correlation = np.fft.irfft(power, size)[:n]
    if not correlation[0] > 0:
        return 1.0
    sums = 2 * np.cumsum(correlation / correlation[0]) - 1
    ends = np.flatnonzero(np.arange(n) >= _WINDOW * sums)
    return max(1.0, float(sums[ends[0]] if ends.size else sums[-1]))
