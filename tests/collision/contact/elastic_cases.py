"""Scenarios of elastic arms, and how far two routes to their distributions differ."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import bumpstop as bs

UR10E: dict[str, Any] = {
    "robot": "ur10e",
    "pose_deg": [0, -60, 90, -120, -90, 0],
    "motion": {"velocity_mm_s": [0, 0, -160]},
    "contact": {"stiffness_N_m": 75000},
    "arm": {"model": "elastic"},
    "detector": {"thresholds_Nm": [40, 40, 30, 12, 12, 12], "noise_sd_Nm": [7, 7, 5, 2, 2, 2]},
    "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 10, "latency_s": 0.02},
}


def scenario(**changes: dict[str, Any]) -> bs.Scenario:
    data = {key: dict(value) if isinstance(value, dict) else value for key, value in UR10E.items()}
    for table, keys in changes.items():
        data[table] = data.get(table, {}) | keys
    return bs.Scenario.from_dict(data)


CASES: dict[str, dict[str, dict[str, Any]]] = {
    "stop after a latency": {},
    "reverse": {"reaction": {"kind": "reverse", "latency_s": 0.0}},
    "observer": {"detector": {"residual": "observer", "observer_gain_1_s": 60.0}},
    "correlated noise": {"detector": {"noise_correlation": 0.6}},
    "half-normal offset": {"contact": {"offset_law": "half_normal", "offset_sd_s": 0.02}},
    "soft body": {"contact": {"stiffness_N_m": 10000}, "reaction": {"kind": "reverse"}},
    "free body": {"contact": {"kind": "free", "body_mass_kg": 4.0}},
    "padding": {"contact": {"padding_N_m": 60000}, "reaction": {"kind": "reverse"}},
    "gauge with a mass": {"contact": {"stiffness_N_m": 300000, "gauge_spring_N_m": 75000, "gauge_mass_kg": 0.3}},
    "damped body": {"contact": {"damping_Ns_m": 150.0}},
    "no feedforward": {"arm": {"acceleration_feedforward": 0.0}, "reaction": {"kind": "reverse"}},
}

# The quadrature's own error, as a share of the value: an elastic arm bounces, and its forces are smooth to this only.
OWN_ERROR = 2e-4


@dataclass(frozen=True)
class Difference:
    """Between an integrated and a sampled figure.

    Attributes:
        what: the figure.
        integrated, sampled: its values; of a quantile the probabilities beyond it.
        errors: standard errors of the sample by which they differ, more than the quadrature's own error.
    """

    what: str
    integrated: float
    sampled: float
    errors: float


def differences(integrated: bs.CollisionResult, sampled: bs.CollisionResult) -> list[Difference]:
    """Means and quantiles of the distributions of one scenario."""
    assert sampled.runs is not None
    found = []
    for quantity in ("peak_force", "force_at_detection", "detection_delay"):
        ours, drawn = getattr(integrated, quantity), getattr(sampled, quantity)
        of_all = quantity == "peak_force"
        runs = len(sampled.runs["tick"]) * (1.0 if of_all else max(1 - integrated.undetected_probability, 1e-9))
        apart = ours.mean - drawn.mean
        beyond = math.copysign(max(0.0, abs(apart) - OWN_ERROR * abs(drawn.mean)), apart)
        error = max(drawn.sd / math.sqrt(runs), 1e-300)
        found.append(Difference(f"{quantity}: mean", ours.mean, drawn.mean, beyond / error))
        for p in (0.1, 0.5, 0.9, 0.99):
            value = ours.quantile(p)
            most, least = drawn.exceedance(value * (1 - OWN_ERROR)), drawn.exceedance(value * (1 + OWN_ERROR))
            apart = max(0.0, least - (1 - p)) - max(0.0, (1 - p) - most)
            shares = drawn.exceedance(value)
            found.append(Difference(f"{quantity}: p{p:g}", 1 - p, shares, apart / math.sqrt(p * (1 - p) / runs)))
    return found
