"""Random collisions in which something gives way, and how far their integrated and sampled distributions differ."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

import bumpstop as bs

ROBOTS = ("sia5d", "ur3e", "ur5e", "ur10", "ur10e", "panda", "iiwa14")
# By joint from the base [Nm]: what a threshold is about.
_TORQUES = np.array([30.0, 30, 20, 10, 10, 8, 6])
# The quadrature's own error, as a share of a force; standard errors that chance may bring in thousands of figures.
_OWN_ERROR, _STANDARD_ERRORS = 3e-3, 4.5
# Of a batch as a share of the mean force: three times what it is off by, for quantiles where hardly any force lies.
_OF_BATCH = 3e-3
_PROBABILITIES = (0.1, 0.3, 0.5, 0.7, 0.9, 0.99)


def random_contact(seed: int) -> bs.Scenario:
    """Built-in arms anywhere in their reach, two of three elastic, against bodies of every kind.

    Raises:
        InputError: the arm cannot begin such a motion.
    """
    rng = np.random.default_rng([37, seed])
    robot = bs.Robot.load(str(rng.choice(ROBOTS)))
    pose = rng.uniform(np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0))
    direction = rng.normal(size=3)
    speed = float(rng.choice([20, 60, 150, 300, 500]))
    thresholds = rng.uniform(0.5, 3) * _TORQUES[: robot.dof]
    data: dict[str, Any] = {
        "robot": robot.name,
        "pose_rad": pose.tolist(),
        "motion": {
            "velocity_mm_s": (speed * direction / np.linalg.norm(direction)).tolist(),
            "start": "rest" if rng.random() < 0.2 else "moving",
        },
        "contact": {"stiffness_N_m": float(rng.choice([5e3, 2e4, 75e3, 150e3]))} | _body(rng) | _offset(rng),
        "detector": {
            "thresholds_Nm": thresholds.tolist(),
            "noise_sd_Nm": (thresholds * rng.choice([0.02, 0.1, 0.18, 0.3])).tolist(),
            "feedback_period_s": float(rng.choice([0.002, 0.004, 0.008])),
        },
        "reaction": {
            "kind": str(rng.choice(["stop", "reverse"])),
            "joint_acceleration_rad_s2": float(rng.choice([2, 8, 20])),
            "latency_s": float(rng.choice([0.0, 0.007, 0.03])),
        },
    }
    if rng.random() < 0.2:
        data["motion"]["duration_s"] = float(rng.choice([0.1, 0.4]))
    if rng.random() < 0.25:
        data["detector"] |= {"residual": "observer", "observer_gain_1_s": float(rng.choice([20, 60, 200]))}
    if rng.random() < 0.15:
        data["detector"]["noise_correlation"] = float(rng.choice([0.3, 0.8]))
    if rng.random() < 0.7:
        data["arm"] = {"model": "elastic"}
    return bs.Scenario.from_dict(data)


def _body(rng: np.random.Generator) -> dict[str, Any]:
    kind = rng.choice(["clamped", "clamped", "free", "gauge", "damped"])
    if kind == "free":
        return {"kind": "free", "body_mass_kg": float(rng.choice([0.6, 4, 20]))}
    if kind == "gauge":
        return {
            "gauge_spring_N_m": float(rng.choice([10e3, 75e3])),
            "gauge_mass_kg": float(rng.choice([0.3, 2.0])),
        }
    return {"damping_Ns_m": float(rng.choice([20, 200, 800]))} if kind == "damped" else {}


def _offset(rng: np.random.Generator) -> dict[str, Any]:
    law = str(rng.choice(["half_normal", "uniform", "fixed"]))
    size = {"offset_sd_s": float(rng.choice([0.02, 0.1, 0.3]))}
    return {"offset_law": law} | (
        {"offset_mm": float(rng.choice([1, 10, 40]))} if law == "fixed" else size if law == "half_normal" else {}
    )


def differences(scenario: bs.Scenario, runs: int, seed: int = 1) -> Iterator[str]:
    """What that many drawn collisions, or the same pose in a batch, contradict of the integrated distribution."""
    integrated, drawn = bs.evaluate(scenario), bs.evaluate(scenario, samples=runs, seed=seed)
    yield from _differences_of_batch(scenario, integrated)

    def wide(p: float, own: float) -> float:
        return _STANDARD_ERRORS * math.sqrt(max(p * (1 - p), 1e-4) / runs) + own

    for name in ("undetected_probability", "false_alarm_probability", "no_contact_probability"):
        own, other = getattr(integrated, name), getattr(drawn, name)
        if abs(own - other) > wide(own, 2e-3):
            yield f"{name}: {own:.4g} integrated, {other:.4g} drawn"
    for p in _PROBABILITIES:
        value = integrated.peak_force.quantile(p)
        if not (math.isfinite(value) and value > 1e-6):
            continue
        low, high = value * (1 - _OWN_ERROR), value * (1 + _OWN_ERROR)
        ours, theirs = integrated.peak_force.exceedance, drawn.peak_force.exceedance
        if theirs(high) - wide(p, 3e-3) > ours(low) or theirs(low) + wide(p, 3e-3) < ours(high):
            yield f"peak force above {value:.4g} N: {ours(value):.4g} integrated, {theirs(value):.4g} drawn"
    own, other = integrated.peak_force.mean, drawn.peak_force.mean
    if math.isfinite(own) and math.isfinite(other):
        error = _STANDARD_ERRORS * drawn.peak_force.sd / math.sqrt(runs)
        if abs(own - other) > error + 2e-3 * own + 1e-3:
            yield f"mean peak force: {own:.5g} N integrated, {other:.5g} N drawn"


def _differences_of_batch(scenario: bs.Scenario, single: bs.CollisionResult) -> Iterator[str]:
    problem = single.problem
    batch = bs.evaluate_batch(problem, [problem.q], [problem.velocity], probabilities=_PROBABILITIES)
    force = single.peak_force
    scale = force.mean if math.isfinite(force.mean) else force.quantile(0.5)
    figures = [("mean", force.mean, batch.mean[0])]
    figures += [
        (f"p{100 * p:g}", force.quantile(p), own) for p, own in zip(_PROBABILITIES, batch.quantile[0], strict=True)
    ]
    for name, own, other in figures:
        if own != other and not abs(own - other) <= _OF_BATCH * scale + 1e-3:
            yield f"{name} of the peak force: {own:.5g} N alone, {other:.5g} N in a batch"
