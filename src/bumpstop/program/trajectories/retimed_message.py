"""The points of a trajectory message, and the same points at other times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.program.trajectories.trajectory_segment import (
    MIN_TURN,
    TrajectorySegment,
    find_segments,
    joined,
)

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.program.cell import Cell
    from bumpstop.program.segment import Segment

BASE_MOVES = "a MultiDOFJointTrajectory moves what the arm stands on, and is not followed"
# Wide enough for any arm and any unit slip, narrow enough that no product of them overflows [s, rad or m, per second].
_MAX = {"time": 1e7, "position": 1e4, "velocity": 1e4, "acceleration": 1e6}
# What the arm may stand beside the first point: as far as MoveIt lets it [rad or m].
_BESIDE = 0.01
_RESTS = 1e-9  # [per s, per s2] nothing changes where a row is written at rest


@dataclass(frozen=True, eq=False)
class MessageRows:
    """Points of a message.

    Attributes:
        time: (points,) [s].
        position: (points, dof) in the robot's order of joints.
        velocity, acceleration: the same, or None.
        order: of the robot's joints in the message.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray | None
    acceleration: FloatArray | None
    order: tuple[int, ...]

    @classmethod
    def checked(
        cls,
        time: Sequence[float],
        position: Sequence[Sequence[float]],
        velocity: Sequence[Sequence[float]],
        acceleration: Sequence[Sequence[float]],
        column: Sequence[int],
        order: Sequence[int],
    ) -> MessageRows | str:
        """The points in the robot's order, or what is wrong with them.

        Args:
            time: of the points [s].
            position: of them, in the message's order.
            velocity: the same, or empty.
            acceleration: the same, or empty.
            column: of the message for every joint of the robot.
            order: of the robot's joints in the message.
        """
        t = np.array(time, dtype=np.float64)
        if len(t) < 2:
            return f"has {len(t)} points"
        if not (np.diff(t) > 0).all():
            return f"point {int(np.argmax(np.diff(t) <= 0)) + 2} is not after the one before it"
        for what, given in (("velocities", velocity), ("accelerations", acceleration)):
            if len(given) not in (0, len(t)):
                return f"{what} are given at some points only"
        q, qd, qdd = (
            np.array(given, dtype=np.float64)[:, list(column)] if given else None
            for given in (position, velocity, acceleration)
        )
        assert q is not None
        for what, values in (("time", t[:, None]), ("position", q), ("velocity", qd), ("acceleration", qdd)):
            if values is None:
                continue
            most = np.abs(values).max(axis=1)
            far = np.flatnonzero(most > _MAX[what])
            if far.size:
                return f"point {far[0] + 1} has a {what} of {most[far[0]]:.3g}, over {_MAX[what]:g}"
        return cls(t, q, qd, qdd, tuple(order))


def position_at(rows: MessageRows, t: float) -> FloatArray:
    """Joint positions (dof,) at a time [s] of a message, before its first point there."""
    through = joined(rows.time - rows.time[0], rows.position, rows.velocity, rows.acceleration)
    return np.asarray(through.at(np.clip([t - rows.time[0]], 0.0, through.duration))[0])


def begins_elsewhere(rows: MessageRows, stands: FloatArray | None) -> bool:
    """Whether the first point is one where the arm is said to be already, and is not.

    Args:
        rows: points of a message.
        stands: joint positions before it (dof,); None: not known.
    """
    return stands is not None and rows.time[0] <= 0 and float(np.abs(rows.position[0] - stands).max()) > _BESIDE


def elsewhere_notes(names: Sequence[str]) -> list[str]:
    """What is said of messages that begin elsewhere."""
    said = "the first point is at 0 s, and is not where the arm is then: the way there is not in the file, nor judged"
    return [f"{', '.join(names)}: {said}"] if names else []


def segments_of(
    name: str, rows: MessageRows, lines: Sequence[int], cell: Cell, stands: FloatArray | None
) -> list[TrajectorySegment]:
    """The segments of a message, numbered where there are several.

    Args:
        name: of the message.
        rows: its points.
        lines: of the file, of every point.
        cell: whose joint acceleration counts where the message shows none.
        stands: joint positions before it (dof,); None: not known.
    """
    # Without velocities a controller does not look at accelerations.
    bent = None if rows.velocity is None else rows.acceleration

    def at_rest(row: int) -> bool:
        return all(one is None or float(np.abs(one[row]).max()) < _RESTS for one in (rows.velocity, bent))

    bounds = find_segments(rows.time, rows.position, rows.velocity)
    # Where one begins right where the one before it ends, what is written of that row holds for both.
    meet = {first: object() for (_, last), (first, _) in pairwise(bounds) if first == last and not at_rest(first)}

    def segment(called: str, first: int, last: int, why: str = "") -> TrajectorySegment:
        return TrajectorySegment(
            called,
            lines[first : last + 1],
            (first, last),
            cell.robot,
            rows.time[first : last + 1],
            rows.position[first : last + 1],
            None if rows.velocity is None else rows.velocity[first : last + 1],
            cell.joint_acceleration,
            dense=False,
            why=why,
            acceleration=None if bent is None else bent[first : last + 1],
            shared=tuple(meet[row] for row in (first, last) if row in meet),
        )

    found = []
    # From rest a point that is passed at a rate is reached with a swing back of 4/27 of the rate's way.
    swing = 0.0 if rows.velocity is None else 4 / 27 * rows.time[0] * float(np.abs(rows.velocity[0]).max())
    if rows.time[0] > 0 and (stands is None or float(np.abs(rows.position[0] - stands).max()) + swing > MIN_TURN):
        # The controller goes to the first point in that time, from wherever the arm is.
        why = f"how the arm gets to its first point in {rows.time[0]:.3g} s is not in the message"
        found.append(segment(f"{name}, first point", 0, 0, why))
    for number, (first, last) in enumerate(bounds, start=1):
        found.append(segment(name if len(bounds) == 1 else f"{name}/{number}", first, last))
    return found


def retimed_rows(
    rows: MessageRows, segments: Sequence[TrajectorySegment], factors: Mapping[Segment, float]
) -> tuple[MessageRows, npt.NDArray[np.bool_]]:
    """The same points: segments at so many times their speed, rests as long as they were.

    Returns:
        The points, and which of them have other velocities and accelerations (points,).
    """
    changed = np.zeros(len(rows.time), dtype=bool)
    step = np.diff(rows.time)
    velocity = None if rows.velocity is None else rows.velocity.copy()
    acceleration = np.zeros_like(rows.position)
    for segment in segments:
        factor = factors.get(segment, 1.0)
        if factor == 1.0:
            continue
        first, last = segment.rows
        changed[first : last + 1] = True
        at, rate, acceleration[first : last + 1] = segment.rows_at(factor)
        step[first:last] = np.diff(at)
        if velocity is not None:
            velocity[first : last + 1] = rate
    time = rows.time[0] + np.append(0.0, np.cumsum(step))
    return MessageRows(time, rows.position, velocity, acceleration, rows.order), changed
