"""Single moments of recordings that decide a threshold: abrupt starts, ends, or one event."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

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

Rows = list[npt.NDArray[np.bool_]]


def ruling_moments(
    segments: Sequence[Segment],
    names: Sequence[str],
    joints: Sequence[int],
    thresholds: FloatArray,
    without: Callable[[list[Segment]], FloatArray],
) -> list[str]:
    """Notes of moments without which a threshold would be lower by a fifth or more.

    Tried are the first and the last second of all runs, where there are several, and the largest residual of every
    joint with a second to either side; then three seconds instead of one.

    Args:
        segments: that the thresholds were found from.
        names: of their runs.
        joints: numbers from 0 of the columns.
        thresholds: (dof,) constant ones, of these columns [Nm or N].
        without: thresholds (dof,) of the segments that are left.
    """
    notes: list[str] = []
    told: Rows = [np.zeros(len(part.t), dtype=bool) for part in segments]
    for words, seconds, rows in _candidates(segments, len(joints)):
        if any((of & before).any() for of, before in zip(rows, told, strict=True)):
            continue  # a start, an end or another joint's moment has told of it
        found = _ruled(segments, rows, thresholds, without)
        if found is None:
            continue
        j, lower = found
        told = [one | of for one, of in zip(told, rows, strict=True)]
        k, row = _largest(segments, rows, j)
        part = segments[k]
        run = [one for one in segments if one.run == part.run]
        after, before = float(part.t[row] - run[0].t[0]), float(run[-1].t[-1] - part.t[row])
        near = f"{after:.3g} s after its first row" if after <= before else f"{before:.3g} s before its last row"
        notes.append(
            f"{words} the thresholds: joint {joints[j] + 1} has {abs(float(part.residual[row, j])):.3g} at "
            f"{time_text(float(part.t[row]))} s of {names[part.run]}, {near}; without it the threshold would be "
            f"{lower:.3g} instead of {thresholds[j]:.3g}. If alarms should not be judged by it, "
            f"{_remedy(after, before, seconds)}."
        )
    return notes


def _remedy(after: float, before: float, seconds: float) -> str:
    near = min(after, before)
    if near > _NEAR_S:
        return "tune on what lies before and after it (--from, --until)"
    option = "--trim-start" if after <= before else "--trim-end"
    return f"leave it out with {option} {max(seconds, math.ceil(near + seconds / 2)):g}"


def _ruled(
    segments: Sequence[Segment], rows: Rows, thresholds: FloatArray, without: Callable[[list[Segment]], FloatArray]
) -> tuple[int, float] | None:
    """The joint whose threshold some rows rule most, and what it would be without them; None: they rule none."""
    sizes = [np.abs(part.residual) for part in segments]
    inside = np.max([size[of].max(axis=0, initial=0.0) for size, of in zip(sizes, rows, strict=True)], axis=0)
    outside = np.max([size[~of].max(axis=0, initial=0.0) for size, of in zip(sizes, rows, strict=True)], axis=0)
    if not (inside > _RULES * outside).any():
        return None
    try:
        lower = without(_left(segments, rows))
    except InputError:  # too little is left to tell
        return None
    j = int(np.argmax(thresholds / lower))
    return (j, float(lower[j])) if thresholds[j] > _RULES * lower[j] else None


def _candidates(segments: Sequence[Segment], dof: int) -> Iterator[tuple[str, float, Rows]]:
    """What may rule, how long it lasts to a side, and its rows."""
    runs = {part.run for part in segments}
    first = {run: min(float(part.t[0]) for part in segments if part.run == run) for run in runs}
    last = {run: max(float(part.t[-1]) for part in segments if part.run == run) for run in runs}
    everything = [np.ones(len(part.t), dtype=bool) for part in segments]
    largest = [_largest(segments, everything, j) for j in range(dof)]
    for long in _LONG_S:
        if len(runs) > 1:
            # One of several starts does not rule alone: the others would still be there.
            yield "The starts of recordings rule", long, [part.t <= first[part.run] + long for part in segments]
            yield "The ends of recordings rule", long, [part.t >= last[part.run] - long for part in segments]
        for k, row in largest:
            run, time = segments[k].run, segments[k].t[row]
            rows = [(part.run == run) & (np.abs(part.t - time) <= long) for part in segments]
            yield "One moment rules", long, rows


def _largest(segments: Sequence[Segment], rows: Rows, joint: int) -> tuple[int, int]:
    """Segment and row of a joint's largest residual among some rows."""
    sizes = [np.where(of, np.abs(part.residual[:, joint]), -1.0) for part, of in zip(segments, rows, strict=True)]
    k = int(np.argmax([size.max() for size in sizes]))
    return k, int(np.argmax(sizes[k]))


def _left(segments: Sequence[Segment], rows: Rows) -> list[Segment]:
    """The other rows, split where some were left away; runs are counted anew."""
    found = []
    for part, of in zip(segments, rows, strict=True):
        kept = np.flatnonzero(~of)
        for numbers in np.split(kept, np.flatnonzero(np.diff(kept) > 1) + 1):
            if numbers.size >= _MIN_ROWS:
                found.append(part.only(numbers))
    runs = sorted({part.run for part in found})
    return [replace(part, run=runs.index(part.run)) for part in found]
