"""Random scenarios with uncertain and assumed inputs, at speeds where both verdicts occur."""

from __future__ import annotations

from typing import Any

import numpy as np

from bumpstop import Scenario
from collision.cases import control_group, ur10e

# What may be uncertain: its key, and how far it is known (a share).
_KEYS = (
    ("contact.stiffness_N_m", 0.25),
    ("contact.area_cm2", 0.2),
    ("detector.threshold_scale", 0.1),
    ("detector.torque_gain", 0.08),
    ("detector.noise_sd_Nm", 0.15),
    ("reaction.joint_acceleration_rad_s2", 0.15),
    ("contact.offset_sd_s", 0.3),
    ("motion.speed_mm_s", 0.06),
)


def random_uncertain(
    seed: int, *, assumed: int | None = None, distributions: int | None = None, width: float = 1.0
) -> Scenario:
    """A scenario with one to four uncertain inputs.

    Args:
        seed: of everything.
        assumed: how many of them have an interval; None: none to two.
        distributions: how many have a distribution; None: one to three.
        width: of all ranges, as a share of what they are otherwise.
    """
    rng = np.random.default_rng([71, seed])
    arm = control_group if rng.random() < 0.4 else ur10e
    base = arm(contact__area_cm2=2.0, contact__offset_law="half_normal", reaction__latency_s=0.004)
    velocity = np.array(base.motion.velocity_mm_s) * rng.uniform(0.55, 1.05 if arm is control_group else 1.35)
    count = int(rng.integers(1, 4)) if distributions is None else distributions
    intervals = int(rng.integers(0, 3)) if assumed is None else assumed
    chosen = rng.permutation(len(_KEYS))[: count + intervals]
    table: dict[str, Any] = {}
    for place, number in enumerate(chosen):
        key, share = _KEYS[number]
        share *= width * float(rng.uniform(0.4, 1.0))
        if place >= count:
            table[key] = {"interval" if key.startswith("detector.t") else "relative": [1 - share, 1 + share]}
        else:
            table[key] = _distribution(rng, key, share)
    return base.with_values({"motion.velocity_mm_s": velocity.tolist(), "uncertainty": table})


def _distribution(rng: np.random.Generator, key: str, share: float) -> dict[str, Any]:
    kind = str(rng.choice(["normal", "lognormal", "uniform", "triangular"]))
    if kind == "normal":
        return {"distribution": kind, "relative_sd": share / 2}
    if kind == "lognormal":
        return {"distribution": kind, "sigma": share / 2}
    if kind == "uniform":
        return {"distribution": kind, "relative": [1 - share, 1 + share]}
    return {"distribution": kind, "relative": [1 - share, 1.0, 1 + 1.5 * share]}
