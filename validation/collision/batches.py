"""Distributions of many poses at once against the distribution of each pose."""

from __future__ import annotations

import math

import numpy as np

import bumpstop as bs
from bumpstop.study.directions import draw_directions
from collision.cases import control_group, ur10e
from validation.findings import Cell, Findings

TITLE = "Batches against single distributions, random poses"
POSES = 3000
LIMIT_N = 135.0
PROBABILITIES = (0.5, 0.95, 0.99, 0.999)
# Below this mean [N] next to nothing of a distribution is force, and no share of it is compared.
FELT_N = 1.0
# What a batch promises of 99 in 100 poses, of 999 in 1000, and of all.
PROMISED = {
    "mean": (1e-5, 3e-4, 1e-2),
    "sd": (1e-3, 2e-2, 3e-1),
    "exceedance": (3e-6, 5e-5, 1e-3),
    "quantile": (1e-4, 2e-3, 1e-1),
}


def compare(findings: Findings, *, quick: bool) -> None:
    """Differences of means, standard deviations, exceedances and quantiles."""
    poses = 60 if quick else POSES
    findings.say(
        "Poses are uniform inside the joint limits, directions uniform on the sphere, speeds 10 mm/s with a standard "
        "deviation of 2 mm/s, as in Schroeder's section 6.2.3. Poses near singularities are among them: there, arms "
        "that react may swing back, and which do hangs on little. Differences of means, standard deviations and "
        f"quantiles are shares of what a single distribution says, where its mean is above {FELT_N:g} N; exceedances "
        f"are those of {LIMIT_N:g} N."
    )
    rows: list[list[Cell]] = []
    for name, scenario in (("SIA5D", control_group()), ("UR10e", ur10e())):
        apart = _apart(scenario, poses)
        for figure, values in apart.items():
            shares = [float(np.quantile(values, share)) for share in (0.5, 0.99, 0.999, 1.0)]
            rows.append([f"{name}, {figure}", len(values), *shares])
            promised = PROMISED[figure]
            findings.check(
                f"{name}: {figure} within {promised[0]:g} in 99 of 100 poses, {promised[1]:g} in 999 of 1000, "
                f"{promised[2]:g} in all",
                all(found <= allowed for found, allowed in zip(shares[1:], promised, strict=True)),
                f"{shares[1]:.1e}, {shares[2]:.1e} and {shares[3]:.1e} of {len(values)}",
            )
    findings.table(
        "Differences between a batch and single distributions",
        ["Quantity", "Poses", "Median", "99 of 100", "999 of 1000", "Worst"],
        ["", "", ".1e", ".1e", ".1e", ".1e"],
        rows,
    )


def _apart(base: bs.Scenario, poses: int) -> dict[str, list[float]]:
    """Of every pose that both say something of."""
    robot = bs.Robot.load(base.robot)
    problem = bs.CollisionProblem.from_scenario(base)
    rng = np.random.default_rng(623)
    q = rng.uniform(robot.lower, robot.upper, size=(poses, robot.dof))
    for joint in base.motion.held_joints:
        q[:, joint - 1] = problem.q[joint - 1]
    direction = draw_directions("sphere", problem.velocity, poses, rng)
    velocity = direction * rng.normal(0.010, 0.002, size=(poses, 1))
    laws = bs.evaluate_batch(base, q, velocity, probabilities=PROBABILITIES, limits_N=[LIMIT_N])
    apart: dict[str, list[float]] = {figure: [] for figure in PROMISED}
    for i in range(poses):
        if laws.end[i] == "singular_start":
            continue
        one = base.with_values(
            {"pose_deg": None, "pose_rad": q[i].tolist(), "motion.velocity_mm_s": (velocity[i] * 1e3).tolist()}
        )
        result = bs.evaluate(one)
        force = result.peak_force
        apart["exceedance"].append(abs(float(laws.exceedance[i, 0]) - force.exceedance(LIMIT_N)))
        if not (math.isfinite(force.mean) and force.mean > FELT_N):
            continue
        apart["mean"].append(abs(float(laws.mean[i]) / force.mean - 1))
        apart["sd"].append(abs(float(laws.sd[i]) / force.sd - 1))
        theirs = np.array([force.quantile(p) for p in PROBABILITIES])
        told = np.isfinite(theirs) & (theirs > FELT_N)
        apart["quantile"].append(float(np.max(np.abs(laws.quantile[i][told] / theirs[told] - 1), initial=0.0)))
    return apart
