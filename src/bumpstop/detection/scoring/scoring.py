"""How well events agree with labels: what was detected and how late, what was missed, what was false."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray, as_float_array, as_number, finite_or_none
from bumpstop.detection.scoring.labels import Label, checked_labels, time_text
from bumpstop.detection.scoring.score import Interval, Score
from bumpstop.detection.thresholds import Thresholds
from bumpstop.detection.tuning.residual_file import ResidualSeries
from bumpstop.errors import InputError

_DIGITS = 9  # of a delay that count: nanoseconds


@dataclass(frozen=True)
class Tolerance:
    """How far an event may lie outside a label and still belong to it.

    Attributes:
        early_s: before its start, as labels are set by hand [s].
        late_s: after its end, as filters are late [s].
    """

    early_s: float = 0.05
    late_s: float = 0.25

    def __post_init__(self) -> None:
        for name in ("early_s", "late_s"):
            if not as_number(getattr(self, name), name) >= 0:
                raise InputError(name, f"is {getattr(self, name)}", "wanted zero or more")


@dataclass(frozen=True, eq=False)
class Roc:
    """What a factor on all thresholds does.

    Attributes:
        factor: (M,) rising.
        detected: (M,) labels detected.
        labels: of how many.
        false_alarms_per_hour: (M,); NaN without any time for one.
        median_delay_s: (M,) of those detected [s]; NaN: none.
    """

    factor: FloatArray
    detected: npt.NDArray[np.int64]
    labels: int
    false_alarms_per_hour: FloatArray
    median_delay_s: FloatArray

    def to_json(self) -> list[dict[str, float | int | None]]:
        """One object for each factor."""
        columns = zip(self.factor, self.detected, self.false_alarms_per_hour, self.median_delay_s, strict=True)
        return [
            {
                "factor": float(factor),
                "detected": int(detected),
                "missed": self.labels - int(detected),
                "false_alarms_per_hour": finite_or_none(float(rate)),
                "median_delay_s": finite_or_none(float(delay)),
            }
            for factor, detected, rate, delay in columns
        ]


def score(
    events: npt.ArrayLike,
    labels: Sequence[Label],
    monitored: Interval,
    *,
    no_data: Sequence[Interval] = (),
    arming: Sequence[Interval] = (),
    tolerance: Tolerance | None = None,
) -> Score:
    """Compare the times of events with labels.

    - An event belongs to a label if it lies between ``early_s`` before its start and ``late_s`` after its end. Where
      that holds for two labels, it belongs to the one it lies inside, else to the one whose edge is nearer, the earlier
      one of two as near.
    - The first event of a label is its detection; more of them count as nothing. Events of no label are false alarms.
    - A label without an event is missed, also where the detector had no data meanwhile: that is what missing data cost.
    - Labels not wholly inside the time monitored are left out, and so are the events that belong to them.
    - Hours are the time monitored without labels, their tolerance, time without data, and arming: no event is false
      there.

    Args:
        events: (K,) times, any order [s].
        labels: contacts.
        monitored: first and last time of the recording [s].
        no_data: times from and to when the detector had no data, any order; may overlap [s].
        arming: the same of times when it was not armed yet.
        tolerance: default: 0.05 s early, 0.25 s late.

    Raises:
        InputError: an event outside the time monitored, times that run backwards, labels that overlap.
    """
    times = np.sort(as_float_array(events, "events", (None,)))
    edges = tolerance or Tolerance()
    begin, end = (as_number(value, "monitored") for value in monitored)
    if not 0 < end - begin < math.inf:
        raise InputError(
            "monitored", f"{time_text(begin)} to {time_text(end)} s is no time", "wanted an end after its start"
        )
    if times.size and not begin <= times[0] <= times[-1] <= end:
        wrong = times[0] if times[0] < begin else times[-1]
        valid = f"the recording is from {time_text(begin)} to {time_text(end)} s"
        raise InputError("events", f"one is at {time_text(wrong)} s", valid)
    dark = _merged(no_data, begin, end)
    ordered = checked_labels(labels)
    inside = np.array([begin <= label.start_s and label.end_s <= end for label in ordered], dtype=bool)
    owner = np.array([_owner(time, ordered, edges) for time in times], dtype=np.int64)
    delay = np.full(len(ordered), math.nan)
    repeated = 0
    for time, number in zip(times, owner, strict=True):
        if number < 0 or not inside[number]:
            continue
        if math.isfinite(delay[number]):
            repeated += 1
        else:
            # Of two times that are the same in the file nothing is left but the last digits.
            delay[number] = round(time - ordered[number].start_s, _DIGITS) + 0.0
    covered = [any(a <= label.start_s and label.end_s <= b for a, b in dark) for label in ordered]
    excluded = [(label.start_s - edges.early_s, label.end_s + edges.late_s) for label in ordered] + dark
    excluded += _merged(arming, begin, end)
    contact = sum(b - a for a, b in _merged(excluded, begin, end))
    kept = tuple(label for label, keep in zip(ordered, inside, strict=True) if keep)
    return Score(
        kept,
        delay[inside],
        np.array(covered, dtype=bool)[inside] & np.isnan(delay[inside]),
        times[owner < 0],
        repeated,
        max(0.0, end - begin - contact) / 3600,
        sum(b - a for a, b in dark),
        int((~inside).sum()),
    )


def roc(
    series: ResidualSeries,
    thresholds: npt.ArrayLike,
    labels: Sequence[Label],
    factors: npt.ArrayLike,
    *,
    rearm_s: float = 0.5,
    tolerance: Tolerance | None = None,
    monitored: Interval | None = None,
    no_data: Sequence[Interval] | None = None,
    arming: Sequence[Interval] = (),
) -> Roc:
    """Score the residuals of a recording at thresholds times each of several factors.

    Events are those of :func:`event_times`, but for those while the detector was arming.

    Args:
        series: residuals.
        thresholds: (dof,) [Nm or N]; infinite: not monitored.
        labels: contacts.
        factors: (M,) positive.
        rearm_s: time without a row over a threshold after which there may be another event [s].
        tolerance: as of :func:`score`.
        monitored: first and last time of the recording, where not all its rows are residuals; default: theirs [s].
        no_data: times from and to when there are no residuals; default: the gaps between them [s].
        arming: times from and to when the detector was not armed yet [s].

    Raises:
        InputError: no factor, one that is not positive, or thresholds of another number of joints.
    """
    scaled = scaled_residual(series, thresholds)
    steps = np.sort(as_float_array(factors, "factors", (None,)))
    if not steps.size or not steps[0] > 0:
        raise InputError("factors", f"{steps[:1].tolist()}", "wanted at least one, all more than 0")
    armed = np.ones(scaled.size, dtype=bool)
    for a, b in arming:
        armed &= (series.t <= a) | (series.t > b)
    scaled = np.where(armed, scaled, 0.0)
    scores = [
        score(
            event_times(series, scaled, float(factor), rearm_s),
            labels,
            monitored or (float(series.t[0]), float(series.t[-1])),
            no_data=gaps(series) if no_data is None else no_data,
            arming=arming,
            tolerance=tolerance,
        )
        for factor in steps
    ]
    delays = [one.delay_s[np.isfinite(one.delay_s)] for one in scores]
    return Roc(
        steps,
        np.array([one.detected for one in scores], dtype=np.int64),
        len(scores[0].labels),
        np.array([one.false_alarms_per_hour for one in scores]),
        np.array([float(np.median(late)) if late.size else math.nan for late in delays]),
    )


def scaled_residual(series: ResidualSeries, thresholds: npt.ArrayLike) -> FloatArray:
    """(N,) largest residual of any joint in units of its threshold: an alarm where it is over 1.

    Args:
        series: residuals.
        thresholds: (dof,) [Nm or N]; infinite: not monitored.
    """
    theta = Thresholds.of(thresholds, series.dof).constant
    largest: FloatArray = np.abs(series.rows / theta).max(axis=1)
    return largest


def event_times(series: ResidualSeries, scaled: FloatArray, factor: float, rearm_s: float) -> FloatArray:
    """Times of events: the first row over ``factor`` after ``rearm_s`` without one, as a detector's run has them.

    An event that has not ended at a gap goes on behind it, and the time below the thresholds counts anew there.

    Args:
        series: residuals.
        scaled: (N,) of :func:`scaled_residual`.
        factor: on all thresholds.
        rearm_s: time without a row over a threshold after which there may be another event [s].

    Returns:
        (events,) [s].

    Raises:
        InputError: a rearm_s below zero, or one that is not finite.
    """
    if as_number(rearm_s, "rearm_s") < 0:
        raise InputError("rearm_s", f"is {rearm_s}", "wanted zero or more")
    found, lasting = [], False
    for part in series.segments():
        t = series.t[part]
        loud = np.flatnonzero(scaled[part] > factor)
        if lasting:
            loud = np.concatenate([[-1], loud])
        if not loud.size:
            continue
        # The last row before the next loud one ends the event, if it is not that loud row itself, and late enough.
        quiet = np.append(loud[1:], t.size) - 1
        ended = (quiet > loud) & (t[quiet] - t[np.maximum(loud, 0)] >= rearm_s)
        begins = np.concatenate([[not lasting], ended[:-1]])
        found.append(t[loud[begins]])
        lasting = not ended[-1]
    return np.concatenate(found) if found else np.empty(0)


def gaps(series: ResidualSeries) -> list[Interval]:
    """Times without rows [s]."""
    parts = itertools.pairwise(series.segments())
    return [(float(series.t[a.stop - 1]), float(series.t[b.start])) for a, b in parts]


def _owner(time: float, labels: Sequence[Label], edges: Tolerance) -> int:
    best, nearest = -1, math.inf
    for number, label in enumerate(labels):
        if not label.start_s - edges.early_s <= time <= label.end_s + edges.late_s:
            continue
        distance = max(label.start_s - time, time - label.end_s, 0.0)
        if distance < nearest:
            best, nearest = number, distance
    return best


def cover(intervals: Sequence[Interval], monitored: Interval) -> bool:
    """Whether intervals [s] leave nothing of the time monitored."""
    begin, end = monitored
    return _merged(intervals, begin, end) == [(begin, end)]


def _merged(intervals: Sequence[Interval], begin: float, end: float) -> list[Interval]:
    """Parts of begin..end that any interval covers, without overlap."""
    merged: list[Interval] = []
    for a, b in sorted(intervals):
        if not a <= b:
            raise InputError("no_data", f"from {time_text(a)} to {time_text(b)} s", "wanted an end after its start")
        low, high = max(a, begin), min(b, end)
        if low >= high:
            continue
        if merged and low <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(high, merged[-1][1]))
        else:
            merged.append((low, high))
    return merged
