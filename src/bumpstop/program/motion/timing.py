"""Motions along a path, from rest to rest, with limited jerk."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.collision.trajectory.piecewise_cubic import PiecewiseCubic
from bumpstop.collision.trajectory.trajectory import Trajectory
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray

# An acceleration is built up in so much time [s]: the ramp of an industrial controller.
RAMP_S = 0.05
# Rows of a trajectory: so far apart at most [s], and so many at least; how often that is halved at most.
_ROW_S, _MIN_ROWS, _HALVINGS = 0.02, 40, 5
# Share of the joints' speed limits that the spline keeps to, and how often pieces are slowed down for it at most.
_KEPT, _EASINGS = 0.995, 8
MAX_DURATION_S = 120.0  # of a motion [s]
# Ruckig finds no profile where acceleration and speed are reached at one moment and left at once: a little more is.
_MORE = 1 + 1e-9


class PathMotion:
    """From rest at the begin of a path to rest at its end: its coordinate u over time, by ruckig.

    The coordinate u is the time that the path takes at full speed, so that du/dt is 1 at full speed.

    Attributes:
        duration: [s].
    """

    def __init__(self, length: float, acceleration: float) -> None:
        """Compute it.

        Args:
            length: of u [s].
            acceleration: greatest of u [1/s]; its jerk is that over ``RAMP_S``.

        Raises:
            InputError: ruckig is not installed.
        """
        ruckig = import_ruckig()
        wanted = ruckig.InputParameter(1)
        wanted.current_position, wanted.target_position = [0.0], [length]
        acceleration *= _MORE
        wanted.max_velocity, wanted.max_acceleration = [1.0], [acceleration]
        wanted.max_jerk = [acceleration / RAMP_S]
        self._profile = ruckig.Trajectory(1)
        if ruckig.Ruckig(1).calculate(wanted, self._profile) not in (ruckig.Result.Working, ruckig.Result.Finished):
            raise InputError("program", f"no motion of {length:g} s is found", "give a shorter move")
        self.duration = float(self._profile.duration)
        self._length = length

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Coordinate u [s], its speed and its acceleration at times (N,)."""
        rows = np.array([[part[0] for part in self._profile.at_time(float(x))] for x in t])
        return np.clip(rows[:, 0], 0.0, self._length), rows[:, 1], rows[:, 2]

    @property
    def top(self) -> float:
        """Greatest share of full speed: below 1 on a way too short for it."""
        return float(self.at(np.array([0.5 * self.duration]))[1][0])

    def times(self, u: FloatArray) -> FloatArray:
        """When the coordinate passes values (N,), ascending from 0 to its end [s]."""
        low, high = np.zeros(len(u)), np.full(len(u), self.duration)
        for _ in range(60):
            middle = 0.5 * (low + high)
            before = self.at(middle)[0] < u
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        found = 0.5 * (low + high)
        found[0], found[-1] = 0.0, self.duration
        return np.asarray(found, dtype=np.float64)


def import_ruckig() -> Any:
    """The module ruckig.

    Raises:
        InputError: it is not installed.
    """
    try:
        import ruckig
    except ImportError:
        raise InputError("program", "ruckig is not installed", "pip install 'bumpstop[program]'") from None
    return ruckig


def motion_along(
    q: FloatArray, times: FloatArray, velocity: FloatArray, acceleration: float | None, joint_acceleration: FloatArray
) -> tuple[PiecewiseCubic, PathMotion]:
    """The path through samples, and the motion along it.

    Args:
        q: (N, dof) joint positions.
        times: that pieces take at full speed (N - 1,) [s], all above zero; where the spline through the samples would
            have a joint faster than its limit, as in corners, they take longer.
        velocity: limits (dof,) [rad/s or m/s].
        acceleration: of the share of full speed [1/s]; None: as much as the joints' allow.
        joint_acceleration: (dof,) [rad/s2 or m/s2].

    Raises:
        InputError: it takes too long.
    """
    for _ in range(_EASINGS):
        u = np.append(0.0, np.cumsum(times))
        path = PiecewiseCubic.spline(u, q)
        inside = (u[:-1, None] + times[:, None] * np.linspace(0, 1, 5)).ravel()
        over = (np.abs(path(inside, 1)) / velocity).max(axis=1).reshape(-1, 5).max(axis=1) / _KEPT
        if over.max() <= 1:
            break
        times = times * np.maximum(over, 1.0)
    rate = path(np.concatenate([u, 0.5 * (u[1:] + u[:-1])]), 1)
    if acceleration is None:
        with np.errstate(divide="ignore"):
            acceleration = float((joint_acceleration / np.abs(rate).max(axis=0)).min())
    motion = PathMotion(float(u[-1]), acceleration)
    if motion.duration > MAX_DURATION_S:
        raise InputError("program", f"a motion of {motion.duration:.0f} s", f"wanted at most {MAX_DURATION_S:g} s")
    return path, motion


def timed(path: PiecewiseCubic, motion: PathMotion, limit: FloatArray) -> Trajectory:
    """The trajectory of a motion along a path; in corners at the joints' speed limits (dof,) its rows are closer."""
    rows = max(_MIN_ROWS, math.ceil(motion.duration / _ROW_S))
    for halvings in range(_HALVINGS + 1):
        t = np.linspace(0, motion.duration, 2**halvings * rows + 1)
        along, speed, _ = motion.at(t)
        position, velocity = path(along), path(along, 1) * speed[:, None]
        position[0], position[-1] = path(path.x[:1])[0], path(path.x[-1:])[0]
        velocity[0] = velocity[-1] = 0.0
        found = Trajectory(t, position, velocity)
        if (np.abs(found.extremes(1)[1]) <= limit).all():
            break
    return found
