"""Single moments of recordings that decide a threshold: abrupt starts, ends, or one event."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.detection.scoring.labels import time_text
from bumpstop.detection.tuning.proportions import Segment
from bumpstop.errors import InputError

_LONG_S = (1.0, 3.0)  # starts and ends of runs, and to either side of a moment [s]
_RULES = 1.25  # a threshold that is so many times what it would be without a moment is ruled by it
_NEAR_S = 5.0  # from a run's first or last row: cutting that much off costs little
_MIN_ROWS = 10  # of what is left of a segment
_SEVERAL = 12  # moments that are looked for together
_MOST_OF = 0.25  # of the rows, that are left out together
_STAND_OUT = 2.0  # so many times the next largest residual the last of several is, and a threshold with them without

Rows = list[npt.NDArray[np.bool_]]


@dataclass(frozen=True)
class _Candidate:
    """Rows that may rule thresholds.

    Attributes:
        words: what it is, before "rule".
        seconds: how long it lasts to a side.
        rows: masks, one of each segment.
        times: when they are and of which run; empty where the largest residual among them tells.
    """

    words: str
    seconds: float
    rows: Rows
    times: str = ""


def ruling_moments(
    segments: Sequence[Segment],
    names: Sequence[str],
    units: Mapping[int, str],
    thresholds: FloatArray,
    without: Callable[[list[Segment]], FloatArray],
) -> list[str]:
    """Notes of moments without which a threshold would be lower by a fifth or more.

    Tried are the first and the last second of all runs, where there are several, and the largest residual of every
    joint with a second to either side; then three seconds instead of one. Before a single residual several that stand
    out are tried together, as contacts do: without one of them the others would rule as much.

    Args:
        segments: that the thresholds were found from.
        names: of their runs.
        units: of each joint of the columns, by its number from 0.
        thresholds: (dof,) constant ones, of these columns [Nm or N].
        without: thresholds (dof,) of the segments that are left.
    """
    notes: list[str] = []
    joints = list(units)
    told: Rows = [np.zeros(len(part.t), dtype=bool) for part in segments]
    for one in _candidates(segments, names, len(units)):
        if any((of & before).any() for of, before in zip(one.rows, told, strict=True)):
            continue  # a start, an end or another joint's moment has told of it
        found = _ruled(segments, one, thresholds, without)
        if found is None:
            continue
        j, lower = found
        told = [of | before for of, before in zip(one.rows, told, strict=True)]
        k, row = _largest(segments, one.rows, j)
        part = segments[k]
        unit = units[joints[j]]
        size = f"{abs(float(part.residual[row, j])):.3g} {unit}"
        change = f"the threshold would be {lower:.3g} {unit} instead of {thresholds[j]:.3g} {unit}"
        if one.times:
            notes.append(
                f"{one.words} rule the thresholds together: joint {joints[j] + 1} has up to {size} at {one.times}; "
                f"without them {change}. Are there contacts in it? If so, tune on recordings without any, or on what "
                "lies before, between and after them (--from, --until)."
            )
            continue
        run = [other for other in segments if other.run == part.run]
        after, before = float(part.t[row] - run[0].t[0]), float(run[-1].t[-1] - part.t[row])
        near = f"{after:.3g} s after its first row" if after <= before else f"{before:.3g} s before its last row"
        notes.append(
            f"{one.words} the thresholds: joint {joints[j] + 1} has {size} at "
            f"{time_text(float(part.t[row]))} s of {names[part.run]}, {near}; without it {change}. If alarms should "
            f"not be judged by it, {_remedy(after, before, one.seconds)}."
        )
    return notes


def _remedy(after: float, before: float, seconds: float) -> str:
    near = min(after, before)
    if near > _NEAR_S:
        return "tune on what lies before and after it (--from, --until)"
    option = "--trim-start" if after <= before else "--trim-end"
    return f"leave it out with {option} {max(seconds, math.ceil(near + seconds / 2)):g}"


def _ruled(
    segments: Sequence[Segment],
    candidate: _Candidate,
    thresholds: FloatArray,
    without: Callable[[list[Segment]], FloatArray],
) -> tuple[int, float] | None:
    """The joint whose threshold some rows rule most, and what it would be without them; None: they rule none."""
    rows, rules = candidate.rows, _STAND_OUT if candidate.times else _RULES
    sizes = [np.abs(part.residual) for part in segments]
    inside = np.max([size[of].max(axis=0, initial=0.0) for size, of in zip(sizes, rows, strict=True)], axis=0)
    outside = np.max([size[~of].max(axis=0, initial=0.0) for size, of in zip(sizes, rows, strict=True)], axis=0)
    if not (inside > rules * outside).any():
        return None
    try:
        lower = without(_left(segments, rows))
    except InputError:  # too little is left to tell
        return None
    j = int(np.argmax(thresholds / lower))
    return (j, float(lower[j])) if thresholds[j] > rules * lower[j] else None


def _candidates(segments: Sequence[Segment], names: Sequence[str], dof: int) -> Iterator[_Candidate]:
    """What may rule, in the order in which it is tried."""
    runs = {part.run for part in segments}
    first = {run: min(float(part.t[0]) for part in segments if part.run == run) for run in runs}
    last = {run: max(float(part.t[-1]) for part in segments if part.run == run) for run in runs}
    for long in _LONG_S:
        if len(runs) > 1:
            # One of several starts does not rule alone: the others would still be there.
            starts = [part.t <= first[part.run] + long for part in segments]
            yield _Candidate("The starts of recordings rule", long, starts)
            ends = [part.t >= last[part.run] - long for part in segments]
            yield _Candidate("The ends of recordings rule", long, ends)
        largest = [_largest_apart(segments, j, long) for j in range(dof)]
        for moments in largest:
            several = _standing_out(moments)
            # Starts and ends alone are told as such.
            at_ends = len(runs) > 1 and all(
                min(one.time - first[one.run], last[one.run] - one.time) <= max(_LONG_S) for one in several
            )
            rows = _any([moment.rows for moment in several]) if several and not at_ends else []
            # Without a great part of the motion thresholds are those of another one.
            if rows and sum(int(of.sum()) for of in rows) <= _MOST_OF * sum(of.size for of in rows):
                yield _Candidate(f"{len(several)} moments", long, rows, _times(several, names))
        for moments in largest:
            yield _Candidate("One moment rules", long, moments[0].rows)


@dataclass(frozen=True)
class _Moment:
    """A largest residual of a joint: its run, its time [s], its size, and the rows around it."""

    run: int
    time: float
    size: float
    rows: Rows


def _largest_apart(segments: Sequence[Segment], joint: int, long: float) -> list[_Moment]:
    """The largest residuals of a joint, the first one first, each so long away from those before it [s]."""
    left: Rows = [np.ones(len(part.t), dtype=bool) for part in segments]
    found: list[_Moment] = []
    while len(found) <= _SEVERAL and any(of.any() for of in left):
        k, row = _largest(segments, left, joint)
        run, time = segments[k].run, segments[k].t[row]
        near = [(part.run == run) & (np.abs(part.t - time) <= long) for part in segments]
        found.append(_Moment(run, float(time), abs(float(segments[k].residual[row, joint])), near))
        left = [of & ~around for of, around in zip(left, near, strict=True)]
    return found


def _standing_out(moments: Sequence[_Moment]) -> Sequence[_Moment]:
    """Those before the deepest step down in size, where they are several and the step is deep."""
    if len(moments) < 2:
        return ()
    steps = [one.size / max(after.size, 1e-300) for one, after in pairwise(moments)]
    count = int(np.argmax(steps)) + 1
    return moments[:count] if count > 1 and steps[count - 1] > _STAND_OUT else ()


def _any(masks: Sequence[Rows]) -> Rows:
    return [np.logical_or.reduce(of) for of in zip(*masks, strict=True)]


def _times(moments: Sequence[_Moment], names: Sequence[str]) -> str:
    """When moments are, run by run, in words."""
    found: dict[int, list[float]] = {}
    for one in moments:
        found.setdefault(one.run, []).append(one.time)
    each = (f"{', '.join(time_text(t) for t in sorted(times))} s of {names[run]}" for run, times in found.items())
    return "; ".join(each)


def _largest(segments: Sequence[Segment], rows: Rows, joint: int) -> tuple[int, int]:
    """Segment and row of a joint's largest residual among some rows."""
    sizes = [np.where(of, np.abs(part.residual[:, joint]), -1.0) for part, of in zip(segments, rows, strict=True)]
    k = int(np.argmax([size.max() for size in sizes]))
    return k, int(np.argmax(sizes[k]))


def _left(segments: Sequence[Segment], rows: Rows) -> list[Segment]:
    """The other rows, split where some were left out; runs are counted anew."""
    found = []
    for part, of in zip(segments, rows, strict=True):
        kept = np.flatnonzero(~of)
        for numbers in np.split(kept, np.flatnonzero(np.diff(kept) > 1) + 1):
            if numbers.size >= _MIN_ROWS:
                found.append(part.only(numbers))
    runs = sorted({part.run for part in found})
    return [replace(part, run=runs.index(part.run)) for part in found]
