"""Random collisions of two robots, for tests and validation of predictions."""

from __future__ import annotations

import numpy as np

import bumpstop as bs
from bumpstop.arrays import FloatArray

ROBOTS = ("sia5d", "ur10e")


def draw(rng: np.random.Generator, number: int, count: int) -> tuple[bs.Scenario, FloatArray, FloatArray]:
    """A scenario of its own stiffness, detector and reaction, and poses (count, dof) and velocities (count, 3) for it.

    Even numbers are a SIA5D with its last joint held, odd ones a UR10e.
    """
    robot = bs.Robot.load(ROBOTS[number % 2])
    thresholds = rng.uniform(8, 40, robot.dof)
    speed = rng.uniform(20, 200)
    held: list[int] = [7] if robot.dof == 7 else []
    scenario = bs.Scenario.from_dict(
        {
            "robot": robot.name,
            "pose_deg": [0, 30, 0, -20, 0, -40, 0] if robot.dof == 7 else [10, -80, 110, -120, -90, 20],
            "motion": {"velocity_mm_s": [0, 0, -50], "held_joints": held},
            "contact": {"stiffness_N_m": float(np.exp(rng.uniform(np.log(5e3), np.log(1e5))))},
            "detector": {
                "thresholds_Nm": thresholds.tolist(),
                "noise_sd_Nm": (thresholds / rng.uniform(4.5, 8)).tolist(),
                "feedback_period_s": float(rng.choice([0.002, 0.004, 0.008])),
            },
            "reaction": {
                "kind": str(rng.choice(["stop", "reverse"])),
                "joint_acceleration_rad_s2": float(rng.uniform(3, 20)),
                "latency_s": float(rng.choice([0, 0.004, 0.01])),
            },
        }
    )
    q = rng.uniform(np.maximum(robot.lower, -2 * np.pi), np.minimum(robot.upper, 2 * np.pi), (count, robot.dof))
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return scenario, q, direction * speed / 1e3 * rng.uniform(0.3, 1.5, count)[:, None]
