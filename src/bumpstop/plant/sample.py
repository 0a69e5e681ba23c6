"""A feedback sample of the plant, as a callback gets it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bumpstop.arrays import FloatArray

if TYPE_CHECKING:
    from bumpstop.plant.command import PlantReaction


@dataclass(frozen=True)
class Sample:
    """What a controller knows at a feedback sample, and what only the plant knows.

    Attributes:
        t: since the start [s].
        q: as the encoders say (dof,) [rad or m].
        qd: rates of the motors, without noise (dof,) [rad/s or m/s].
        current: as the amplifiers say (dof,).
        wrench: as the wrist sensor says (6,).
        contact_force: true force on each object along its normal (objects,) [N].
        contact_torque: true torque that the motors must add for it: J_v' n F, summed (dof,) [Nm or N].
    """

    t: float
    q: FloatArray
    qd: FloatArray
    current: FloatArray
    wrench: FloatArray
    contact_force: FloatArray
    contact_torque: FloatArray


OnSample = Callable[[Sample], "PlantReaction | None"]
