"""Forces predicted at poses of the workspace, in the direction of the motion and in the worst one, as predictors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop import _native
from bumpstop.detection.sensitivity import residual_band
from bumpstop.errors import InputError
from bumpstop.study.prediction import check_predictable, predict_poses

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionProblem

# What a predictor is called in the summary, its column, and whether large values predict small forces.
_PREDICTORS = {
    "bound": ("bound_N", False),
    "expected_force": ("expected_N", False),
    "bound_in_worst_direction": ("worst_bound_N", False),
    "expected_force_in_worst_direction": ("worst_expected_N", False),
    "undetectable_force_in_worst_direction": ("worst_undetectable_N", False),
    "condition_number": ("condition_number", False),
    "smallest_singular_value": ("smallest_singular_value", True),
    "condition_number_six_rows": ("condition_number_six_rows", False),
    "smallest_singular_value_six_rows": ("smallest_singular_value_six_rows", True),
}


def check(problem: CollisionProblem) -> None:
    """Reject a scenario that cannot be predicted.

    Raises:
        InputError: names the key.
    """
    try:
        check_predictable(problem, quantile_of(problem))
    except InputError as error:
        raise InputError("--predict", f"is not possible here: {error}", "leave it out") from None


def quantile_of(problem: CollisionProblem) -> float:
    """Of the bound: what is left of certainty by verdict.accepted_probability."""
    return min(max(0.5, 1 - problem.scenario.verdict.accepted_probability), 1 - 1e-9)


def predicted_columns(problem: CollisionProblem, q: FloatArray, velocity: FloatArray) -> dict[str, Any]:
    """Expected peak force and bound of every pose, along its velocity and as fast in the worst direction.

    That direction leads to the farthest vertex of the polytope of undetectable forces, see
    :func:`bumpstop.detection.undetectable_forces`. Where some direction loads no joint, it is one of those.

    Args:
        problem: all but pose and velocity.
        q: (N, dof) [rad or m].
        velocity: of the tip, base frame (N, 3) [m/s].

    Returns:
        Columns of N values: ``expected_N``, ``bound_N``, ``trusted``; ``worst_{x,y,z}``, a unit vector in the base
        frame; ``worst_undetectable_N``; ``worst_expected_N``, ``worst_bound_N``, ``worst_trusted``.
    """
    worst, undetectable = worst_directions(problem, q)
    speed = np.linalg.norm(velocity, axis=1)[:, None]
    along = predict_poses(problem, q, velocity, quantile_of(problem))
    across = predict_poses(problem, q, worst * speed, quantile_of(problem))
    columns: dict[str, Any] = {"expected_N": along.expected, "bound_N": along.bound, "trusted": along.trusted}
    columns |= {f"worst_{axis}": worst[:, i] for i, axis in enumerate("xyz")}
    columns["worst_undetectable_N"] = undetectable
    columns |= {"worst_expected_N": across.expected, "worst_bound_N": across.bound, "worst_trusted": across.trusted}
    return columns


def worst_directions(problem: CollisionProblem, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors (N, 3) along which the largest forces stay undetected, and these forces (N,) [N]; infinite: any."""
    link, point = problem.contact_point
    low, high = residual_band(problem.robot.dof, problem.thresholds, noise_mean=problem.noise_mean)
    jacobian = problem.robot.chain.jacobians(np.ascontiguousarray(q), link, point)[:, :3]
    largest, _, largest_vector, _, rank, axes = _native.undetectable_forces(np.ascontiguousarray(jacobian), low, high)
    length = np.linalg.norm(largest_vector, axis=1)
    undetectable = axes[np.arange(len(q)), np.minimum(rank, 2)]
    safe = np.where(length > 0, length, 1.0)[:, None]
    return np.where(((rank < 3) | ~(length > 0))[:, None], undetectable, largest_vector / safe), np.asarray(largest)


def predictors(rows: pl.DataFrame, unsafe: Any, lowest_limit: float) -> dict[str, dict[str, float]]:
    """How well each predictor tells unsafe poses from safe ones.

    The bound is cut at the limit itself, which needs no law. The others are cut where the sum of both shares of errors
    is least, with all distributions known: no cut does better.

    Args:
        rows: of poses with a law.
        unsafe: (N,) whether a limit is passed more often than accepted.
        lowest_limit: peak force at which the first limit is passed [N].

    Returns:
        By predictor ``rank_correlation`` with the median force, ``cut``, ``unsafe_missed`` and ``safe_refused`` as
        shares of unsafe and of safe poses.
    """
    found = {}
    for name, (column, falls) in _PREDICTORS.items():
        value = np.nan_to_num(rows[column].to_numpy(), nan=np.inf, posinf=np.inf)
        sign = -1.0 if falls else 1.0
        cut = lowest_limit if name == "bound" else sign * _best_cut(sign * value, unsafe)
        refused = sign * value > sign * cut
        found[name] = {
            "rank_correlation": rank_correlation(value, rows["p50_N"].to_numpy()),
            "cut": cut,
            "unsafe_missed": _share(~refused, unsafe),
            "safe_refused": _share(refused, ~unsafe),
        }
    return found


def rank_correlation(x: FloatArray, y: FloatArray) -> float:
    """Spearman's; unbounded values rank highest, whatever they are. NaN for fewer than three."""
    import polars as pl

    if x.size < 3:
        return float("nan")
    ranked = pl.DataFrame({"x": np.minimum(x, 1e300), "y": np.minimum(y, 1e300)})
    return float(ranked.select(pl.corr("x", "y", method="spearman")).item())


def _best_cut(value: FloatArray, unsafe: Any) -> float:
    order = np.argsort(value)
    missed = np.cumsum(unsafe[order]) / max(1, unsafe.sum())
    refused = 1 - np.cumsum(~unsafe[order]) / max(1, (~unsafe).sum())
    # Equal values are on one side of any cut, as where much is predicted without bound.
    ranked = value[order]
    last = np.append(ranked[1:] != ranked[:-1], True)
    return float(ranked[int(np.argmin(np.where(last, missed + refused, np.inf)))])


def _share(which: Any, of: Any) -> float:
    return float((which & of).sum() / of.sum()) if of.any() else float("nan")
