"""How much larger or smaller the residuals of another run may be: what an interval must know beside its peaks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.detection.tuning.extreme_values import PeaksOverThreshold

# Of runs of one arm on other days and at other speeds: a prior as good as two more runs, whose residuals differ by a
# twentieth. Two or three recordings alone say next to nothing of a spread.
_PRIOR_SD, _PRIOR_RUNS = 0.05, 2
# Parts of the only run there is, from which its own wandering is told, and peaks in each.
_PARTS, _MIN_PARTS, _PEAKS = 8, 4, 5
# Logarithms of a run's factor that are tried: beyond them a run is of another kind, and not of another scale.
_LOGS = np.linspace(-1.5, 1.5, 601)
_LOOSE = 0.5  # standard deviation of a prior of one run's logarithm, for runs without a peak


@dataclass(frozen=True)
class RunSpread:
    """The spread of a run's residuals around those of all runs together.

    A run's residuals are taken as those of all runs times a factor of its own, with a lognormal distribution. An alarm
    rate is steep in such a factor: where the tail is Gaussian and the threshold is at five standard deviations, a
    twentieth more in the residuals makes three times as many alarms.

    Attributes:
        runs: number of runs it was told from; 1: a single run was cut into parts.
        sd: standard deviation of the factor's logarithm from run to run, or from part to part.
        new_sd: that of a new run against those that were tuned on; of a single run: of as much of it again.
        degrees: of freedom, of Student's t.
        units: logarithm of how much larger residuals are in units that they have not set; of short recordings.
    """

    runs: int
    sd: float
    new_sd: float
    degrees: int
    units: float = 0.0

    @classmethod
    def of(cls, tail: PeaksOverThreshold, lengths: Sequence[int]) -> RunSpread:
        """Tell the spread from a tail's peaks.

        Args:
            tail: of all runs, one after the other.
            lengths: rows of each run.
        """
        count = len(lengths)
        if count == 1:
            parts = min(_PARTS, tail.excess.size // _PEAKS)
            if parts < _MIN_PARTS:
                return cls(1, 0.0, 0.0, 1)
            lengths = [len(part) for part in np.array_split(np.empty(lengths[0]), parts)]
        edges = np.cumsum([0, *lengths])
        owner = np.searchsorted(edges, tail.rows, side="right") - 1
        hours = tail.hours * np.diff(edges) / edges[-1]
        found = [_factor(tail, tail.excess[owner == k], float(hours[k])) for k in range(len(lengths))]
        logs, errors = np.array(found).T
        square = max(0.0, float(logs.var(ddof=1)) - float((errors**2).mean()))
        if count == 1:
            return cls(1, math.sqrt(square), math.sqrt(2 * square / len(lengths)), len(lengths) - 1)
        degrees = count - 1 + _PRIOR_RUNS
        square = (_PRIOR_RUNS * _PRIOR_SD**2 + (count - 1) * square) / degrees
        return cls(count, math.sqrt(square), math.sqrt(square * (1 + 1 / count)), degrees)

    def half_width(self, confidence: float) -> float:
        """Half the width of the interval of a new run's logarithm."""
        from scipy.stats import t

        run = float(t.ppf((1 + confidence) / 2, self.degrees)) * self.new_sd if self.new_sd > 0 else 0.0
        return math.hypot(run, self.units)


def _factor(tail: PeaksOverThreshold, excess: FloatArray, hours: float) -> tuple[float, float]:
    """Most likely logarithm of a run's factor, and its standard error, from its peaks over the common level.

    Squares times s^2 pass the level ``rate exp(-(level / s^2 - level) / mean)`` times an hour, and exceed it by
    ``s^2 mean`` in the mean, where the tail is exponential with that mean.
    """
    mean = float(tail.excess.mean())
    squares = np.exp(2 * _LOGS)
    log_rate = math.log(tail.rate) - tail.level * (1 / squares - 1) / mean
    fit = excess.size * log_rate - hours * np.exp(np.minimum(log_rate, 50.0))
    fit += -2 * excess.size * _LOGS - excess.sum() / (squares * mean) - 0.5 * (_LOGS / _LOOSE) ** 2
    weight = np.exp(fit - fit.max())
    weight /= weight.sum()
    centre = float((weight * _LOGS).sum())
    return centre, math.sqrt(float((weight * (_LOGS - centre) ** 2).sum()))
