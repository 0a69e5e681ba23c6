"""Moments between waypoints: far apart these say too little about what the arm does on the way."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.collision.trajectory.trajectory import Trajectory

# No joint turns more from one moment to the next [rad or m]: what is safe changes little on the way. Short trajectories
# are looked at more closely: so many moments cost little.
_TURN, _MIN_TURN = 0.02, 0.002
_MOMENTS = 600
# Looked at between two moments. Where the arm is nearer to its limit there than at both by more than this share, and
# not far below it anyway, as many moments are added.
_LOOKS = 8
_NEARER, _FAR_BELOW = 0.02, 0.25
_AT_ONCE = 16_384


def refine_by_joint_motion(trajectory: Trajectory) -> Trajectory:
    """The same trajectory with rows between its own where a joint turns far from one to the next.

    All that these functions return has the same cubics, with velocities, and every row of what is given bit for bit;
    it is what is given where nothing is added.
    """
    turns = np.abs(trajectory.extremes(1)[1]).max(axis=(1, 2)) * np.diff(trajectory.time)
    parts = np.ceil(turns / np.clip(turns.sum() / _MOMENTS, _MIN_TURN, _TURN))
    return _cut(trajectory, np.maximum(1, parts).astype(np.int64))


def refine_at_peaks(trajectory: Trajectory, nearness: Callable[[FloatArray], FloatArray]) -> Trajectory:
    """The same trajectory with more rows where the arm comes nearest to its limit between two of them.

    Args:
        trajectory: as given.
        nearness: of times (N,) [s], about the speed over its limit (N,).
    """
    begin, step = trajectory.time[:-1, None], np.diff(trajectory.time)[:, None]
    times = np.append((begin + step * np.arange(_LOOKS) / _LOOKS).ravel(), trajectory.time[-1])
    near = np.concatenate([nearness(some) for some in np.array_split(times, math.ceil(times.size / _AT_ONCE))])
    inside, ends = near[:-1].reshape(-1, _LOOKS)[:, 1:].max(axis=1), near[::_LOOKS]
    cut = inside > np.maximum((1 + _NEARER) * np.maximum(ends[:-1], ends[1:]), _FAR_BELOW)
    return _cut(trajectory, np.where(cut, _LOOKS, 1))


def _cut(trajectory: Trajectory, parts: npt.NDArray[np.int64]) -> Trajectory:
    """With every piece between two rows in so many parts (rows - 1,)."""
    if (parts == 1).all():
        return trajectory
    piece = np.repeat(np.arange(len(parts)), parts)
    first = np.concatenate([[0], np.cumsum(parts)])
    share = (np.arange(first[-1]) - first[piece]) / parts[piece]
    time = np.append(trajectory.time[piece] + share * np.diff(trajectory.time)[piece], trajectory.time[-1])
    position, velocity = trajectory.at(time), trajectory.at(time, 1)
    position[first] = trajectory.position
    if trajectory.velocity is not None:
        velocity[first] = trajectory.velocity
    return Trajectory(time, position, velocity)
