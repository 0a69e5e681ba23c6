"""The position controller of the plant's joints."""

from __future__ import annotations

from dataclasses import dataclass

from bumpstop.arrays import as_number
from bumpstop.errors import InputError


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
