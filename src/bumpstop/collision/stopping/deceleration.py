"""How the arm of a scenario slows down in its reactions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray
from bumpstop.collision.stopping.stopping_times import STANDING, StoppingTimes, stopping_times

if TYPE_CHECKING:
    from pathlib import Path

    from bumpstop.collision.stopping.braking_keys import BrakingKeys
    from bumpstop.model import Robot


@dataclass(frozen=True, eq=False, kw_only=True)
class Deceleration:
    """The law of slowing down that reactions follow, counted from where they begin.

    Attributes:
        law: ``"constant"``, the joints' acceleration limits; ``"constant_time"``, rates fall linearly to zero in
            ``stopping_time``; ``"ramp"``, the limits grow from nothing in ``ramp_time``; ``"table"``, as in constant
            time, but in a time by joint, rate and extension.
        stopping_time: of constant_time [s].
        ramp_time: of ramp [s].
        independent: stop category 0: every joint brakes by itself, and the arm leaves its path.
        times: of table, or None.
        notes: what was assumed.
    """

    law: str = "constant"
    stopping_time: float = 0.0
    ramp_time: float = 0.0
    independent: bool = False
    times: StoppingTimes | None = None
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, reaction: BrakingKeys, folder: Path, robot: Robot) -> Deceleration:
        """Read a ``[reaction]``; relative paths start at ``folder``.

        Raises:
            InputError: its stopping table cannot be used for the robot.
        """
        independent = reaction.stop_category == 0
        times = None
        if reaction.deceleration == "table":
            times = stopping_times(reaction, folder, robot)
        notes = list(times.notes) if times is not None else []
        if independent:
            notes.append(
                "Stop category 0: every joint brakes by itself, and the arm leaves its path. What gravity does until "
                "the brakes hold is not modelled: a table measured downward knows it."
            )
        law = reaction.deceleration
        if law == "ramp" and not reaction.ramp_time_s:
            law = "constant"  # the same to the last digit
        return cls(
            law=law,
            stopping_time=reaction.stopping_time_s or 0.0,
            ramp_time=reaction.ramp_time_s or 0.0,
            independent=independent,
            times=times,
            notes=tuple(notes),
        )

    @cached_property
    def native(self) -> _native.Deceleration:
        """The same for the kernels."""
        found = _native.Deceleration()
        found.law = _native.DecelerationLaw[self.law]
        found.stopping_time = self.stopping_time
        found.ramp_time = self.ramp_time
        found.independent = self.independent
        if self.times is not None:
            found.times = self.times.native
        return found

    @property
    def by_limits(self) -> bool:
        """Whether the joints' acceleration limits decide how far the arm gets."""
        return self.law in ("constant", "ramp")

    def profile(self, robot: Robot, q: FloatArray, rates: FloatArray, limits: FloatArray) -> tuple[FloatArray, float]:
        """Shares of the limits while the arm slows down, and for how long they hold [s]; apart from a ramp.

        Args:
            robot: the arm.
            q: positions where the reaction begins (dof,) [rad or m].
            rates: of the joints there (dof,) [rad/s or m/s].
            limits: of their accelerations (dof,) [rad/s2 or m/s2].
        """
        times = np.abs(rates) / limits
        if self.by_limits or not times.any():
            return np.ones_like(limits), np.inf
        own = np.full_like(limits, self.stopping_time)
        if self.times is not None:
            own = self.times.by_joint(robot, q[None], rates[None])[0]
        moving = times > STANDING * times.max()
        longest = float(own[moving].max())
        scale = (
            np.where(moving, times / np.where(moving, own, 1.0), 1.0)
            if self.independent
            else np.full_like(limits, times.max() / longest)
        )
        return scale, longest

    def even_time(self, limit_time: FloatArray) -> FloatArray:
        """Time [s] of a stop that goes as far while rates fall linearly: twice the distance over the rate.

        Args:
            limit_time: of the slowest joint at its acceleration limit, rate over limit [s]; any shape.

        Returns:
            The same shape. Of a table the longest of all times at its rates.
        """
        if self.law == "constant_time":
            return np.full_like(limit_time, self.stopping_time)
        if self.times is not None:
            return np.full_like(limit_time, float(self.times.time[..., self.times.rate > 0].max()))
        if self.law == "constant" or not self.ramp_time:
            return np.asarray(limit_time)
        ramp = self.ramp_time
        with np.errstate(divide="ignore", invalid="ignore"):
            beyond = limit_time + ramp - ramp**2 / (12 * limit_time)
        return np.asarray(np.where(limit_time <= ramp / 2, 4 / 3 * np.sqrt(2 * limit_time * ramp), beyond))
