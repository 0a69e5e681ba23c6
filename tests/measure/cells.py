"""Scenarios of a cell that is measured."""

from __future__ import annotations

from typing import Any

import bumpstop as bs

RIGID: dict[str, Any] = {
    "robot": "ur10e",
    "pose_deg": [0, -75.7, 102.6, -116.9, -90, 0],
    "motion": {"velocity_mm_s": [0, 0, -100]},
    "contact": {"body": "hand_finger", "limits": "ts15066", "area_cm2": 2.0},
    "detector": {
        "thresholds_Nm": [40, 40, 30, 12, 12, 12],
        "noise_sd_Nm": [4, 4, 3, 1, 1, 1],
        "feedback_period_s": 0.002,
    },
    "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 10, "latency_s": 0.01},
}


def rigid(**changes: Any) -> bs.Scenario:
    """An arm that follows its path; ``__`` in a name stands for the dot of a key."""
    return bs.Scenario.from_dict(RIGID).with_values({key.replace("__", "."): value for key, value in changes.items()})


def elastic(**changes: Any) -> bs.Scenario:
    """The same arm with gears and servos that give."""
    return rigid(arm__model="elastic", **changes)
