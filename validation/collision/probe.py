"""Figures of all examples, printed as JSON, for a comparison between processes with different kernels.

``BUMPSTOP_TARGET=baseline python -m validation.collision.probe RUNS TRAJECTORY_RUNS POSES`` prints exact figures of
every example, the ticks of RUNS sampled runs (TRAJECTORY_RUNS along a trajectory), figures of POSES batch
distributions, and digests of sampled runs and of batch distributions with one and with two threads.
"""

from __future__ import annotations

import hashlib
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

import bumpstop as bs
from bumpstop import _native

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "examples").glob("*.toml"))

# Below this a tail is where curves are cut.
NEGLIGIBLE = 1e-15


def figures(result: bs.CollisionResult) -> dict[str, float | None]:
    """Every figure of a distribution under a name."""
    found: dict[str, float | None] = {}
    for name, quantity in (
        ("peak force", result.peak_force),
        ("force at detection", result.force_at_detection),
        ("detection delay", result.detection_delay),
        ("contact time", result.contact_duration),
    ):
        if quantity is not None:
            found |= {f"{name}, {figure}": value for figure, value in quantity.to_json().items()}
    found |= {f"P(joint {j})": float(p) for j, p in enumerate(result.trigger_joint_probability, start=1)}
    found["P(several)"] = result.multi_joint_probability
    found["P(false alarm)"] = result.false_alarm_probability
    return found


def tails(result: bs.CollisionResult) -> dict[str, tuple[float, float]]:
    """P(peak force > x) at many x, and how steep it is: its relative change over a relative change of x."""
    found: dict[str, tuple[float, float]] = {}
    step = 1e-4
    for x in np.linspace(0.5, 1.5, 41) * result.peak_force.quantile(0.5):
        x = float(f"{x:.1f}")  # the same in every process
        p, beyond = result.peak_force.exceedance(x), result.peak_force.exceedance(x * (1 + step))
        if beyond > NEGLIGIBLE:
            found[f"P(peak force > {x:g} N)"] = (p, math.log(p / beyond) / step)
    return found


def digest(arrays: dict[str, Any]) -> str:
    """A fingerprint of arrays, bit by bit."""
    total = hashlib.sha256()
    for name in sorted(arrays):
        total.update(name.encode())
        total.update(np.ascontiguousarray(arrays[name]).tobytes())
    return total.hexdigest()


def probe(runs: int, trajectory_runs: int, poses: int) -> dict[str, Any]:
    """Everything that is compared, as plain values."""
    scenarios = {path.stem: bs.load_scenario(path) for path in EXAMPLES}
    exact = {name: bs.evaluate(scenario) for name, scenario in scenarios.items()}
    sampled: dict[str, list[str]] = {}
    ticks: dict[str, list[int]] = {}
    for name, scenario in scenarios.items():
        count = trajectory_runs if scenario.motion.kind == "trajectory" else runs
        laws = [bs.evaluate(scenario, samples=count, seed=8, threads=threads) for threads in (1, 2)]
        sampled[name] = [digest(result.runs or {}) for result in laws]
        assert laws[0].runs is not None
        ticks[name] = laws[0].runs["tick"][:1000].tolist()
    scenario = scenarios["01_hand_downward"]
    robot = bs.Robot.load(scenario.robot)
    rng = np.random.default_rng(8)
    q = rng.uniform(robot.lower, robot.upper, size=(poses, robot.dof))
    velocity = rng.normal(0, 0.01, size=(poses, 3))
    batches = [
        vars(bs.evaluate_batch(scenario, q, velocity, limits_N=[50.0, 135.0], threads=threads)) for threads in (1, 2)
    ]
    return {
        "target": _native.target,
        "figures": {name: figures(result) for name, result in exact.items()},
        "tails": {name: tails(result) for name, result in exact.items()},
        "ticks": ticks,
        "sampled": sampled,
        "batch": [digest(laws) for laws in batches],
        "batch_figures": {name: batches[0][name].ravel().tolist() for name in ("mean", "sd", "quantile", "exceedance")},
    }


if __name__ == "__main__":
    print(json.dumps(probe(*(int(argument) for argument in sys.argv[1:]))))
