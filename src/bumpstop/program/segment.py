"""Segments: what of a program has one speed and one verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from bumpstop.program.motion.path import SHARE, Path, full_speed_times, join, without_repeats
from bumpstop.program.motion.timing import RAMP_S, motion_along, timed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.arrays import FloatArray
    from bumpstop.collision.trajectory.piecewise_cubic import PiecewiseCubic
    from bumpstop.collision.trajectory.trajectory import Trajectory
    from bumpstop.model import Robot
    from bumpstop.program.languages.statements import SpeedSlot
    from bumpstop.program.motion.timing import PathMotion
    from bumpstop.program.visit import Visit


_TIMES = 1000  # at which the speed along a path is looked at


class Segment(Protocol):
    """A motion from rest to rest whose speed is one number times that of the program."""

    @property
    def name(self) -> str:
        """As people call it."""
        ...

    @property
    def lines(self) -> tuple[int, int]:
        """Of the file, first and last; of a recording, rows."""
        ...

    @property
    def why(self) -> str:
        """It cannot be judged; else empty."""
        ...

    @property
    def speed_known(self) -> bool:
        """The program says how fast it is."""
        ...

    def at(self, factor: float) -> Trajectory:
        """The motion at so many times the program's speed; 1: as the program has it."""
        ...

    def max_factor(self, max_speed: float) -> float:
        """Beyond it nothing gets faster, or the tool faster than ``max_speed`` [m/s]; 1 at least."""
        ...

    def bends(self, factor: float) -> FloatArray:
        """Greatest joint accelerations that a factor changes (dof,) [rad/s2 or m/s2]: those of the path's bends.

        Of a move whose time is given, and of a trajectory, those of its ramps, too, or more.
        """
        ...

    def places(self) -> Sequence[object]:
        """What its speed is written in; segments that share a place have one factor."""
        ...

    def joins(self) -> Sequence[object]:
        """Where it goes over into other segments, and does not rest: timed anew, each of them rests there."""
        ...

    def line_at(self, t: float, motion: Trajectory) -> int:
        """Line of what moves at a time of a motion [s]."""
        ...


