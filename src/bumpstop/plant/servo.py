"""The position controller of the plant's joints."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bumpstop.arrays import FloatArray, as_number
from bumpstop.errors import InputError
from bumpstop.plant.command import COMMAND_STEP, Command

STEP = 2e-4  # of the integration [s]
PER_COMMAND = round(COMMAND_STEP / STEP)


@dataclass(frozen=True, kw_only=True)
class Servo:
    """The position controller of the joints, which works at every integration step (5 kHz).

    It adds to the torque that the commanded motion needs ``w^2 m (q_wanted - q) + 2 d w m (qd_wanted - qd)``, with m
    what the joint moves in the start pose.

    Attributes:
        bandwidth_hz: w over 2 pi.
        damping_ratio: d.
    """

    bandwidth_hz: float = 100.0
    damping_ratio: float = 1.0

    def __post_init__(self) -> None:
        for name, low, high in (("bandwidth_hz", 1.0, 200.0), ("damping_ratio", 0.1, 5.0)):
            if not low <= as_number(getattr(self, name), f"servo.{name}") <= high:
                raise InputError(f"servo.{name}", f"is {getattr(self, name)}", f"wanted {low:g} to {high:g}")

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
