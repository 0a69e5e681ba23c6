"""The source's protocol on the plant with planted parameters: how often intervals hold the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bumpstop.identification.plan import IdentificationPlan, ProtocolSettings, plan_identification
from bumpstop.identification.protocol import ProtocolFit, identify_protocol
from bumpstop.plant import Gears, Plant, Sensors
from bumpstop.plant.rehearsal import follow, planned_arm, planned_experiments
from plant.cases import ROTORS, joint_model, source_arm

Floats = npt.NDArray[np.float64]

NAMES = ("A", "B", "D", "F", "hysteresis", "inertia")
MAP, FRICTION = ("A", "B"), ("D", "F")
SETTINGS = ProtocolSettings(
    speed_shares=(0.1, 0.2, 0.3, 0.5), repeats=3, ramp_repeats=3, holds=5, hold_s=6.0, acceleration=4.5
)
Z95 = 1.959964


def source_plan(settings: ProtocolSettings = SETTINGS) -> IdentificationPlan:
    return plan_identification(source_arm(), settings)


@dataclass(frozen=True, eq=False)
class Found:
    """One parameter of one joint, fit by fit.

    Attributes:
        joint, name: of the parameter; joints from 1.
        truth: that was planted.
        value, error: (fits,), NaN where there is none.
        rate: of the feedback (fits,) [Hz].
    """

    joint: int
    name: str
    truth: float
    value: Floats
    error: Floats
    rate: Floats

    @property
    def off(self) -> Floats:
        """Errors in standard errors (fits,)."""
        return np.asarray((self.value - self.truth) / self.error)

    @property
    def median_error(self) -> float:
        """Of the truth."""
        return float(np.median(self.value) / self.truth - 1)

    @property
    def median_known_to(self) -> float:
        """Standard error of the median, of the truth, were the fits' own standard errors right."""
        return float(np.sqrt(np.pi / 2 / self.value.size) * np.median(self.error) / self.truth)


def recovered(
    plan: IdentificationPlan, seeds: Sequence[int], rates: Sequence[float], joints: Sequence[int] = ()
) -> list[Found]:
    """Fits of every seed at every rate, with 1 % lost samples; the friction scatters as in table 2.2."""
    plant = Plant(planned_arm(plan), joint_model(inertia=False), friction=Gears(rotor_inertia=ROTORS))
    recorders = [
        (Sensors(rate_hz=rate, loss=0.01, jitter_s=1e-4, position_step=1e-6), seed) for rate in rates for seed in seeds
    ]
    found = []
    for one in planned_experiments(plan, joints):
        runs = plant.runs(follow(plan.path(one)), recorders)
        fits = [identify_protocol(plan, [run.recording]) for run in runs]
        found += _of_joint(one.joint, fits, np.array([sensors.rate_hz for sensors, _ in recorders]))
    return found


def _of_joint(joint: int, fits: Sequence[ProtocolFit], rate: Floats) -> list[Found]:
    planted = joint_model(inertia=True).joints[joint]
    rows = []
    for name in NAMES:
        got = [fit.joints[0].parameters.get(name) for fit in fits]
        value = np.array([np.nan if one is None else one.value for one in got])
        error = np.array([np.nan if one is None or one.standard_error is None else one.standard_error for one in got])
        rows.append(Found(joint + 1, name, planted.value(name), value, error, rate))
    return rows
