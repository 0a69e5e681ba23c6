"""How often a noisy series passes a level it has hardly ever reached: peaks over a threshold."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.signal import correlation_time

MAX_PEAKS = 200
MIN_PEAKS = 6
MIN_ROWS = 100
# Peaks taken, as a share of the rows that are as good as independent: the tail, and not the body.
_TAIL = 0.05
# Of the prior of the shape: a residual's tail, not a flood's.
_SHAPE_SD = 0.3
_SHAPES = np.linspace(0.0, 1.2, 25)
_LOGS = np.linspace(-1, 1, 9)


@dataclass(frozen=True, eq=False)
class PeaksOverThreshold:
    """Peaks of a series over a level, and the generalised Pareto tail fitted to their squares.

    Clusters over the level come as a Poisson process with ``rate`` an hour; the squares of their peaks exceed that of
    the level by a generalised Pareto variable of ``scale`` and ``shape`` (S. Coles, "An introduction to statistical
    modeling of extreme values", 2001, chapter 4). Squares, as those of Gaussian noise have an exponential tail from low
    levels on, shape 0, where Gaussian peaks themselves take on the shape of their limit only far out. The likelihood
    carries a prior of the shape, that of a normal variable with mean 0 and standard deviation 0.3 that is not negative:
    a shape below 0 is a tail that ends, and few peaks prove no end. Noise that does end alarms less often than said.

    Attributes:
        level: square of what the peaks are over.
        excess: (k,) squares of the peaks minus ``level``, one for each cluster.
        hours: length of the series without its gaps [h].
        cluster_rows: rows over the level that are this far apart or farther belong to two clusters: found from the
            times between them, at most the correlation time.
        rate: clusters an hour.
        scale, shape: of the tail, most likely.
        rows: (k,) first row of each cluster, counted through all segments.
    """

    level: float
    excess: FloatArray
    hours: float
    cluster_rows: int
    rate: float
    scale: float
    shape: float
    rows: npt.NDArray[np.int64]

    @classmethod
    def fit(cls, segments: Sequence[FloatArray], period: float, *, shape: float | None = None) -> PeaksOverThreshold:
        """Fit the tail of a series.

        The level is that which leaves a peak for every twenty rows that are as good as independent, at least 10 and at
        most 200 peaks.

        Args:
            segments: parts of the series without gaps, each (n,), zero or more.
            period: between rows [s].
            shape: of the tail, if it is known.

        Raises:
            InputError: fewer than 6 clusters, or than 100 rows.
        """
        segments = [part**2 for part in segments]
        joined = np.concatenate(segments)
        if joined.size < MIN_ROWS:
            raise InputError("residuals", f"{joined.size} rows", f"wanted at least {MIN_ROWS}")
        memory = correlation_time(max(segments, key=lambda part: part.size))
        wanted = int(np.clip(_TAIL * joined.size / memory, 10, MAX_PEAKS))
        level, peaks, gap = _level(joined, segments, math.ceil(memory), wanted)
        if peaks.size < MIN_PEAKS:
            problem = f"{peaks.size} independent peaks in {joined.size * period:.4g} s"
            raise InputError("residuals", problem, f"wanted at least {MIN_PEAKS}: record for longer")
        excess = peaks - level
        hours = joined.size * period / 3600
        scale, found = _most_likely(excess, shape)
        if found < 0:
            scale, found = _most_likely(excess, 0.0)
        begins = np.cumsum([0, *(part.size for part in segments[:-1])])
        rows = [begin + clusters(part, level, gap)[0] for begin, part in zip(begins, segments, strict=True)]
        return cls(level, excess, hours, gap, excess.size / hours, scale, found, np.concatenate(rows))

    def per_hour(self, x: float) -> float:
        """Clusters an hour that pass ``x``. Below the level the tail goes on with the slope it has there."""
        over = (x * x - self.level) / self.scale
        return self.rate * float(np.exp(-over if over < 0 else -_log_tail(over, self.shape)))

    def level_of(self, per_hour: float) -> float:
        """What is passed ``per_hour`` times an hour, at most the rate of the peaks."""
        log = math.log(self.rate / per_hour)
        return math.sqrt(self.level + self.scale * (math.expm1(self.shape * log) / self.shape if self.shape else log))

    @property
    def peaks(self) -> FloatArray:
        """(k,) largest value of each cluster, in order of time."""
        return np.sqrt(self.level + self.excess)

    def per_hour_interval(self, x: float, confidence: float = 0.95) -> tuple[float, float]:
        """Interval of :meth:`per_hour` at ``x``, above the level, by profile likelihood. The lower end may be 0."""
        drop = self._drop(confidence)

        def left(log: float) -> float:
            return self._profile(math.exp(log), x * x) - drop

        here, top, bottom = math.log(self.per_hour(x)), math.log(self.rate) + 5, math.log(self.rate) - 40
        low = _crossing(left, here, bottom, -1)
        return math.exp(low) if low > bottom else 0.0, math.exp(_crossing(left, here, top, 1))

    def level_interval(self, per_hour: float, confidence: float = 0.95) -> tuple[float, float]:
        """Interval of :meth:`level_of`, by profile likelihood."""
        here = self.level_of(per_hour)
        drop = self._drop(confidence)

        def left(x: float) -> float:
            return self._profile(per_hour, x * x) - drop

        bottom = math.sqrt(self.level)
        return _crossing(left, here, bottom + 1e-9 * (here - bottom), -1), _crossing(left, here, 1e3 * here, 1)

    def _drop(self, confidence: float) -> float:
        from scipy.stats import chi2

        rate = self.excess.size * math.log(self.rate) - self.rate * self.hours
        return rate + float(_log_likelihood(self.excess, self.scale, self.shape)) - float(chi2.ppf(confidence, 1)) / 2

    def _profile(self, per_hour: float, square: float) -> float:
        """Largest log-likelihood of all tails whose squares pass ``square`` so often."""
        k = self.excess.size
        spread = 4 / math.sqrt(k)
        best, shapes, centre = -math.inf, _SHAPES, math.log(self.rate)
        for _ in range(2):
            logs = centre + spread * _LOGS
            log_rate, shape = (grid.ravel() for grid in np.meshgrid(logs, shapes))
            over = log_rate - math.log(per_hour)
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                reach = np.where(np.abs(shape) > 1e-9, np.expm1(shape * over) / shape, over)
                scale = np.where(reach > 0, (square - self.level) / reach, np.nan)
                fit = _log_likelihood(self.excess, scale, shape)
                fit = fit + k * log_rate - np.exp(log_rate) * self.hours
            fit = np.where(np.isfinite(fit), fit, -math.inf)
            at = int(fit.argmax())
            best = max(best, float(fit[at]))
            step = shapes[1] - shapes[0]
            shapes = np.linspace(max(0.0, shape[at] - step), shape[at] + step, 7)
            centre, spread = float(log_rate[at]), spread / 4
        return best


def clusters(x: FloatArray, level: float, gap: int) -> tuple[npt.NDArray[np.int64], FloatArray]:
    """First rows and peaks of the clusters over a level: rows over it that are less than ``gap`` apart.

    Args:
        x: (n,) evenly sampled, without gaps.
        level: to pass.
        gap: rows from the last over the level to the first of the next cluster, at least 1.
    """
    over = np.flatnonzero(x > level)
    if over.size == 0:
        return np.empty(0, dtype=np.int64), np.empty(0)
    first = np.concatenate([[0], np.flatnonzero(np.diff(over) >= gap) + 1])
    return over[first].astype(np.int64), np.maximum.reduceat(x[over], first)


def _level(
    joined: FloatArray, segments: Sequence[FloatArray], longest: int, wanted: int
) -> tuple[float, FloatArray, int]:
    """The highest of some forty levels that leaves the wanted clusters, or that with most: level, peaks, gap."""
    rising = np.sort(joined)
    best_level, best, best_gap = math.inf, np.empty(0), longest
    # Each step takes a quarter more rows; below the middle clusters only grow together.
    ranks = np.unique(np.geomspace(wanted, joined.size / 2, 40).astype(np.int64))
    for rank in ranks:
        level = float(rising[rising.size - 1 - rank])
        gap = _gap([np.flatnonzero(part > level) for part in segments], longest)
        found = np.concatenate([clusters(part, level, gap)[1] for part in segments])
        if found.size > best.size:
            best_level, best, best_gap = level, found, gap
        if found.size >= wanted:
            break
    return best_level, best, best_gap


def _gap(over: Sequence[npt.NDArray[np.int64]], longest: int) -> int:
    """Rows between clusters, from the times between rows over a level; at most ``longest``.

    In a Poisson process of clusters these times are a mixture of zeros and exponential times; the intervals estimator
    of the share of clusters tells which are the latter (C. Ferro and J. Segers, "Inference for clusters of extreme
    values", J. R. Stat. Soc. B 65, 2003).
    """
    times = np.sort(np.concatenate([np.diff(rows) for rows in over]))[::-1].astype(np.float64)
    if times.size < 2 or times[0] <= 2:
        return longest
    share = 2 * (times - 1).sum() ** 2 / (times.size * ((times - 1) * (times - 2)).sum())
    between = math.floor(share * times.size)
    return 1 if between >= times.size else min(longest, int(times[between]) + 1)


def _log_tail(y: FloatArray | float, shape: FloatArray | float) -> FloatArray:
    """Minus the logarithm of P(excess > y scale): log1p(shape y) / shape, infinite beyond the end."""
    y, shape = np.asarray(y), np.asarray(shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = 1 + shape * y > 0
        log = np.where(np.abs(shape) > 1e-9, np.log1p(np.where(inside, shape * y, 0)) / shape, y)
    return np.where(inside, log, np.inf)


def _log_likelihood(excess: FloatArray, scale: FloatArray | float, shape: FloatArray | float) -> FloatArray:
    """Of tails given by scale and shape, with the shape's prior."""
    scale, shape = np.asarray(scale), np.asarray(shape)
    tails = _log_tail(excess / scale[..., None], shape[..., None]).sum(axis=-1)
    fit: FloatArray = -excess.size * np.log(scale) - (1 + shape) * tails - 0.5 * (shape / _SHAPE_SD) ** 2
    return fit


def _most_likely(excess: FloatArray, shape: float | None) -> tuple[float, float]:
    """Scale and shape, or the scale at a given shape."""
    from scipy.optimize import minimize

    mean = float(excess.mean())
    if not mean > 0:
        raise InputError("residuals", "all peaks are of one height", "wanted noise with a tail")

    def cost(at: FloatArray) -> float:
        value = -float(_log_likelihood(excess, mean * math.exp(at[0]), at[1] if shape is None else shape))
        return value if math.isfinite(value) else 1e300

    # Well inside what the highest peak allows.
    start = [0.0] if shape is None else [max(0.0, math.log(max(1e-9, -2 * shape * float(excess.max()) / mean)))]
    start += [0.0] if shape is None else []
    found = minimize(cost, start, method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-9, "maxiter": 2000})
    return mean * math.exp(float(found.x[0])), float(found.x[1]) if shape is None else shape


def _crossing(function: object, here: float, bound: float, side: int) -> float:
    """Where a function that is positive at ``here`` falls through zero on the way to ``bound``; else the bound."""
    assert callable(function)
    step = max(abs(here) * 1e-3, 1e-6, abs(bound - here) * 1e-4)
    inside, outside = here, here + side * step
    while function(outside) > 0:
        step *= 1.7
        inside, outside = outside, here + side * step
        if side * (outside - bound) >= 0:
            outside = bound
            if function(outside) > 0:
                return bound
            break
    for _ in range(25):
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if function(middle) > 0 else (inside, middle)
    return (inside + outside) / 2
