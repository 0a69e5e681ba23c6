"""Laws of slowing down: how far a joint still gets, by its speed when the stop begins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bumpstop.arrays import FloatArray


@dataclass(frozen=True)
class DecelerationLaw:
    """A law of slowing down.

    What the joint's load changes is ``scale``, one positive number; ``shape`` are numbers of the joint alone.

    Attributes:
        name: as ``reaction.deceleration`` has it; ``"power"`` is none of a scenario.
        formula: of the distance d, as people read it.
        scale: its name and unit.
        shape: names and units.
        distance: (speed, scale, shape) to distance [rad or m].
        scale_of: (speed, distance, shape) to the scale with which the law says that distance; NaN where none does.
        errs_low: a greater scale makes a shorter stop.
    """

    name: str
    formula: str
    scale: tuple[str, str]
    shape: tuple[tuple[str, str], ...]
    distance: Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
    scale_of: Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
    errs_low: bool


def constant_distance(speed: FloatArray, deceleration: FloatArray, shape: FloatArray) -> FloatArray:
    """The distance v t_dead + v^2 / 2a; shape: the dead time [s]."""
    return np.asarray(speed * shape[0] + speed**2 / (2 * deceleration))


def ramp_distance(speed: FloatArray, deceleration: FloatArray, shape: FloatArray) -> FloatArray:
    """Deceleration that grows linearly from 0 to a over t_ramp after t_dead; shape: dead and ramp time [s].

    From v(t) = v - a t^2 / 2 t_ramp, and v(t) = v - a (t - t_ramp / 2) after t_ramp.
    """
    dead, ramp = shape
    inside = (2.0 / 3.0) * speed * np.sqrt(2 * speed * ramp / deceleration)
    beyond = speed**2 / (2 * deceleration) + speed * ramp / 2 - deceleration * ramp**2 / 24
    return np.asarray(speed * dead + np.where(speed <= deceleration * ramp / 2, inside, beyond))


def _constant_scale(speed: FloatArray, distance: FloatArray, shape: FloatArray) -> FloatArray:
    left = distance - speed * shape[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(left > 0, speed**2 / (2 * left), np.nan))


def _ramp_scale(speed: FloatArray, distance: FloatArray, shape: FloatArray) -> FloatArray:
    """By bisection of the logarithm: the distance falls with the deceleration."""
    low, high = np.full_like(speed, 1e-4), np.full_like(speed, 1e6)
    for _ in range(80):
        middle = np.sqrt(low * high)
        far = ramp_distance(speed, middle, shape) > distance
        low, high = np.where(far, middle, low), np.where(far, high, middle)
    return np.asarray(np.where((high < 0.99e6) & (low > 1.01e-4), np.sqrt(low * high), np.nan))


LAWS = {
    law.name: law
    for law in (
        DecelerationLaw(
            "constant_time",
            "d = v T / 2",
            ("stopping time T", "s"),
            (),
            lambda speed, scale, _: np.asarray(speed * scale / 2),
            lambda speed, distance, _: np.asarray(2 * distance / speed),
            False,
        ),
        DecelerationLaw(
            "constant",
            "d = v t_dead + v² / 2a",
            ("deceleration a", "rad/s²"),
            (("dead time t_dead", "s"),),
            constant_distance,
            _constant_scale,
            True,
        ),
        DecelerationLaw(
            "ramp",
            "d = v t_dead + v² / 2a + v t_ramp / 2 - a t_ramp² / 24",
            ("deceleration a", "rad/s²"),
            (("dead time t_dead", "s"), ("ramp t_ramp", "s")),
            ramp_distance,
            _ramp_scale,
            True,
        ),
        DecelerationLaw(
            "power",
            "d = c v^p",
            ("factor c", "rad (s/rad)^p"),
            (("exponent p", "1"),),
            lambda speed, scale, shape: np.asarray(scale * speed ** shape[0]),
            lambda speed, distance, shape: np.asarray(distance / speed ** shape[0]),
            False,
        ),
    )
}
"""From the fewest numbers to the most: of two that fit alike the first counts."""
