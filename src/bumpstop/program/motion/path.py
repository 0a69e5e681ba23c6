"""The path of moves that go over into each other: joint positions, and how fast the program goes along them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.program.motion.kinematics import tool_positions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.arrays import FloatArray
    from bumpstop.model import Robot
    from bumpstop.program.languages.statements import Measure

# Of the joints' speed limits: the controller keeps to them, and what lies between two samples within the rest.
SHARE = 0.98
_SHORT = 1e-9  # [s] a piece at full speed that is none
_CORNER = 12  # samples of a rounded corner


@dataclass(frozen=True, eq=False)
class Leg:
    """One move of a path.

    Attributes:
        q: (N, dof) joint positions along it, evenly spaced.
        tool: pose of the tool in the tip (4, 4).
        measure: what the speed is of.
        blend: distance from the tool to the end at which it goes over into the next move [m].
        acceleration: in the measure's unit per second; None: the joints'.
    """

    q: FloatArray
    tool: FloatArray
    measure: Measure
    blend: float = 0.0
    acceleration: float | None = None


@dataclass(frozen=True, eq=False)
class Path:
    """Samples of a path with its corners rounded.

    Attributes:
        q: (N, dof) joint positions.
        leg: number of the move of every piece between two samples (N - 1,).
        way: of every piece in the measure of its move (N - 1, 1), of ``"axes"`` one for each joint (N - 1, dof).
    """

    q: FloatArray
    leg: FloatArray
    way: tuple[FloatArray, ...]


def join(robot: Robot, legs: Sequence[Leg]) -> Path:
    """The path of moves, each of which begins where the one before it ends; corners are parabolas in the joints.

    The last one goes to its end, whatever its blend: nothing follows that it could go over into.
    """
    legs = [*legs[:-1], replace(legs[-1], blend=0.0)]
    cut = [_middle(robot, leg, before) for leg, before in zip(legs, [None, *legs], strict=False)]
    rows = [cut[0][0][:1]]
    number: list[int] = []
    for i, (q, corner) in enumerate(cut):
        if i:
            rounded = _parabola(rows[-1][-1], corner, q[0])
            rows.append(rounded[1:])
            half = len(rounded) // 2
            number += [i - 1] * half + [i] * (len(rounded) - 1 - half)
        rows.append(q[1:])
        number += [i] * (len(q) - 1)
    every = np.concatenate(rows)
    leg = np.array(number)
    return Path(every, leg, tuple(_way(robot, legs[i], every) for i in range(len(legs))))


def _middle(robot: Robot, leg: Leg, before: Leg | None) -> tuple[FloatArray, FloatArray]:
    """What is left of a move between its corners, and the corner at its begin."""
    x = tool_positions(robot, leg.q, leg.tool)
    half = len(leg.q) // 2
    first, last = 0, len(leg.q) - 1
    if before is not None and before.blend > 0:
        near = np.linalg.norm(x - x[0], axis=1) < before.blend
        first = min(int(np.argmin(near)) if not near.all() else half, half)
    if leg.blend > 0:
        near = np.linalg.norm(x - x[-1], axis=1) < leg.blend
        beyond = int(np.argmin(near[::-1])) if not near.all() else half
        last = max(last - min(beyond, half), first + 1)
    return leg.q[first : last + 1], leg.q[0]


def _parabola(begin: FloatArray, corner: FloatArray, end: FloatArray) -> FloatArray:
    s = np.linspace(0, 1, _CORNER + 1)[:, None]
    return np.asarray((1 - s) ** 2 * begin + 2 * s * (1 - s) * corner + s**2 * end)


def _way(robot: Robot, leg: Leg, q: FloatArray) -> FloatArray:
    """Of all pieces in the measure of one move."""
    turn = np.abs(np.diff(q, axis=0))
    if leg.measure == "tool":
        return np.asarray(np.linalg.norm(np.diff(tool_positions(robot, q, leg.tool), axis=0), axis=1)[:, None])
    if leg.measure == "joint":
        return np.asarray(turn.max(axis=1)[:, None])
    return np.asarray(turn / robot.velocity)


def full_speed_times(robot: Robot, path: Path, speeds: Sequence[FloatArray]) -> FloatArray:
    """Time that every piece takes at the full speed of its move (N - 1,) [s]; joints keep to their limits.

    Args:
        robot: whose limits are kept.
        path: of the moves.
        speeds: of every move in its measure: (1,), of ``"axes"`` shares of the limits (dof,).
    """
    least = (np.abs(np.diff(path.q, axis=0)) / (SHARE * robot.velocity)).max(axis=1)
    asked = np.zeros(len(least))
    for i, speed in enumerate(speeds):
        own = path.leg == i
        asked[own] = (path.way[i][own] / speed).max(axis=1)
    return np.asarray(np.maximum(asked, least))


def without_repeats(path: Path, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Joint positions and the times at full speed between them, without pieces that take none."""
    keep = np.append(True, times > _SHORT)
    return path.q[keep], times[times > _SHORT]
