"""Stops whose greatest distance is where the arm stands, after a number of sub-steps that rounding decides."""

from __future__ import annotations

import numpy as np

import bumpstop as bs
from bumpstop.collision import evaluate_batch
from bumpstop.collision.problem import CollisionProblem

STOPS = bs.Scenario.from_dict(
    {
        "robot": "ur10",
        "pose_rad": [-5.178, -1.6755, -4.1299, 5.9068, 1.488, -1.8936],
        "motion": {"velocity_mm_s": [-136.3, 36.5, -92.3], "duration_s": 0.3},
        "contact": {"body": "chest", "limits": "ts15066", "offset_law": "half_normal"},
        "detector": {
            "thresholds_Nm": [34.0, 34.0, 16.0, 6.6, 6.6, 6.6],
            "noise_sd_Nm": [5.2, 5.2, 2.5, 1.0, 1.0, 1.0],
        },
        "reaction": {
            "kind": "stop",
            "deceleration": "constant_time",
            "stopping_time_s": 0.1,
            "joint_acceleration_rad_s2": 10.16,
        },
        "simulation": {"step_s": 0.0005, "substeps": 1},
    }
)


def test_batches_tell_what_single_collisions_do() -> None:
    """Forces from tick to tick were interpolated through peaks that were none: 10 % too low, or 70 % too high."""
    problem = CollisionProblem.from_scenario(STOPS)
    q = problem.q + 1e-3 * np.random.default_rng(1).normal(size=(24, 6))
    velocity = np.tile(problem.velocity, (len(q), 1))
    batch = evaluate_batch(problem, q, velocity, probabilities=[0.01, 0.5, 0.99])
    for row, pose in enumerate(q):
        single = bs.evaluate(STOPS.with_values({"pose_rad": pose.tolist()})).peak_force
        expected = [single.quantile(p) for p in (0.01, 0.5, 0.99)]
        np.testing.assert_allclose(batch.quantile[row], expected, rtol=1e-5)
