"""One sample of the joints of a running arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointSample:
    """What a source says of all joints at one time, in the order of the robot's joints.

    Values are as they came: NaN and impossible ones are for the detector to tell.

    Attributes:
        stamp_s: time of the sample by the clock of its source [s].
        received_s: ``time.monotonic()`` when it was received [s].
        position_rad: (n,) [rad or m].
        velocity_rad_s: (n,) measured rates [rad/s or m/s]; None: the source has none.
        current_A: (n,) motor currents in the unit of the detector's joint model; None: the source has none.
        torque_Nm: (n,) joint torques of the motors, along the axes [Nm or N]; None: the source has none.
        sequence: number of the sample where the source counts its samples, one more each time; None: it does not.
    """

    stamp_s: float
    received_s: float
    position_rad: FloatArray
    velocity_rad_s: FloatArray | None = None
    current_A: FloatArray | None = None
    torque_Nm: FloatArray | None = None
    sequence: int | None = None
