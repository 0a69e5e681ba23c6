"""The position controller of the plant's joints."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray, as_number
from bumpstop.errors import InputError
from bumpstop.plant.command import COMMAND_STEP, Command
from bumpstop.plant.drive import PerJoint, per_joint

if TYPE_CHECKING:
    from bumpstop.model import DriveTrain

STEP = 2e-4  # of the integration [s]
PER_COMMAND = round(COMMAND_STEP / STEP)


@dataclass(frozen=True, kw_only=True)
class Servo:
    """The position controller of the joints, which works at every integration step (5 kHz).

    It adds to the torque that the commanded motion needs ``w^2 m (q_wanted - q) + 2 d w m (qd_wanted - qd)``, with m
    what the joint moves in the start pose. With ``velocity_bandwidth`` it is a cascade instead, the servo of a
    :class:`~bumpstop.model.DriveTrain`: ``D (w_p (q_wanted - q) + qd_wanted - qd)`` with D = w_v (B + M_jj), B the
    rotor and M_jj what the link side moves in the start pose.

    Attributes:
        bandwidth_hz: w over 2 pi.
        damping_ratio: d.
        velocity_bandwidth: w_v [rad/s], a number for all joints or one for each; None: no cascade.
        position_gain: w_p [1/s], likewise; a cascade needs it.
        torque_limit: most that the motors give [Nm or N], likewise; infinite: no limit.
        acceleration_feedforward: share of the torque for accelerations and Coriolis forces that the motors give
            beforehand, likewise, 0 to 1; they always carry gravity.
    """

    bandwidth_hz: float = 100.0
    damping_ratio: float = 1.0
    velocity_bandwidth: PerJoint | None = None
    position_gain: PerJoint | None = None
    torque_limit: PerJoint = math.inf
    acceleration_feedforward: PerJoint = 1.0

    def __post_init__(self) -> None:
        for name, low, high in (("bandwidth_hz", 1.0, 200.0), ("damping_ratio", 0.1, 5.0)):
            if not low <= as_number(getattr(self, name), f"servo.{name}") <= high:
                raise InputError(f"servo.{name}", f"is {getattr(self, name)}", f"wanted {low:g} to {high:g}")
        if (self.velocity_bandwidth is None) != (self.position_gain is None):
            missing = "velocity_bandwidth" if self.velocity_bandwidth is None else "position_gain"
            raise InputError(f"servo.{missing}", "is missing", "a cascade has velocity_bandwidth and position_gain")

    @classmethod
    def of(cls, drive_train: DriveTrain) -> Servo:
        """The servo of a drive train."""
        return cls(
            velocity_bandwidth=drive_train.servo_bandwidth.tolist(),
            position_gain=drive_train.servo_position_gain.tolist(),
            torque_limit=drive_train.torque_limit.tolist(),
            acceleration_feedforward=drive_train.acceleration_feedforward.tolist(),
        )

    def cascade(self, moved: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Torque per error of position and of rate, from rotor and link side together (dof,); None: no cascade."""
        if self.velocity_bandwidth is None or self.position_gain is None:
            return None
        n = len(moved)
        # The loop works at every step of the integration, which a faster one would outrun.
        velocity = per_joint(self.velocity_bandwidth, n, "servo.velocity_bandwidth", 2000.0)
        kv = velocity * moved
        return per_joint(self.position_gain, n, "servo.position_gain", 2000.0, least=1e-9) * kv, kv

    def gains(self, moved: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Torque per error of position and of rate, from the inertia that each joint moves (dof,) [kg m2 or kg]."""
        w = 2 * math.pi * self.bandwidth_hz
        return moved * w * w, 2 * self.damping_ratio * w * moved


def between(command: Command) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, rate and acceleration wanted at every integration step (steps, dof)."""
    share = (np.arange(PER_COMMAND) / PER_COMMAND)[:, None]
    q0, q1, v0, v1 = command.q[:-1, None], command.q[1:, None], command.qd[:-1, None], command.qd[1:, None]
    # Cubic Hermite between milliseconds.
    s2, s3 = share**2, share**3
    q = (
        (2 * s3 - 3 * s2 + 1) * q0
        + (3 * s2 - 2 * s3) * q1
        + COMMAND_STEP * ((s3 - 2 * s2 + share) * v0 + (s3 - s2) * v1)
    )
    qd = v0 + share * (v1 - v0)
    qdd = np.broadcast_to((v1 - v0) / COMMAND_STEP, q.shape)
    n = command.q.shape[1]
    q, qd, qdd = (np.ascontiguousarray(part.reshape(-1, n)) for part in (q, qd, qdd))
    return q, qd, qdd
