"""Scenarios that requirements are asked of."""

from __future__ import annotations

from typing import Any

import numpy as np

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


def swinging(**changes: Any) -> bs.Scenario:
    """A soft servo swings against a padded elbow: contact at 116 to 138 mm/s presses harder than at 150."""
    data: dict[str, Any] = {
        "robot": "ur3e",
        "pose_deg": [30.6, -76.0, 126.1, -143.8, -101.6, 5.2],
        "motion": {"velocity_mm_s": [0, 0, -30]},
        "contact": {
            "body": "upper_arm_elbow", "limits": "ts15066", "area_cm2": 0.17, "padding_N_m": 5000.0,
        },
        "detector": {
            "thresholds_Nm": [12.877, 10.631, 5.503, 5.015, 2.142, 2.08],
            "noise_sd_Nm": [0.1288, 0.1063, 0.055, 0.0502, 0.0214, 0.0208],
            "feedback_period_s": 0.004,
            "residual": "observer",
            "observer_gain_1_s": 200,
        },
        "reaction": {"kind": "reverse", "joint_acceleration_rad_s2": 80},
        "arm": {"model": "elastic", "servo_bandwidth_hz": 3, "rotor_inertia_kg_m2": 2},
    }  # fmt: skip
    return bs.Scenario.from_dict(data).with_values(changes)


def random_swinging(seed: int, vary: str) -> tuple[bs.Scenario, float] | None:
    """An elastic arm against a body that takes a little less than a crest of the force, and more than a valley.

    Returns:
        The scenario and the value of the valley behind the crest; None where the force has no crest.
    """
    rng = np.random.default_rng([94, seed])
    robot, pose = [
        ("ur3e", [10, -80, 110, -120, -90, 20]),
        ("ur5e", [10, -80, 110, -120, -90, 20]),
        ("sia5d", [0, 30, 0, -20, 0, -40, 0]),
        ("iiwa14", [10, 30, 0, -70, 0, 60, 0]),
    ][seed % 4]
    thresholds = rng.uniform(5, 20) * rng.uniform(0.5, 1.5, len(pose))
    data: dict[str, Any] = {
        "robot": robot,
        "pose_deg": (pose + rng.uniform(-15, 15, len(pose))).tolist(),
        "motion": {"velocity_mm_s": [0, 0, -100], "duration_s": 1},
        "contact": {"body": "upper_arm_elbow", "limits": "ts15066", "area_cm2": 1, "padding_N_m": 8000},
        "detector": {
            "thresholds_Nm": thresholds.tolist(),
            "noise_sd_Nm": (rng.choice([0.001, 0.01]) * thresholds).tolist(),
            "feedback_period_s": 0.004,
        },
        "reaction": {"kind": "reverse", "joint_acceleration_rad_s2": float(rng.choice([30, 80]))},
        "arm": {"model": "elastic", "servo_bandwidth_hz": 3, "rotor_inertia_kg_m2": float(rng.choice([0.5, 2]))},
        "simulation": {"step_s": 0.002},
    }
    if len(pose) == 7:
        data["motion"]["held_joints"] = [7 if robot == "sia5d" else 3]
    case, variable = bs.Scenario.from_dict(data), Variable(vary)
    values = np.geomspace(30, 300, 40) if vary == "motion.speed" else np.geomspace(2e3, 5e4, 40)
    force = np.array([bs.evaluate(variable.apply(case, float(value))).peak_force.quantile(0.999) for value in values])
    crest = np.maximum.accumulate(force)
    valley = int((force / crest).argmin())
    limits = bs.evaluate(case).problem.limits
    assert limits is not None
    allowed = float(force[valley] ** 0.2 * crest[valley] ** 0.8)
    if force[valley] > 0.97 * crest[valley] or not allowed < limits.force_N:
        return None
    area = 0.1 * allowed / limits.allowed_force_N(0.1, case.contact.peak_factor)
    return case.with_values({"contact.area_cm2": float(f"{area:.6g}")}), float(values[valley])
