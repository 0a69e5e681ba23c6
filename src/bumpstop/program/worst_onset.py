"""The time of a motion at which contact is hardest."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.trajectory.trajectory_curve import trajectory_kernel
from bumpstop.study.speed.trajectory.onset_shares import onset_shares

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionProblem

    Cycles = npt.NDArray[np.int64]

# Control cycles looked at along a motion, times in each at the least, and in all at the least.
_CYCLES, _PHASES, _TIMES = 173, 4, 173
# Control cycles on either side of a time at which contact is expected to be hard.
_ABOUT = 5
# So often the distance of these times is halved about the hardest.
_HALVINGS = 9


def worst_onset(
    problem: CollisionProblem, *, threads: int = 1, near: float | None = None, enough: float = math.inf
) -> tuple[float, float]:
    """Time of the trajectory at which contact is hardest [s], and how hard.

    That is the peak force that is exceeded with the accepted probability, over the allowed one; zero where the contact
    point never moves toward the body.

    Within a control cycle the force falls as contact comes nearer to the tick that detects it, and rises abruptly where
    that is the next tick, by a fifth in stiff contacts. Each cycle has a crest of its own, which is searched for.

    Args:
        problem: of a trajectory, against a body with limits.
        threads: that share the times.
        near: time that is looked about first [s].
        enough: where contact about that time is harder than this, no other time is looked at.
    """
    trajectory, accepted = problem.trajectory, problem.scenario.verdict.accepted_probability
    assert trajectory is not None
    kernel, period = trajectory_kernel(problem), problem.period_steps * problem.scenario.simulation.step_s
    last = np.nextafter(trajectory.duration, 0.0)

    def share(times: FloatArray) -> FloatArray:
        flat = np.clip(times.ravel(), 0.0, last)
        return onset_shares(problem, flat, kernel, threads=threads).exceeded_with(accepted).reshape(times.shape)

    count = max(1, math.ceil(trajectory.duration / period))
    if near is not None:
        about = min(int(near / period), count - 1)
        _, time, hardest = _crest(share, _spread(max(0, about - _ABOUT), min(count - 1, about + _ABOUT)), period)
        if hardest > enough:
            return float(np.clip(time, 0.0, last)), hardest
    cycles = _spread(0, count - 1)
    cycle, time, hardest = _crest(share, cycles, period)
    # Those that were left out between this one and its neighbours.
    place = int(np.searchsorted(cycles, cycle))
    between = _spread(int(cycles[max(0, place - 1)]), int(cycles[min(cycles.size - 1, place + 1)]))
    if between.size > 3:
        _, nearer, harder = _crest(share, between, period)
        if harder > hardest:
            time, hardest = nearer, harder
    return float(np.clip(time, 0.0, last)), hardest


def _spread(first: int, last: int) -> Cycles:
    """Numbers of cycles, all of some or many of more."""
    return np.unique(np.linspace(first, last, min(last - first + 1, _CYCLES)).round().astype(np.int64))


def _crest(share: Callable[[FloatArray], FloatArray], cycles: Cycles, period: float) -> tuple[int, float, float]:
    """The hardest of some control cycles, the time of its crest and how hard contact is there."""
    phases = max(_PHASES, math.ceil(_TIMES / cycles.size))
    width = period / phases
    times = cycles[:, None] * period + (np.arange(phases) + 0.5) * width
    shares = share(times)
    best = shares.argmax(axis=1)
    rows = np.arange(cycles.size)
    time, height = times[rows, best], shares[rows, best]
    if not np.isfinite(shares).all():
        # Nothing is harder than what has no bound.
        hardest = int(height.argmax())
        return int(cycles[hardest]), float(time[hardest]), float(height[hardest])
    # The force may rise abruptly between two of these times: to as much above as it is higher at one than at the other.
    kept = height + 9 / 8 * np.abs(np.diff(shares, axis=1)).max(axis=1) >= height.max()
    cycles, time, height = cycles[kept], time[kept], height[kept]
    for _ in range(_HALVINGS):
        width /= 2
        beside = share(np.stack([time - width, time + width], axis=1))
        if not np.isfinite(beside).all():
            side, hardest = beside.argmax(axis=1), int(beside.max(axis=1).argmax())
            found = float(time[hardest] + (width if side[hardest] else -width))
            return int(cycles[hardest]), found, float(beside[hardest].max())
        fall = height[:, None] - beside
        harder = fall.min(axis=1) < 0
        side = beside.argmax(axis=1)
        time = np.where(harder, time + np.where(side == 0, -width, width), time)
        height = np.maximum(height, beside.max(axis=1))
        # On a slope the crest is no higher than as much again, and on a bend by less.
        kept = height + np.abs(fall).min(axis=1) + np.abs(fall).max(axis=1) / 8 >= height.max()
        cycles, time, height = cycles[kept], time[kept], height[kept]
    hardest = int(height.argmax())
    return int(cycles[hardest]), float(time[hardest]), float(height[hardest])
