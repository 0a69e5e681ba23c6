"""Whether samples come at the rate that a detector is made for."""

from __future__ import annotations

import statistics

from bumpstop.detection.rate import same_period

# Intervals whose median is looked at. Fewer than half of them may be long for samples that are lost.
_INTERVALS = 200


class RateCheck:
    """Recognises another rate, once.

    Args:
        period_s: of the detector [s].
    """

    def __init__(self, period_s: float) -> None:
        self._period = period_s
        self._steps: list[float] = []
        self._told = False

    def look(self, step_s: float) -> str:
        """What is wrong, in one sentence; empty: nothing is, or it has been said.

        Args:
            step_s: from one sample to the next by the clock of the source [s].
        """
        if self._told:
            return ""
        self._steps.append(step_s)
        if len(self._steps) < _INTERVALS:
            return ""
        median = statistics.median(self._steps)
        self._steps.clear()
        if same_period(median, self._period):
            return ""
        self._told = True
        return f"a sample comes every {median:.3g} s; the detector is made for {self._period:.3g} s"
