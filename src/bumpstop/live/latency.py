"""Latencies of many samples in little memory."""

from __future__ import annotations

import math

_PER_DECADE = 50
_DECADES = 9
_LEAST_S = 1e-7


class LatencyHistogram:
    """Counts times in bins of 4.7 %, from 0.1 µs to 100 s: quantiles of any number of them, a bin's upper edge."""

    def __init__(self) -> None:
        self._bins = [0] * (_PER_DECADE * _DECADES + 1)
        self.count = 0
        self.largest_s = 0.0

    def add(self, latency_s: float) -> None:
        """Count one [s]."""
        place = math.ceil(_PER_DECADE * math.log10(max(latency_s, _LEAST_S) / _LEAST_S))
        self._bins[min(place, len(self._bins) - 1)] += 1
        self.count += 1
        self.largest_s = max(self.largest_s, latency_s)

    def quantile(self, p: float) -> float:
        """Smallest edge with a share of at least ``p`` below it [s]; NaN: nothing was counted."""
        if not self.count:
            return math.nan
        wanted, seen = p * self.count, 0
        for place, many in enumerate(self._bins):
            seen += many
            if seen >= wanted and seen:
                return min(_LEAST_S * 10 ** (place / _PER_DECADE), self.largest_s)
        return self.largest_s

    def in_ms(self) -> dict[str, float]:
        """Median, p99 and largest [ms]; NaN: nothing was counted."""
        return {
            "p50": 1e3 * self.quantile(0.5),
            "p99": 1e3 * self.quantile(0.99),
            "largest": 1e3 * self.largest_s if self.count else math.nan,
        }
