"""Thresholds for a wanted number of false alarms an hour, from residuals of contact-free motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from bumpstop.arrays import FloatArray, as_number
from bumpstop.detection.peaks import PeaksOverThreshold
from bumpstop.detection.residual_file import ResidualSeries
from bumpstop.errors import InputError

FARTHEST = 100
"""Rates below one in so many times the recorded hours are flagged as extrapolated."""
# What is asked for where no rate is given: so many an hour, or one alarm in so many times the recordings' length.
_DEFAULT_PER_HOUR, _DEFAULT_REACH = 1.0, 10.0
_BIASED = 0.3  # of a threshold
_ENOUGH = 30  # peaks of a joint: with fewer its largest residual says more than a tail fitted to them
# Of a joint's peaks, how many pass the level that settles its share. A level passed once is chance, and the largest
# residual of all joints in such units is smaller in the recording than in any other.
_PASSED = 20


@dataclass(frozen=True, eq=False)
class Tuning:
    """Thresholds, the rate of false alarms they stand for, and how well both are known.

    Attributes:
        shares: (dof,) thresholds at factor 1 [Nm or N]; infinite: that joint is not watched.
        tail: of the largest residual of any joint in units of ``shares``.
        target: wanted false alarms an hour.
        confidence: of the intervals.
        notes: what a person should know.
    """

    shares: FloatArray
    tail: PeaksOverThreshold
    target: float
    confidence: float
    notes: tuple[str, ...]

    def thresholds(self, per_hour: float | None = None) -> FloatArray:
        """Thresholds (dof,) for a rate, default the target [Nm or N]; all joints keep their proportion."""
        return self.shares * self.tail.level_of(self._checked(per_hour))

    def thresholds_interval(self, per_hour: float | None = None) -> tuple[FloatArray, FloatArray]:
        """Lower and upper ends (dof,) of the thresholds that give the rate [Nm or N]."""
        low, high = self.tail.level_interval(self._checked(per_hour), self.confidence)
        return self.shares * low, self.shares * high

    def per_hour_interval(self, per_hour: float | None = None) -> tuple[float, float]:
        """Interval of the rate that ``thresholds(per_hour)`` have."""
        return self.tail.per_hour_interval(self.tail.level_of(self._checked(per_hour)), self.confidence)

    def extrapolation(self, per_hour: float | None = None) -> float:
        """Time between two alarms over time recorded: above 1 nothing like it was recorded even once."""
        return 1 / (self._checked(per_hour) * self.tail.hours)

    @property
    def cluster_rows(self) -> int:
        """Rows from one alarm to another that count as one."""
        return self.tail.cluster_rows

    def to_json(self) -> dict[str, Any]:
        """What ``bumpstop tune --json`` prints: no NaN, no infinity."""
        low, high = self.thresholds_interval()
        times = self.extrapolation()
        return {
            "thresholds_Nm": _finite(self.thresholds()),
            "thresholds_interval_Nm": [list(pair) for pair in zip(_finite(low), _finite(high), strict=True)],
            "per_hour": self.target,
            "per_hour_interval": list(self.per_hour_interval()),
            "confidence": self.confidence,
            "extrapolation": times,
            "extrapolated_too_far": times > FARTHEST,
            "hours": self.tail.hours,
            "peaks": int(self.tail.excess.size),
            "tail_shape": self.tail.shape,
            "notes": list(self.notes),
        }

    def _checked(self, per_hour: float | None) -> float:
        rate = self.target if per_hour is None else as_number(per_hour, "per_hour")
        if not 0 < rate < self.tail.rate:
            problem = f"{rate:g} false alarms an hour cannot be tuned for"
            raise InputError("per_hour", problem, f"wanted more than 0 and less than {self.tail.rate:.4g}")
        return rate


def tune(
    series: ResidualSeries | Sequence[ResidualSeries],
    per_hour: float | None = None,
    *,
    joints: Sequence[int] | None = None,
    confidence: float = 0.95,
) -> Tuning:
    """Choose thresholds that residuals of contact-free motion pass a wanted number of times an hour.

    1. Each joint alone gets the threshold that its own peaks pass ``per_hour / n`` times an hour, n being the number of
       watched joints, or 20 times in the recording where that is more often. That settles the proportion of the
       thresholds: no joint takes more than its share of the alarms. With fewer than 30 peaks it is the joint's largest
       residual. The shape of the tail is the mean of all joints': that of one joint alone is too uncertain.
    2. The largest residual of any joint, each in units of its threshold, is one series. Its tail gives the factor at
       which any joint alarms ``per_hour`` times an hour, whatever the joints have in common, and the intervals.

    Alarms that follow each other closely count as one (see ``PeaksOverThreshold``). Thresholds are symmetric; a mean of
    the residual counts.

    Args:
        series: one or several recordings with the same joints and rate.
        per_hour: wanted false alarms an hour, of all joints together; default: what the recordings can carry, one alarm
            in ten times their length, but no fewer than one an hour.
        joints: numbers from 0 of those to watch; default: all whose residual ever changes.
        confidence: of the intervals, between 0.5 and 0.999.

    Raises:
        InputError: recordings that do not go together, a joint in ``joints`` without noise, too few independent peaks,
            or a rate that is not between 0 and that of the peaks.
    """
    parts = [series] if isinstance(series, ResidualSeries) else list(series)
    dof, period = _common(parts)
    if not 0.5 <= as_number(confidence, "confidence") <= 0.999:
        raise InputError("confidence", f"is {confidence}", "wanted 0.5 to 0.999")
    supported = default_per_hour(parts)
    asked, per_hour = per_hour, supported if per_hour is None else per_hour
    if not as_number(per_hour, "per_hour") > 0:
        raise InputError("per_hour", f"is {per_hour}", "wanted more than 0")
    still = [j for j in range(dof) if not np.ptp(np.concatenate([part.rows[:, j] for part in parts])) > 0]
    watched = sorted(set([j for j in range(dof) if j not in still] if joints is None else joints))
    if len(still) == dof:
        raise InputError("residuals", "of no joint ever change", "wanted those of contact-free motion")
    if not watched or not 0 <= watched[0] <= watched[-1] < dof:
        raise InputError("joints", f"{[j + 1 for j in watched]} are not all joints", f"wanted some of 1 to {dof}")
    stretches = [part.rows[rows] for part in parts for rows in part.stretches()]
    shares = np.full(dof, math.inf)
    alone = {j: [np.abs(rows[:, j]) for rows in stretches] for j in watched}
    for j in still:
        if j in watched:
            raise InputError(f"residual of joint {j + 1}", "never changes", "leave that joint out")
    tails = {j: PeaksOverThreshold.fit(size, period) for j, size in alone.items()}
    shape = float(np.mean([tail.shape for tail in tails.values()]))
    for j, size in alone.items():
        if tails[j].excess.size < _ENOUGH:
            shares[j] = max(float(part.max()) for part in size)
            continue
        tail = PeaksOverThreshold.fit(size, period, shape=shape)
        # Well inside what was recorded: what extrapolates is the tail of all joints together.
        shares[j] = tail.level_of(min(max(per_hour / len(watched), _PASSED / tail.hours), 0.99 * tail.rate))
    largest = [np.abs(rows / shares).max(axis=1) for rows in stretches]
    tail = PeaksOverThreshold.fit(largest, period)
    tuning = Tuning(shares, tail, float(per_hour), confidence, ())
    thresholds = tuning.thresholds()
    notes = _notes(tuning, thresholds, stretches, parts)
    notes += [f"The residual of joint {j + 1} never changes." for j in still]
    if asked is None and supported > _DEFAULT_PER_HOUR:
        notes.append(
            f"No rate was given: {tail.hours:.3g} h carry one alarm in {_DEFAULT_REACH:g} times that, {supported:.3g}"
            " an hour. For fewer, record for longer or give the rate."
        )
    return Tuning(shares, tail, float(per_hour), confidence, tuple(notes))


def default_per_hour(parts: Sequence[ResidualSeries]) -> float:
    """False alarms an hour that are wanted if none are told: one in ten times the recordings, at least one an hour."""
    hours = sum(len(part.rows) * part.period for part in parts) / 3600
    return max(_DEFAULT_PER_HOUR, 1 / (_DEFAULT_REACH * hours)) if hours > 0 else _DEFAULT_PER_HOUR


def _common(parts: Sequence[ResidualSeries]) -> tuple[int, float]:
    if not parts:
        raise InputError("residuals", "there are none", "wanted at least one recording")
    first = parts[0]
    for part in parts[1:]:
        if part.dof != first.dof:
            raise InputError(part.source, f"has {part.dof} joints", f"{first.source} has {first.dof}")
        if abs(part.period - first.period) > 0.01 * first.period:
            raise InputError(
                part.source, f"has a row every {part.period:.6g} s", f"{first.source} every {first.period:.6g} s"
            )
    for one, other in combinations(parts, 2):
        if np.array_equal(one.rows, other.rows):
            # Each would count as hours of its own, and intervals would be too narrow.
            raise InputError(
                "residuals", f"of {one.source} and {other.source} are the same", "give each recording once"
            )
    return first.dof, first.period


def _notes(
    tuning: Tuning, thresholds: FloatArray, stretches: Sequence[FloatArray], parts: Sequence[ResidualSeries]
) -> list[str]:
    tail = tuning.tail
    period = parts[0].period
    notes = [
        f"{tail.excess.size} independent peaks in {tail.hours:.4g} h; alarms within {tail.cluster_rows * period:.3g} s "
        f"of each other count as one."
    ]
    times = tuning.extrapolation()
    if times > FARTHEST:
        notes.append(
            f"Extrapolated too far: one alarm in {1 / tuning.target:.4g} h is {times:.4g} times what was recorded, "
            f"more than {FARTHEST} times. Record for at least {1 / tuning.target / FARTHEST:.3g} h."
        )
    mean = np.concatenate(stretches).mean(axis=0)
    for j in np.flatnonzero(np.abs(mean) > _BIASED * thresholds):
        notes.append(
            f"The residual of joint {j + 1} has a mean of {mean[j]:.3g}, much of its threshold of {thresholds[j]:.3g}: "
            "a model that fits better would allow a lower one."
        )
    gaps = sum(len(part.stretches()) - 1 for part in parts)
    if gaps:
        notes.append(f"{gaps} gaps in time: peaks on either side count as separate, and the gaps not as hours.")
    unwatched = [str(j + 1) for j in np.flatnonzero(np.isinf(tuning.shares))]
    if unwatched:
        notes.append(f"Not watched: joint {', '.join(unwatched)}.")
    return notes


def _finite(values: FloatArray) -> list[float | None]:
    return [float(value) if math.isfinite(value) else None for value in values]
