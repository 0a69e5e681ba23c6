"""What a joint state says of the joints that are asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bumpstop.live.sample import JointSample

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray

Effort = Literal["current", "torque"]
_MAX_NANOSECONDS = 1_000_000_000
_MAX_NAMED = 3


class ForeignStateError(Exception):
    """A joint state that has not got the joints asked for; the text says which."""


class DamagedStateError(Exception):
    """A joint state that contradicts itself; the text says how."""


class JointStateReader:
    """Picks joints out of joint states, whatever their order there.

    Args:
        joints: names, in the order of the robot.
        effort: what the field of this name carries: motor currents or joint torques.
    """

    def __init__(self, joints: Sequence[str], effort: Effort) -> None:
        self._joints, self._effort = tuple(joints), effort
        # Of the last state with all joints; before one has come even an empty list is another.
        self._names: list[str] | None = None
        self._rows: list[int] = []

    def sample(self, message: Any, received_s: float) -> JointSample:
        """The joints of a ``sensor_msgs/msg/JointState``.

        Args:
            message: as it came.
            received_s: ``time.monotonic()`` when it came [s].

        Raises:
            ForeignStateError: joints are missing.
            DamagedStateError: a name twice, a list of another length, no positions or efforts, or a time that is none.
        """
        if message.name != self._names:
            self._rows = self._rows_of(message.name)
            self._names = list(message.name)
        stamp = message.header.stamp
        if stamp.nanosec >= _MAX_NANOSECONDS:
            raise DamagedStateError(f"its time has {stamp.nanosec} nanoseconds")
        count = len(message.name)
        effort = self._picked(message.effort, "effort", count)
        return JointSample(
            stamp_s=stamp.sec + stamp.nanosec / _MAX_NANOSECONDS,
            received_s=received_s,
            position_rad=self._picked(message.position, "position", count),
            velocity_rad_s=self._picked(message.velocity, "velocity", count) if len(message.velocity) else None,
            current_A=effort if self._effort == "current" else None,
            torque_Nm=effort if self._effort == "torque" else None,
        )

    def _rows_of(self, names: Sequence[str]) -> list[int]:
        where = {name: row for row, name in enumerate(names)}
        missing = [name for name in self._joints if name not in where]
        if missing:
            lacks = _few(missing)
            raise ForeignStateError(f"lacks {lacks}" + (f", has {_few(list(names))}" if names else ", names no joint"))
        if len(where) < len(names):
            twice = next(name for row, name in enumerate(names) if where[name] != row)
            raise DamagedStateError(f"names {twice[:40]!r} twice")
        return [where[name] for name in self._joints]

    def _picked(self, values: Sequence[float], field: str, count: int) -> FloatArray:
        if len(values) != count:
            raise DamagedStateError(f"has {len(values)} values of {field} for {count} names")
        return np.array([values[row] for row in self._rows])


def _few(names: Sequence[str]) -> str:
    shown = ", ".join(repr(name[:40]) for name in names[:_MAX_NAMED])
    return shown + (f" and {len(names) - _MAX_NAMED} more" if len(names) > _MAX_NAMED else "")
