"""Rows whose positions the arm cannot have been at: garbage between good rows, rows of zeros, angles that wrap."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.model import Robot

Mask = npt.NDArray[np.bool_]

# A way is possible where it takes no more than this many times the speed limit, given the clock's jitter of so many
# median intervals and the resolution of an encoder [rad or m].
_TIMES_LIMIT, _JITTER, _RESOLUTION = 2.0, 2.0, 5e-3
# Without a robot: so many times the speed that 95 % of the rows stay below, and no less than this [rad/s or m/s].
_TIMES_USUAL, _USUAL = 10.0, 3.0
# A jump that stays costs so many rows, or this share of all: garbage that is shorter goes, what is longer stays.
_COST_ROWS, _COST_SHARE = 5.0, 0.01
_BACK = 40  # stretches that one looks back over
_GAP_S, _GAP_STEPS = 0.1, 10.0  # a longer interval says nothing of what lies behind it
_TURN = 2 * np.pi
_FAR_FROM_TURN = 2.0  # [rad]


def usual_speed(t: FloatArray, q: FloatArray, robot: Robot | None) -> FloatArray:
    """(n,) speed that the joints do not exceed: the robot's limits, or what most rows stay far below."""
    if robot is not None:
        return np.asarray(robot.velocity, dtype=np.float64)
    rows = np.arange(0, t.size - 1, max(1, t.size // 50_000))
    # Rows that come late in pairs would look fast.
    steps = np.maximum(t[rows + 1] - t[rows], np.median(np.diff(t)))
    fastest = float(np.quantile(np.abs(q[rows + 1] - q[rows]) / steps[:, None], 0.95, axis=0).max(initial=0.0))
    return np.full(q.shape[1], max(_USUAL, _TIMES_USUAL * fastest) / _TIMES_LIMIT)


def turns(t: FloatArray, q: FloatArray, speed: FloatArray, revolute: Mask) -> FloatArray:
    """Whole turns (N - 1, n) by which angles wrap from row to row: steps that are possible but for these."""
    if not _jumps_somewhere(t, q, speed):
        return np.zeros((t.size - 1, q.shape[1]))
    step = np.diff(q, axis=0)
    count = np.where(revolute, np.round(step / _TURN), 0.0)
    way = _way(t, speed)
    # Where half a turn is no jump for the joint it may have gone there.
    possible = (np.abs(step - _TURN * count) <= way) & (way < _FAR_FROM_TURN)
    return np.where(possible, count, 0.0)


def impossible_rows(t: FloatArray, q: FloatArray, speed: FloatArray, revolute: Mask) -> tuple[Mask, Mask]:
    """Rows with impossible positions, and rows before which the positions jump for good.

    Rows are cut into stretches where a step is impossible. The chain of stretches with the most rows is kept, where a
    jump within it costs more than a few rows: single rows of garbage go, and a position that has changed for good, as
    after a new reference, stays and is told. Stretches of zeros go wherever a jump leads to them or from them.

    Args:
        t: (N,) rising times [s].
        q: (N, n) positions [rad or m].
        speed: (n,) limits of the joints' speeds [rad/s or m/s].
        revolute: (n,) joints whose angles may wrap.

    Returns:
        Masks (N,).
    """
    n = t.size
    nothing = np.zeros(n, dtype=bool)
    if not _jumps_somewhere(t, q, speed):
        return nothing, nothing
    step = np.diff(q, axis=0)
    way = _way(t, speed)
    wrapped = np.where(revolute, step - _TURN * np.round(step / _TURN), step)
    broken = (np.abs(wrapped) > way).any(axis=1) & ~_gaps(t)
    edges = np.concatenate([[0], np.flatnonzero(broken) + 1, [n]])
    if edges.size <= 2:
        return nothing, nothing
    begin, end = edges[:-1], edges[1:]
    zero = (q == 0).all(axis=1) if q.shape[1] > 1 else nothing
    zeros = np.array([bool(zero[a:b].all()) for a, b in zip(begin, end, strict=True)])
    size = (end - begin).astype(np.float64)
    cost = max(_COST_ROWS, _COST_SHARE * n)
    slowest = float(np.median(np.diff(t)))
    best, before = size.copy(), np.full(size.size, -1)
    best[zeros] = -np.inf
    for k in range(size.size):
        earlier = np.arange(max(0, k - _BACK), k)
        earlier = earlier[~zeros[earlier]]
        if zeros[k] or not earlier.size:
            continue
        apart = q[begin[k]] - q[end[earlier] - 1]
        apart = np.where(revolute, apart - _TURN * np.round(apart / _TURN), apart)
        time = t[begin[k]] - t[end[earlier] - 1]
        reach = _TIMES_LIMIT * speed * (time[:, None] + _JITTER * slowest) + _RESOLUTION
        value = best[earlier] - cost * (np.abs(apart) > reach).any(axis=1)
        chosen = int(np.argmax(value))
        if value[chosen] > 0:
            best[k] += value[chosen]
            before[k] = earlier[chosen]
    chain = []
    k = int(np.argmax(best))
    while k >= 0:
        chain.append(k)
        k = int(before[k])
    chain.reverse()
    bad = np.ones(n, dtype=bool)
    for k in chain:
        bad[begin[k] : end[k]] = False
    jumps = nothing.copy()
    for a, b in pairwise(chain):
        apart = q[begin[b]] - q[end[a] - 1]
        apart = np.where(revolute, apart - _TURN * np.round(apart / _TURN), apart)
        time = t[begin[b]] - t[end[a] - 1]
        if (np.abs(apart) > _TIMES_LIMIT * speed * (time + _JITTER * slowest) + _RESOLUTION).any():
            jumps[begin[b]] = True
    return bad, jumps


def spikes(x: FloatArray) -> Mask:
    """(N, n) values far outside all that a column holds, in one or two rows, beside usual ones.

    A contact lasts longer, and stays within ten times the range of what is usual.
    """
    found = np.zeros(x.shape, dtype=bool)
    few = x[:: max(1, x.shape[0] // 50_000)]
    low, middle, high = np.quantile(few, [0.01, 0.5, 0.99], axis=0)
    width = high - low
    bound = 10 * np.maximum(width, 0.1 * width.max(initial=0.0))
    deviation = np.maximum(x.max(axis=0) - middle, middle - x.min(axis=0))
    suspects = np.flatnonzero((deviation > bound) & (bound > 0))
    if suspects.size and x.shape[0] >= 7:
        from scipy.ndimage import median_filter

        for j in suspects:
            found[:, j] = np.abs(x[:, j] - median_filter(x[:, j], size=7, mode="nearest")) > bound[j]
    return found


def _jumps_somewhere(t: FloatArray, q: FloatArray, speed: FloatArray) -> bool:
    """Whether any step is longer than what every interval allows, column by column: most recordings have none."""
    least = _TIMES_LIMIT * speed * (_JITTER * float(np.median(np.diff(t)))) + _RESOLUTION
    return any(
        float(np.abs(np.diff(column)).max(initial=0.0)) > bound
        for column, bound in zip(q.T, least.tolist(), strict=True)
    )


def _way(t: FloatArray, speed: FloatArray) -> FloatArray:
    """(N - 1, n) way that joints may go from row to row."""
    steps = np.diff(t)
    way: FloatArray = _TIMES_LIMIT * speed * (steps[:, None] + _JITTER * float(np.median(steps))) + _RESOLUTION
    return way


def _gaps(t: FloatArray) -> Mask:
    steps = np.diff(t)
    return np.asarray((steps > _GAP_S) & (steps > _GAP_STEPS * np.median(steps)))
