"""The scenario the report's tests share, and laws of it with something changed."""

import copy
import dataclasses

import bumpstop as bs

_HAND = {
    "robot": "sia5d",
    "pose_deg": [0.0, 30.0, 0.0, -20.0, 0.0, -40.0, 0.0],
    "motion": {"velocity_mm_s": [0.0, 0.0, -50.0], "held_joints": [7]},
    "contact": {"body": "hand_finger", "area_cm2": 2.0, "offset_law": "half_normal", "offset_sd_s": 0.1},
    "detector": {
        "thresholds_Nm": [20.0, 10.0, 20.0, 20.0, 20.0, 20.0, 20.0],
        "noise_sd_Nm": [3.636, 1.818, 3.636, 3.636, 3.636, 3.636, 3.636],
    },
    "reaction": {"joint_acceleration_rad_s2": 4.5},
}


def evaluate(changes=None, samples=None):
    """The law of the hand scenario with some dotted keys changed; None removes a key."""
    data = copy.deepcopy(_HAND)
    for key, value in (changes or {}).items():
        *tables, last = key.split(".")
        here = data
        for name in tables:
            here = here.setdefault(name, {})
        if value is None:
            del here[last]
        else:
            here[last] = value
    return bs.evaluate(bs.Scenario.from_dict(data), samples=samples)


def with_limits(law, limits):
    return bs.exact_law(dataclasses.replace(law.problem, limits=limits), law.curve)