@dataclass(frozen=True, eq=False)
class MoveSegment:
    """Moves of a program that go over into each other.

    Attributes:
        visits: the moves, each with its path.
        robot: the arm.
        joint_acceleration: where the program says none (dof,).
        unknown_speed: what is tried first where the program does not say how fast the tool goes [m/s].
    """

    visits: tuple[Visit, ...]
    robot: Robot
    joint_acceleration: FloatArray
    unknown_speed: float

    @property
    def name(self) -> str:  # noqa: D102
        first, last = self.visits[0].move, self.visits[-1].move
        return first.word if len(self.visits) == 1 else f"{first.word} .. {last.word}"

    @property
    def lines(self) -> tuple[int, int]:  # noqa: D102
        every = [visit.move.line for visit in self.visits]
        return min(every), max(every)

    @property
    def why(self) -> str:  # noqa: D102
        for visit in self.visits:
            if visit.why:
                return f"line {visit.move.line}: {visit.why}"
        if not any(visit.slots for visit in self.visits):
            return f"line {self.lines[0]}: its speed is set outside the program"
        if len(self.visits) > 1 and any(slot.time for visit in self.visits for slot in visit.slots):
            return f"line {self.lines[0]}: a time is given where moves are blended"
        return ""

    @property
    def still(self) -> bool:
        """Nothing moves."""
        return all(visit.still for visit in self.visits)

    @property
    def speed_known(self) -> bool:  # noqa: D102
        return all(slot.value is not None for visit in self.visits for slot in visit.slots)

    def places(self) -> Sequence[SpeedSlot]:  # noqa: D102
        return tuple(dict.fromkeys(slot for visit in self.visits if not visit.still for slot in visit.slots))

    def joins(self) -> Sequence[object]:  # noqa: D102
        return ()

    def may_obey(self, slot: SpeedSlot) -> bool:
        """Whether a setting may hold for one of its moves that does not say which setting holds for it."""
        return slot.setting and any(
            (not visit.slots or slot.value is visit.slots[0].value is None)
            and visit.move.default is not None
            and visit.move.default.unit == slot.unit
            for visit in self.visits
            if not visit.still
        )

    def base_value(self, slot: SpeedSlot) -> float:
        """What a factor is of: the program's value, or the highest that is tried where it has none."""
        if slot.value is not None:
            return slot.value
        return slot.most if slot.unit == "%" else self.unknown_speed / slot.factor

    def new_value(self, slot: SpeedSlot, factor: float) -> float:
        """What is written for a factor."""
        base = self.base_value(slot)
        return base if factor == 1 and slot.value is not None else float(slot.rounded(slot.scaled(base, factor)))

    @cached_property
    def _moving(self) -> tuple[Visit, ...]:
        return tuple(visit for visit in self.visits if visit.leg is not None)

    @cached_property
    def _path(self) -> Path:
        return join(self.robot, [visit.leg for visit in self._moving if visit.leg is not None])

    def _speeds(self, factor: float) -> list[FloatArray]:
        return [
            np.array([self._speed(i, slot, factor) for slot in visit.slots]) for i, visit in enumerate(self._moving)
        ]

    def _speed(self, number: int, slot: SpeedSlot, factor: float) -> float:
        """Full speed of a move; where its time is given the most that it allows, twice the mean."""
        value = self.new_value(slot, factor)
        return 2 * float(self._path.way[number].sum()) / value if slot.time else value * slot.factor

    @cached_property
    def _reach(self) -> Sequence[float]:
        """No move gets faster from rest to rest, in its measure: joints that would be at their limits are not yet."""
        legs = [visit.leg for visit in self._moving if visit.leg is not None]
        known = [leg.acceleration for leg in legs if leg.measure == "tool" and leg.acceleration is not None]
        if len(known) < len(legs) or any(slot.time for slot in self.places()):
            return [math.inf] * len(legs)
        return [math.sqrt(max(known) * float(way.sum())) for way in self._path.way]

    def at(self, factor: float) -> Trajectory:  # noqa: D102
        return timed(*self._motion(factor), self.robot.velocity)

    def _motion(self, factor: float) -> tuple[PiecewiseCubic, PathMotion]:
        speeds = [np.minimum(*both) for both in zip(self._speeds(factor), self._reach, strict=True)]
        q, times = without_repeats(self._path, full_speed_times(self.robot, self._path, speeds))
        return motion_along(q, times, self.robot.velocity, self._ramp(speeds), self.joint_acceleration)

    def _ramp(self, speeds: Sequence[FloatArray]) -> float | None:
        """Greatest acceleration as a share of full speed [1/s]; None where the program does not say all of them."""
        path, ramps = self._path, []
        every = full_speed_times(self.robot, path, speeds)
        for i, visit in enumerate(self._moving):
            own = (path.leg == i) & (every > 0)
            if visit.slots[0].time:
                # At full speed it would take half of its time. A ramp and what rounds it off are the other half.
                return 1 / (float((path.way[i].max(axis=1) / speeds[i]).sum()) - RAMP_S)
            if visit.leg is None or visit.leg.acceleration is None or not own.any():
                return None
            # Where joints are at their limits, less than the program asks for is full speed.
            full = float((path.way[i][own].max(axis=1) / every[own]).max())
            ramps.append(visit.leg.acceleration / max(full, 1e-9))
        return max(ramps)

    def max_factor(self, max_speed: float) -> float:  # noqa: D102
        from bumpstop.program.motion.kinematics import tool_positions

        path, speeds = self._path, self._speeds(1.0)
        with np.errstate(divide="ignore"):
            asked = np.zeros(len(path.leg))
            for i, speed in enumerate(speeds):
                asked[path.leg == i] = (path.way[i][path.leg == i] / speed).max(axis=1)
            least = (np.abs(np.diff(path.q, axis=0)) / (SHARE * self.robot.velocity)).max(axis=1)
            way = np.linalg.norm(np.diff(tool_positions(self.robot, path.q, np.eye(4)), axis=0), axis=1)
        moving = least > 1e-12
        joints = float((asked[moving] / least[moving]).max())
        tool = float(max_speed / max((way[moving] / np.maximum(asked[moving], least[moving])).max(), 1e-12))
        written = min(slot.headroom(self.base_value(slot)) for slot in self.places())
        most = max(1.0, min(joints, tool, written))
        # A speed that a short way does not let the arm reach is not written: its ramps may be other ones.
        reached = min(reach / float(speed.max()) for speed, reach in zip(self._speeds(most), self._reach, strict=True))
        return max(1.0, most * self._motion(most)[1].top * min(1.0, reached))

    def bends(self, factor: float) -> FloatArray:  # noqa: D102
        path, motion = self._motion(factor)
        u, speed, change = motion.at(np.linspace(0, motion.duration, _TIMES))
        # Between samples of the path its second derivative is a straight line.
        found = np.abs(path(path.x, 2)) * np.interp(path.x, u, speed)[:, None] ** 2
        if any(slot.time for slot in self.places()):
            # In less time the arm also speeds up more.
            found += np.abs(path(path.x, 1)) * np.abs(change).max()
        return np.asarray(found.max(axis=0))

    def line_at(self, t: float, motion: Trajectory) -> int:  # noqa: D102
        q = motion.at(min(max(t, 0.0), motion.duration))
        nearest = int(np.abs(self._path.q - q).max(axis=1).argmin())
        leg = int(self._path.leg[min(nearest, len(self._path.leg) - 1)])
        return self._moving[leg].move.line
