"""What the plant's controller reports: when, how finely, with what noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray, as_number
from bumpstop.errors import InputError
from bumpstop.plant.drive import PerJoint, per_joint


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """Feedback of the controller and the wrist's force sensor.

    Attributes:
        rate_hz: of the feedback.
        jitter_s: sd of the instant of a sample; the time stamps say when it was, so they are uneven [s].
        loss: share of the samples that get lost, 0 to below 1.
        position_noise: sd of the encoders [rad or m].
        position_step: of the encoders [rad or m]; 0: none.
        current_noise: sd, in the unit of current; a number or one per joint.
        current_step: likewise; 0: none.
        force_noise: sd of each force of the wrist sensor [N].
        moment_noise: sd of each moment [Nm].
    """

    rate_hz: float = 250.0
    jitter_s: float = 0.0
    loss: float = 0.0
    position_noise: PerJoint = 0.0
    position_step: PerJoint = 0.0
    current_noise: PerJoint = 0.0
    current_step: PerJoint = 0.0
    force_noise: float = 0.0
    moment_noise: float = 0.0

    def __post_init__(self) -> None:
        for name, low, high in (
            ("rate_hz", 1.0, 1000.0),
            ("jitter_s", 0.0, 1.0),
            ("loss", 0.0, 0.9),
            ("force_noise", 0.0, 1e6),
            ("moment_noise", 0.0, 1e6),
        ):
            if not low <= as_number(getattr(self, name), f"sensors.{name}") <= high:
                raise InputError(f"sensors.{name}", f"is {getattr(self, name)}", f"wanted {low:g} to {high:g}")


@dataclass(frozen=True)
class SamplePlan:
    """Everything random of a run, drawn before it begins: nothing that happens in it can change it.

    Attributes:
        step: integration step after which each sample is taken (N,), strictly rising.
        kept: (N,) False where a sample gets lost.
        scatter: of the friction, of sd 1 (N, dof).
        position, current, wrench: noise, of sd 1 (N, dof), (N, dof) and (N, 6).
    """

    step: npt.NDArray[np.int64]
    kept: npt.NDArray[np.bool_]
    scatter: FloatArray
    position: FloatArray
    current: FloatArray
    wrench: FloatArray

    @classmethod
    def draw(cls, sensors: Sensors, dof: int, duration: float, step: float, first: float, seed: int) -> SamplePlan:
        """Plan the samples of a run.

        Args:
            sensors: rates and losses.
            dof: number of joints.
            duration: of the run [s].
            step: of the integration [s].
            first: instant of the first sample [s].
            seed: 0 to 2^64 - 1. Each quantity has a stream of its own, so that switching one off leaves the others.
        """
        period = 1.0 / sensors.rate_hz
        count = max(0, int(np.floor((duration - first) / period + 1e-9)) + 1)

        def stream(number: int) -> np.random.Generator:
            return np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, number])))

        # A sample never changes places with the next.
        late = np.clip(stream(0).normal(size=count) * sensors.jitter_s, -0.45 * period, 0.45 * period)
        index = np.rint((first + np.arange(count) * period + late) / step).astype(np.int64)
        index = np.clip(index, 1, round(duration / step))
        kept = stream(1).random(count) >= sensors.loss
        kept[1:] &= np.diff(index) > 0
        return cls(
            step=index,
            kept=kept,
            scatter=stream(2).normal(size=(count, dof)),
            position=stream(3).normal(size=(count, dof)),
            current=stream(4).normal(size=(count, dof)),
            wrench=stream(5).normal(size=(count, 6)),
        )


class Channels:
    """Noise and steps of the sensors of an arm."""

    def __init__(self, sensors: Sensors, dof: int) -> None:
        self._position = [
            per_joint(getattr(sensors, name), dof, f"sensors.{name}") for name in ("position_noise", "position_step")
        ]
        self._current = [
            per_joint(getattr(sensors, name), dof, f"sensors.{name}") for name in ("current_noise", "current_step")
        ]
        self._wrench = np.repeat([sensors.force_noise, sensors.moment_noise], 3)

    def position(self, q: FloatArray, noise: FloatArray) -> FloatArray:
        """What the encoders say (dof,)."""
        return _stepped(q + self._position[0] * noise, self._position[1])

    def current(self, current: FloatArray, noise: FloatArray) -> FloatArray:
        """What the amplifiers say (dof,)."""
        return _stepped(current + self._current[0] * noise, self._current[1])

    def wrench(self, wrench: Sequence[float] | FloatArray, noise: FloatArray) -> FloatArray:
        """What the wrist sensor says (6,)."""
        return np.asarray(wrench + self._wrench * noise)


def _stepped(value: FloatArray, step: FloatArray) -> FloatArray:
    if not step.any():
        return value
    # Finer than a number is round to, a step changes nothing, and how many there are might be no number.
    coarse = step > np.finfo(float).eps * np.abs(value)
    safe = np.where(coarse, step, 1.0)
    return np.where(coarse, np.rint(value / safe) * safe, value)
