"""Distributions as tables."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.collision.curve import states_at_reactions

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.collision.outcome import CollisionOutcome


def result_table(result: CollisionOutcome) -> pl.DataFrame:
    """The distribution as a table.

    Of the integrated distribution: one row per probability with the quantile of every quantity. Of the sampled
    result: one row per run with what Schroeder's simulator kept of it (its appendix), units in the names; joints
        are numbered from 1.
    """
    return _quantile_table(result) if result.kind == "exact" else _run_table(result)


def _quantile_table(result: CollisionOutcome) -> pl.DataFrame:
    import polars as pl

    p = np.concatenate([np.arange(1, 100) / 100, [0.995, 0.999, 0.9995, 0.9999]])
    columns = {"probability": p}
    for name, quantity in (
        ("peak_force_N", result.peak_force),
        ("force_at_detection_N", result.force_at_detection),
        ("detection_delay_s", result.detection_delay),
        ("contact_duration_s", result.contact_duration),
    ):
        if quantity is not None:
            columns[name] = np.array([quantity.quantile(float(x)) for x in p])
    factor = result.scenario.contact.peak_factor / result.scenario.contact.area_cm2
    columns["pressure_N_cm2"] = columns["peak_force_N"] * factor
    columns["compression_mm"] = columns["peak_force_N"] / result.problem.body_stiffness * 1e3
    return pl.DataFrame(columns)


def _run_table(result: CollisionOutcome) -> pl.DataFrame:
    import polars as pl

    assert result.runs is not None
    problem, curve, runs = result.problem, result.curve, result.runs
    scenario, robot = result.scenario, result.problem.robot
    offset, tick, trajectory = runs["offset"], runs["tick"], problem.trajectory
    n = tick.size
    detected = tick >= 0
    at = np.where(detected, tick, 0)
    peak = runs["peak_force"]
    nothing = np.full(n, np.nan)
    columns: dict[str, np.ndarray] = {
        "run": np.arange(n),
        **({"offset_m": offset} if trajectory is None else {"contact_onset_s": runs["onset"]}),
        "detected": detected,
        "detection_tick": tick,
        "detection_time_s": np.where(detected, curve.tick_time[at], nothing),
        "false_alarm": detected & ~runs["detected_after_contact"],
        "force_at_detection_N": np.where(detected, runs["force_at_detection"], nothing),
        "peak_force_N": peak,
        "pressure_N_cm2": peak * scenario.contact.peak_factor / scenario.contact.area_cm2,
        "compression_mm": peak / problem.body_stiffness * 1e3,
    }
    place, normal = _contacts(result)
    for i, axis in enumerate("xyz"):
        # A run without bound has none along an axis the normal has no part in either.
        share = np.abs(normal[:, i])
        columns[f"peak_force_{axis}_N"] = np.multiply(peak, share, out=np.zeros(n), where=share > 0)
        columns[f"contact_{axis}_m"] = place[:, i]
    for j in range(robot.dof):
        columns[f"triggered_{j + 1}"] = (runs["triggers"] >> np.uint32(j)) & np.uint32(1) == 1
        columns[f"residual_at_detection_{j + 1}_Nm"] = np.where(detected, runs["residual"][:, j], nothing)
        columns[f"noise_at_detection_{j + 1}_Nm"] = np.where(detected, runs["noise"][:, j], nothing)
    singular, condition = _singular_values(result, at)
    columns["condition_number_at_detection"] = np.where(detected, condition, nothing)
    for i in range(singular.shape[1]):
        columns[f"singular_value_at_detection_{i + 1}"] = np.where(detected, singular[:, i], nothing)
    constants: dict[str, float] = {
        "step_s": scenario.simulation.step_s,
        "feedback_period_s": scenario.detector.feedback_period_s,
        "stiffness_N_m": problem.stiffness,
    }
    for axis, v in zip("xyz", problem.velocity, strict=True) if trajectory is None else ():
        constants[f"velocity_{axis}_m_s"] = float(v)
    for j in range(robot.dof):
        constants[f"q_start_{j + 1}"] = float(problem.q[j])
        constants[f"joint_acceleration_{j + 1}"] = float(problem.joint_acceleration[j])
        constants[f"threshold_{j + 1}_Nm"] = float(problem.thresholds[j])
        constants[f"noise_mean_{j + 1}_Nm"] = float(problem.noise_mean[j])
        constants[f"noise_sd_{j + 1}_Nm"] = float(problem.noise_sd[j])
    table = pl.DataFrame(columns)
    return table.with_columns(pl.lit(value).alias(name) for name, value in constants.items())


def _contacts(result: CollisionOutcome) -> tuple[FloatArray, FloatArray]:
    """Where contact begins in every run [m] and the normal there, base frame (runs, 3) each."""
    assert result.runs is not None
    problem, curve, offset = result.problem, result.curve, result.runs["offset"]
    if problem.trajectory is None:
        return curve.start + offset[:, None] * curve.normal, np.tile(curve.normal, (offset.size, 1))
    from bumpstop.collision.trajectory.onset import approach

    begin, contact = result.runs["onset"], result.scenario.contact
    poses = problem.robot.pose(problem.trajectory.at(begin), contact.link, contact.point_m)
    return poses[:, :3, 3], approach(problem, begin)[0]


def _singular_values(result: CollisionOutcome, tick: np.ndarray) -> tuple[FloatArray, FloatArray]:
    """Singular values of the six-row tip Jacobian (runs, min(6, dof)) and their ratio at a tick of every run.

    As in Schroeder (2013), rotational and translational rows are mixed: the figures depend on the unit of length.
    """
    problem, curve = result.problem, result.curve
    if problem.trajectory is not None:
        q = problem.trajectory.at(np.minimum(curve.tick_time, problem.trajectory.duration))
    else:
        q, _ = states_at_reactions(problem, curve)
    values = np.linalg.svd(problem.robot.jacobian(q), compute_uv=False)
    with np.errstate(divide="ignore"):
        return values[tick], (values[:, 0] / values[:, -1])[tick]
