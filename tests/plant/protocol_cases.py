"""Schroeder's protocol on the plant with planted parameters: how often intervals hold the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bumpstop.identification.design.plan import IdentificationPlan, ProtocolSettings, plan_identification
from bumpstop.plant import Gears, Plant, Sensors
from bumpstop.reproduction.schroeder2013.protocol import ProtocolFit, identify_protocol
from bumpstop.reproduction.schroeder2013.simulate_protocol import follow, planned_arm, planned_experiments
from plant.cases import ROTORS, joint_model, source_arm

Floats = npt.NDArray[np.float64]

NAMES = ("A", "B", "D", "F", "hysteresis", "inertia")
MAP, FRICTION = ("A", "B"), ("D", "F")
SETTINGS = ProtocolSettings(
    speed_shares=(0.1, 0.2, 0.3, 0.5), repeats=3, ramp_repeats=3, holds=5, hold_s=6.0, acceleration=4.5
)
Z95 = 1.959964
_TILT = np.radians(30)
GRAVITY = 9.80665


def source_plan(settings: ProtocolSettings = SETTINGS) -> IdentificationPlan:
    return plan_identification(source_arm(), settings)


def remedied(settings: ProtocolSettings) -> ProtocolSettings:
    """What the plan itself names where gravity shows too little: a tilted base and a known load off the last axis."""
    tilted = (float(GRAVITY * np.sin(_TILT)), 0.0, float(-GRAVITY * np.cos(_TILT)))
    return replace(settings, load_kg=4.0, load_m=(0.1, 0.0, 0.1), gravity=tilted)


@dataclass(frozen=True, eq=False)
class Found:
    """One parameter of one joint, fit by fit.

    Attributes:
        joint, name: of the parameter; joints from 1.
        truth: that was planted.
        value, error: (fits,), NaN where there is none.
        rate: of the feedback (fits,) [Hz].
        hardly_seen: share of the fits that name it as hardly seen.
    """

    joint: int
    name: str
    truth: float
    value: Floats
    error: Floats
    rate: Floats
    hardly_seen: float

    @property
    def off(self) -> Floats:
        """Errors in standard errors (fits,)."""
        return np.asarray((self.value - self.truth) / self.error)

    @property
    def median_error(self) -> float:
        """Of the truth."""
        return float(np.median(self.value) / self.truth - 1)

    @property
    def seen(self) -> bool:
        """Whether most fits, which do not know the truth, take it as seen."""
        return self.hardly_seen < 0.5


def recovered(
    plan: IdentificationPlan, seeds: Sequence[int], rates: Sequence[float], joints: Sequence[int] = ()
) -> list[Found]:
    """Fits of every seed at every rate, with 1 % lost samples; the friction scatters as in table 2.2."""
    plant = Plant(
        planned_arm(plan),
        joint_model(inertia=False),
        friction=Gears(rotor_inertia=ROTORS),
        gravity=plan.settings.gravity,
    )
    recorders = [
        (Sensors(rate_hz=rate, loss=0.01, jitter_s=1e-4, position_step=1e-6), seed) for rate in rates for seed in seeds
    ]
    found = []
    for one in planned_experiments(plan, joints):
        runs = plant.runs(follow(plan.path(one)), recorders)
        fits = []
        while runs:  # a thousand samples a second for minutes: not to be kept
            fits.append(identify_protocol(plan, [runs.pop(0).recording]))
        found += _of_joint(one.joint, fits, np.array([sensors.rate_hz for sensors, _ in recorders]))
    return found


def _of_joint(joint: int, fits: Sequence[ProtocolFit], rate: Floats) -> list[Found]:
    planted = joint_model(inertia=True).joints[joint]
    rows = []
    for name in NAMES:
        got = [fit.joints[0].parameters.get(name) for fit in fits]
        value = np.array([np.nan if one is None else one.value for one in got])
        error = np.array([np.nan if one is None or one.standard_error is None else one.standard_error for one in got])
        hardly = float(np.mean([name in fit.joints[0].hardly_seen for fit in fits]))
        rows.append(Found(joint + 1, name, planted.value(name), value, error, rate, hardly))
    return rows
