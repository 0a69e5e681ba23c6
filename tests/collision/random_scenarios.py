"""Random scenarios, most of them with few sub-steps, and what becomes of them.

``python -m collision.random_scenarios FIRST COUNT`` computes that many, each from its own seed, and prints a line of
JSON for each: whoever reads it knows at which it stood still. ``--one-sub-step`` has nothing but those.
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import tempfile
import time
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

import bumpstop as bs
from bumpstop import CollisionProblem, Robot, Scenario
from bumpstop.errors import InputError
from bumpstop.model import Joint, write_urdf
from bumpstop.study.prediction import predict_batch

# No scenario here takes a hundredth of that.
MAX_DURATION_S = 30.0


@cache
def random_robot_file(number: int, folder: Path) -> Path:
    """A URDF of a general arm, as often as not one whose neighbouring axes are parallel or at right angles."""
    rng = np.random.default_rng([17, number])
    industrial = rng.random() < 0.5
    joints = []
    for j in range(int(rng.choice([6, 7]))):
        axis = np.eye(3)[rng.integers(3)] if industrial else rng.normal(size=3)
        joints.append(
            Joint(
                name=f"joint_{j}",
                link=f"link_{j}",
                kind="prismatic" if rng.random() < 0.05 else "revolute",
                origin=tuple(rng.uniform(-0.4, 0.4, 3) * (rng.random(3) < 0.7)),
                axis=tuple(axis / np.linalg.norm(axis)),
                lower=-3.0,
                upper=3.0,
                velocity=float(rng.choice([1.0, 3.0, 100.0])),
            )
        )
    path = folder / f"arm_{number}.urdf"
    write_urdf(Robot(name=f"arm_{number}", joints=tuple(joints), tip_origin=(0.0, 0.05, 0.1)), path)
    return path


def random_scenario(seed: int, folder: Path, *, one_sub_step: bool = False) -> Scenario:
    """Arms of every kind, at rest or under way; steps, sub-steps, limits and tasks of every size."""
    rng = np.random.default_rng([29, seed])
    name = str(rng.choice(bs.robots())) if rng.random() < 0.7 else str(random_robot_file(int(rng.integers(20)), folder))
    robot = Robot.load(name) if not name.endswith(".urdf") else Robot.from_urdf(name)
    pose = rng.uniform(np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi))
    if rng.random() < 0.1:
        pose = np.clip(np.round(pose / (np.pi / 4)) * (np.pi / 4), robot.lower, robot.upper)
    direction = rng.normal(size=3) if rng.random() < 0.8 else np.eye(3)[rng.integers(3)]
    speed = float(np.exp(rng.uniform(np.log(5), np.log(1000))))
    position = rng.random() < 0.2
    held = [int(rng.integers(robot.dof)) + 1] if robot.dof == 7 and rng.random() < 0.3 else []
    if position and rng.random() < 0.5:
        held = sorted(int(j) + 1 for j in rng.choice(robot.dof, 2, replace=False))
    step = float(rng.choice([0.0005, 0.001, 0.002, 0.004]))
    period = int(rng.choice([1, 2, 3, 4, 8])) * step
    # Round ones, at which arms reach rates exactly at the end of a sub-step, and any others.
    least, most = np.log(0.5), np.log(50)
    acceleration = np.exp(rng.uniform(least, most, robot.dof if rng.random() < 0.7 else 1))
    if rng.random() < 0.4:
        acceleration = np.round(acceleration * 2) / 2 + 0.5
    fixed = rng.random() < 0.3
    data: dict[str, Any] = {
        "robot": name,
        "pose_rad": pose.tolist(),
        "motion": {
            "velocity_mm_s": (speed * direction / np.linalg.norm(direction)).tolist(),
            "start": str(rng.choice(["rest", "moving"])),
            "duration_s": float(rng.choice([0.05, 0.3, 1.0])),
            "task": "position" if position else "pose",
            "held_joints": held,
            "damping": float(rng.choice([0.0, 0.0, 0.0, 1e-3, 0.05])),
        },
        "contact": {
            "stiffness_N_m": float(np.exp(rng.uniform(np.log(1e3), np.log(2e5)))),
            "offset_law": "fixed" if fixed else str(rng.choice(["uniform", "half_normal"])),
            **({"offset_mm": float(rng.uniform(0, 0.05 * speed))} if fixed else {"offset_sd_s": 0.05}),
        },
        "detector": {
            "thresholds_Nm": [float(rng.choice([5.0, 20.0]))] * robot.dof,
            "noise_sd_Nm": float(rng.choice([0.5, 3.0])),
            "feedback_period_s": period,
            "arming_delay_s": float(rng.choice([0.0, 0.0, 10.5 * step])),
        },
        "reaction": {
            "kind": str(rng.choice(["stop", "reverse"])),
            "joint_acceleration_rad_s2": acceleration.tolist() if len(acceleration) > 1 else float(acceleration[0]),
            "latency_s": int(rng.choice([0, 0, 1, 4, 13])) * step,
        },
        "simulation": {"step_s": step, "substeps": 1 if one_sub_step else int(rng.choice([1, 1, 2, 3, 5, 16]))},
    }
    return Scenario.from_dict(data)


def figures(scenario: Scenario, seed: int) -> dict[str, Any]:
    """Of its distribution, and of a batch with the same pose, its neighbours and others; None where there are none."""
    problem = CollisionProblem.from_scenario(scenario)
    result = bs.evaluate(scenario)
    curve = result.curve
    assert curve is not None
    rng = np.random.default_rng([31, seed])
    q = problem.q + np.array([0, 1e-3, 0.3, 1.0])[:, None] * rng.normal(size=(4, problem.robot.dof))
    q = np.clip(q, problem.robot.lower, problem.robot.upper)
    velocity = np.tile(problem.velocity, (4, 1))
    batch = bs.evaluate_batch(problem, q, velocity)
    if not scenario.detector.arming_delay_s:  # or it is refused
        predict_batch(scenario, q, velocity)
    return {
        "end": curve.end,
        "ticks": len(curve.max_distance),
        "max_distance": float(curve.max_distance.max(initial=0.0)),
        "mean": result.peak_force.mean,
        "sd": result.peak_force.sd,
        "p95": result.peak_force.quantile(0.95),
        "undetected": result.undetected_probability,
        "batch_end": batch.end.tolist(),
        "batch_mean": batch.mean.tolist(),
        "batch_p95": batch.quantile[:, 1].tolist(),
    }


# Differences below this are rounding, as of probabilities that add up to one.
NEGLIGIBLE = 1e-15
# Between sets of kernels. Their sums have other orders in places, and arms of batches, whose leaps are judged loosely,
# enlarge that beside singularities.
ALLOWED = 1e-8


def difference(one: dict[str, Any], two: dict[str, Any]) -> float:
    """The largest between the figures of a scenario on two sets of kernels: relative, of an sd to the mean."""
    if one.keys() != two.keys():
        return math.inf
    apart = [0.0]
    for name in one.keys() - {"seconds"}:
        ours, theirs = (np.atleast_1d(found[name]) for found in (one, two))
        if ours.dtype.kind != "f":
            apart.append(0.0 if ours.tolist() == theirs.tolist() else math.inf)
            continue
        finite = np.isfinite(ours)
        if (finite != np.isfinite(theirs)).any():
            return math.inf
        off, size = np.abs(ours[finite] - theirs[finite]), np.abs(ours[finite])
        if name == "sd":
            size = np.maximum(size, abs(one["mean"]))
        apart.append(float(np.where(off < NEGLIGIBLE, 0.0, off / np.maximum(size, NEGLIGIBLE)).max(initial=0.0)))
    return max(apart)


class StoodStillError(Exception):
    """A scenario took longer than any does."""


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("first", type=int)
    parser.add_argument("count", type=int)
    parser.add_argument("--one-sub-step", action="store_true")
    arguments = parser.parse_args()

    def alarm(number: int, frame: FrameType | None) -> None:
        raise StoodStillError

    signal.signal(signal.SIGALRM, alarm)
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(arguments.first, arguments.first + arguments.count):
            scenario = random_scenario(seed, Path(folder), one_sub_step=arguments.one_sub_step)
            found: dict[str, Any] = {"seed": seed}
            begin = time.monotonic()
            signal.setitimer(signal.ITIMER_REAL, MAX_DURATION_S)
            try:
                found |= figures(scenario, seed)
            except InputError as error:
                found["refused"] = str(error)
            except StoodStillError:
                found["stood_still"] = scenario.model_dump(exclude_unset=True, mode="json")
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0)
            found["seconds"] = time.monotonic() - begin
            print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
