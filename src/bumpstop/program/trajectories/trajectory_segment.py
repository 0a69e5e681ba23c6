"""Segments: the parts of a trajectory between places where the arm rests or turns round."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.trajectory.piecewise_cubic import resting_slopes
from bumpstop.collision.trajectory.trajectory import Trajectory, point_motion
from bumpstop.errors import InputError
from bumpstop.program.motion.path import SHARE
from bumpstop.program.motion.timing import PathMotion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.arrays import FloatArray
    from bumpstop.model import Robot

# Joints rest below this speed [rad/s].
_STANDS = 1e-3
# Of the noise of rows: so many times that between two of them is a speed, and so much is a turn.
_NOISE_SPEED, _NOISE_TURN = 2.0, 6.0
# Between two peaks of the speed the arm turns round where it is slower than this share of the lower one.
_TURNS = 0.1
# Where no joint turns more nothing moves: a hundredth of a millimetre at an arm's length [rad].
MIN_TURN = 1e-5
_SAMPLES = 1500  # of a segment
_FULL = 0.7  # of the greatest speed: from the first peak that reaches it to the last the arm goes at its own speed
_MAX_RAMP = 95.0  # percentile of the acceleration along the path
# An arm that only gets going takes no more times as long as at its greatest acceleration, of a cubic it is 2, and gets
# slower by no more than this share of its speed on the way.
_GETS_GOING, _FALLS = 2.5, 0.05
_DIFFERENCE_S = 1e-4
# A quintic is told by cubics of so much time [s], so many at least and at most.
_PIECE_S, _PIECES = 0.01, (2, 64)


def find_segments(
    time: FloatArray, position: FloatArray, velocity: FloatArray | None, *, noise: float = 0.0
) -> list[tuple[int, int]]:
    """First and last rows of the segments of a trajectory, in order; between them nothing moves.

    Args:
        time: (rows,) [s].
        position: (rows, dof).
        velocity: (rows, dof), or None: of the spline through the rows.
        noise: standard deviation of the rows [rad], which is no motion.
    """
    rate = Trajectory(time - time[0], position).at(time - time[0], 1) if velocity is None else velocity
    speed = np.linalg.norm(rate, axis=1)
    rests = max(_STANDS, _NOISE_SPEED * noise / float(np.diff(time).min()))
    turn = max(MIN_TURN, _NOISE_TURN * noise)
    inside = speed > rests
    joined = inside[:-1] | inside[1:]
    # Between two rows at rest the joints may still move: two rows apart are a motion.
    joined |= np.abs(np.diff(position, axis=0)).max(axis=1) > turn
    edges = np.flatnonzero(np.diff(np.concatenate([[False], joined, [False]]).astype(np.int8))).reshape(-1, 2)
    found: list[tuple[int, int]] = []
    for first, last in edges:
        for begin, end in _split_at_turns(speed, int(first), int(last)):
            if np.abs(position[begin : end + 1] - position[begin]).max() > turn:
                found.append((begin, end))
    # What creeps too slowly for any row to show it is a motion, too.
    bounds = [0, *(row for rows in found for row in rows), len(time) - 1]
    for begin, end in zip(bounds[::2], bounds[1::2], strict=True):
        if np.abs(position[begin : end + 1] - position[begin]).max() > turn:
            found.append((begin, end))
    return sorted(found)


def _split_at_turns(speed: FloatArray, first: int, last: int) -> list[tuple[int, int]]:
    """A moving part cut where the speed falls to next to nothing between two peaks."""
    cuts: list[int] = []
    for i in range(first + 1, last):
        if speed[i] <= speed[i - 1] and speed[i] <= speed[i + 1]:
            begin = cuts[-1] if cuts else first
            if speed[i] < _TURNS * min(speed[begin:i].max(), speed[i + 1 : last + 1].max()):
                cuts.append(i)
    bounds = [first, *cuts, last]
    return list(pairwise(bounds))


def joined(
    time: FloatArray, position: FloatArray, velocity: FloatArray | None, acceleration: FloatArray | None
) -> Trajectory:
    """The trajectory through rows; with accelerations by the quintics between them, in cubics of a short time.

    Without velocities it rests at both ends: a controller goes to the last point, and stays there.
    """
    if len(time) < 2:
        return Trajectory(time, position, velocity)
    if velocity is None:
        return Trajectory(time, position, resting_slopes(time, position))
    if acceleration is None:
        return Trajectory(time, position, velocity)
    step = np.diff(time)
    count = np.clip(np.ceil(step / _PIECE_S), *_PIECES).astype(int)
    row = np.repeat(np.arange(len(step)), count)
    share = (np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)) / count[row]
    h, s = step[row, None], share[:, None]
    # In the share of the step, less what is at its begin and at its end.
    way, rate = (position[1:] - position[:-1])[row], h * velocity[row]
    bend = 0.5 * h**2 * acceleration[row]
    a = way - rate - bend
    b = h * velocity[row + 1] - rate - 2 * bend
    c = h**2 * acceleration[row + 1] - 2 * bend
    c3, c4, c5 = 10 * a - 4 * b + 0.5 * c, -15 * a + 7 * b - c, 6 * a - 3 * b + 0.5 * c
    q = position[row] + s * (rate + s * (bend + s * (c3 + s * (c4 + s * c5))))
    qd = (rate + s * (2 * bend + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h
    return Trajectory(
        np.append(time[row] + share * step[row], time[-1]),
        np.vstack([q, position[-1:]]),
        np.vstack([qd, velocity[-1:]]),
    )


def _gets_going(t: FloatArray, speed: FloatArray) -> bool:
    """Whether an arm only gets going up to the last of some times [s]; what is slow for longer is so on purpose."""
    most = 0.0 if len(t) < 2 else float(np.abs(np.gradient(speed, t)).max())
    falls = float((np.maximum.accumulate(speed) - speed).max())
    return bool((t[-1] - t[0]) * most <= _GETS_GOING * speed[-1] and falls <= _FALLS * speed[-1])


@dataclass(frozen=True, eq=False)
class TrajectorySegment:
    """A segment of a trajectory as a segment.

    At its own speed it is what the file has. At another it is timed anew: the same path, at so many times the speed
    that the file has there, from rest to rest with the acceleration that the file has and limited jerk.

    Attributes:
        name: as people call it.
        row_lines: the line of the file, or its row, of every row from the first to the last, from 1.
        rows: first and last row, from 0.
        robot: the arm.
        time, position, velocity: of the rows from the first to the last.
        joint_acceleration: where the file shows none (dof,).
        dense: rows are added where it is timed anew; else it keeps its own.
        why: it cannot be judged; else empty.
        acceleration: of the rows, as velocity. Where both are known a controller joins them by quintics.
        shared: rows at which it goes over into another segment, and does not rest.
    """

    name: str
    row_lines: Sequence[int]
    rows: tuple[int, int]
    robot: Robot
    time: FloatArray
    position: FloatArray
    velocity: FloatArray | None
    joint_acceleration: FloatArray
    dense: bool
    why: str = ""
    acceleration: FloatArray | None = None
    shared: tuple[object, ...] = ()

    @property
    def lines(self) -> tuple[int, int]:  # noqa: D102
        return int(self.row_lines[0]), int(self.row_lines[-1])

    @property
    def speed_known(self) -> bool:  # noqa: D102
        return True

    def places(self) -> Sequence[object]:  # noqa: D102
        return ()

    def joins(self) -> Sequence[object]:  # noqa: D102
        return self.shared

    @cached_property
    def given(self) -> Trajectory:
        """As the file has it."""
        time = self.time - self.time[0]
        if self.dense:
            return Trajectory(time, self.position, self.velocity)
        return joined(time, self.position, self.velocity, self.acceleration)

    @cached_property
    def _grid(self) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """Times of the file (N,), the coordinate of full speed at them (N,), full speed (N,), and the ramp [1/s]."""
        t = np.unique(np.concatenate([np.linspace(0, self.given.duration, _SAMPLES), self.given.time]))
        rate = self.given.at(t, 1)
        speed = np.linalg.norm(rate, axis=1)
        way = np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t)))
        full = np.flatnonzero(speed >= _FULL * speed.max())
        first, last = int(full[0]), int(full[-1])
        # Up to the first peak and from the last one on the arm only gets going, and stops.
        while first < last and speed[first + 1] > speed[first]:
            first += 1
        while last > first and speed[last - 1] > speed[last]:
            last -= 1
        envelope = speed.copy()
        if _gets_going(t[: first + 1], speed[: first + 1]):
            envelope[:first] = speed[first]
        if _gets_going(t[-1] - t[last:][::-1], speed[last:][::-1]):
            envelope[last + 1 :] = speed[last]
        envelope = np.maximum(envelope, 1e-3 * speed.max())
        u = np.append(0.0, np.cumsum(np.diff(way) * 0.5 * (1 / envelope[1:] + 1 / envelope[:-1])))
        with np.errstate(divide="ignore", invalid="ignore"):
            ramp = float(np.percentile(np.abs(np.gradient(speed, t)), _MAX_RAMP)) / float(speed.max())
            direction = np.abs(rate) / np.maximum(speed, 1e-12)[:, None]
            joints = float((self.joint_acceleration / (direction * envelope[:, None]).max(axis=0)).min())
        ramp = ramp if ramp * self.given.duration > 1 else joints
        # A coordinate that stands still has no inverse.
        return t, u + 1e-12 * np.arange(len(u)), envelope, min(ramp, joints)

    def _motion(self, factor: float) -> PathMotion:
        _, u, _, ramp = self._grid
        return PathMotion(float(u[-1]) / factor, ramp / factor)

    def at(self, factor: float) -> Trajectory:  # noqa: D102
        if factor == 1.0:
            return self.given
        motion = self._motion(factor)
        if self.dense:
            rows = max(40, int(np.ceil(motion.duration / 0.02))) + 1
            t = np.linspace(0, motion.duration, rows)
            position = self.given.at(self._file_time(motion, t, factor))
            position[0], position[-1] = self.position[0], self.position[-1]
            return Trajectory(t, position, self._rates(motion, t, factor))
        t, rate, change = self.rows_at(factor)
        given = self.velocity is not None
        return joined(t, self.position, rate if given else None, None if self.acceleration is None else change)

    def rows_at(self, factor: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The file's rows in the motion at another factor: times (rows,), joint rates and accelerations (rows, dof)."""
        motion, (grid, u, _, _) = self._motion(factor), self._grid
        t = motion.times(np.interp(self.time - self.time[0], grid, u) / factor)
        if (np.diff(t) <= 0).any():
            raise InputError("program", "rows of the file lie too close to each other", "leave some out")
        before, after = np.maximum(t - _DIFFERENCE_S, 0.0), np.minimum(t + _DIFFERENCE_S, motion.duration)
        change = self._rates_between(motion, after, factor) - self._rates_between(motion, before, factor)
        return t, self._rates(motion, t, factor), np.asarray(change / (after - before)[:, None])

    def _file_time(self, motion: PathMotion, t: FloatArray, factor: float) -> FloatArray:
        grid, u, _, _ = self._grid
        return np.interp(motion.at(t)[0] * factor, u, grid)

    def _rates(self, motion: PathMotion, t: FloatArray, factor: float) -> FloatArray:
        """Joint rates at times of a motion (N, dof)."""
        grid, _, envelope, _ = self._grid
        at = self._file_time(motion, t, factor)
        rate = self.given.at(at, 1)
        own = np.linalg.norm(rate, axis=1)
        speed = factor * np.interp(at, grid, envelope) * motion.at(t)[1]
        speed[0] = speed[-1] = 0.0
        return np.where(own[:, None] > 1e-9, rate / np.maximum(own, 1e-9)[:, None], 0.0) * speed[:, None]

    def _rates_between(self, motion: PathMotion, t: FloatArray, factor: float) -> FloatArray:
        ends = np.concatenate([[0.0], t, [motion.duration]])
        return self._rates(motion, ends, factor)[1:-1]

    def max_factor(self, max_speed: float) -> float:  # noqa: D102
        grid, _, envelope, _ = self._grid
        rate = self.given.at(grid, 1)
        own = np.linalg.norm(rate, axis=1)
        moving = own > 0.05 * own.max()
        share = (envelope / np.maximum(own, 1e-12))[moving]
        with np.errstate(divide="ignore"):
            joints = float((SHARE * self.robot.velocity / (np.abs(rate[moving]) * share[:, None]).max(axis=0)).min())
        velocity, _ = point_motion(self.given, self.robot, self.robot.frame(None), grid)
        tool = float((np.linalg.norm(velocity, axis=1)[moving] * share).max())
        most = max(1.0, min(joints, max_speed / max(tool, 1e-9)))
        return max(1.0, most * self._motion(most).top)

    def bends(self, factor: float) -> FloatArray:  # noqa: D102
        motion = self.at(factor)
        return np.asarray(np.abs(motion.at(np.linspace(0, motion.duration, _SAMPLES), 2)).max(axis=0))

    def line_at(self, t: float, motion: Trajectory) -> int:  # noqa: D102
        q = motion.at(min(max(t, 0.0), motion.duration))
        return int(self.row_lines[int(np.abs(self.position - q).max(axis=1).argmin())])
