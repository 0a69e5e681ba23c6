"""Rows whose time does not rise."""

from __future__ import annotations

from bisect import bisect_left

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray


def disorder(t: FloatArray) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Rows that repeat an earlier time, and the fewest others without which time rises."""
    steps = np.diff(t)
    nothing = np.zeros(0, dtype=np.int64)
    if t.size < 2 or (steps > 0).all():
        return nothing, nothing
    _, first = np.unique(t, return_index=True)
    repeats = np.ones(t.size, dtype=bool)
    repeats[first] = False
    left = np.flatnonzero(~repeats)
    x = t[left]
    before = np.concatenate([[-np.inf], np.maximum.accumulate(x)[:-1]])
    after = np.concatenate([np.minimum.accumulate(x[::-1])[::-1][1:], [np.inf]])
    # In order with every other row: only what lies between two such rows is in doubt.
    doubtful = np.flatnonzero(~((x > before) & (x < after)))
    keep = np.ones(x.size, dtype=bool)
    keep[doubtful] = False
    for run in np.split(doubtful, np.flatnonzero(np.diff(doubtful) > 1) + 1):
        keep[run[_longest_rising(x[run])]] = True
    return np.flatnonzero(repeats), left[~keep]


def _longest_rising(x: FloatArray) -> list[int]:
    """Indices of a longest rising subsequence of distinct numbers."""
    tails: list[float] = []
    ends: list[int] = []
    previous: list[int] = []
    for i, value in enumerate(x.tolist()):
        k = bisect_left(tails, value)
        previous.append(ends[k - 1] if k else -1)
        if k == len(tails):
            tails.append(value)
            ends.append(i)
        else:
            tails[k], ends[k] = value, i
    chain = []
    i = ends[-1] if ends else -1
    while i >= 0:
        chain.append(i)
        i = previous[i]
    return chain[::-1]
