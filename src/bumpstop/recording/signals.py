"""What an arm measured over time, checked: the part of a recording that its files hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.errors import InputError


@dataclass(frozen=True, eq=False, kw_only=True)
class Signals:
    """Arrays of a recording and the names of its joints; :class:`bumpstop.recording.Recording` says what each is."""

    t: FloatArray
    q: FloatArray
    qd: FloatArray | None = None
    current: FloatArray | None = None
    tau: FloatArray | None = None
    wrench: FloatArray | None = None
    q_ref: FloatArray | None = None
    joint_names: tuple[str, ...] = ()
    robot: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        t = as_float_array(self.t, "recording.t", (None,))
        if t.size < 2:
            raise InputError("recording.t", f"{t.size} rows", "wanted at least 2")
        falling = np.flatnonzero(np.diff(t) <= 0)
        if falling.size:
            raise InputError(
                f"recording.t[{falling[0] + 1}]", "is not later than the one before", "wanted rising times"
            )
        object.__setattr__(self, "t", t)
        q = as_float_array(self.q, "recording.q", (t.size, None))
        object.__setattr__(self, "q", q)
        each = q.shape[1]
        for name, width in (("qd", each), ("current", each), ("tau", each), ("q_ref", each), ("wrench", 6)):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, as_float_array(value, f"recording.{name}", (t.size, width)))
        if self.joint_names and len(self.joint_names) != q.shape[1]:
            problem = f"{len(self.joint_names)} of them for {q.shape[1]} joints"
            raise InputError("recording.joint_names", problem)

    @property
    def dof(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])
