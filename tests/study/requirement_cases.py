"""Scenarios that requirements are asked of."""

from __future__ import annotations

from typing import Any

import bumpstop as bs
from bumpstop.study.variable import Variable


def scenario(**changes: Any) -> bs.Scenario:
    """A forearm under an arm that stops quickly: distributions of few ticks."""
    data: dict[str, Any] = {
        "robot": "ur10e",
        "pose_deg": [10, -80, 110, -120, -90, 20],
        "motion": {"velocity_mm_s": [80, 40, -80]},
        "contact": {"body": "lower_arm_wrist", "limits": "ts15066", "area_cm2": 2.0},
        "detector": {"thresholds_Nm": [40, 40, 30, 12, 12, 12], "noise_sd_Nm": [7, 7, 5, 2, 2, 2]},
        "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 10, "latency_s": 0.006},
    }
    data["detector"]["feedback_period_s"] = 0.002
    return bs.Scenario.from_dict(data).with_values(changes)


def over(case: bs.Scenario, vary: str, value: float) -> float:
    """Probability of passing a limit, by the public way."""
    verdict = bs.evaluate(Variable(vary).apply(case, value)).verdict
    return max(verdict.p_over_force or 0.0, verdict.p_over_pressure or 0.0)
