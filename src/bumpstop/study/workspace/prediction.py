"""Peak forces foretold from the pose alone: an expected value and an upper bound, without tracing a motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.collision import CollisionProblem
from bumpstop.errors import InputError
from bumpstop.kernels import core

if TYPE_CHECKING:
    from bumpstop.collision import Scenario


@dataclass(frozen=True, eq=False)
class Prediction:
    """What is foretold of every pose; NaN where the start is singular, infinite where no joint feels the contact.

    Attributes:
        expected: mean peak force (N,) [N].
        bound: peak force (N,) [N] passed with a probability of at most 1 - ``quantile``.
        quantile: of the bound.
        unnoticed: the largest force along the motion that no threshold notices, min_j theta_j / |a_j| (N,) [N].
        trigger: the joint that notices it, from 0 (N,).
        gain: largest joint rate per speed of the tip (N,) [rad/m].
        stopping: travel expected between the tick of detection and the farthest point (N,) [m].
        trusted: (N,) whether the formula holds: the joints can follow the line, do not turn much on the way, and meet
            no limit before the arm must have noticed. Elsewhere ``expected`` is a guess and ``bound`` infinite.
        approach: speed of the contact point along the normal (N,) [m/s].
    """

    expected: FloatArray
    bound: FloatArray
    quantile: float
    unnoticed: FloatArray
    trigger: npt.NDArray[np.int64]
    gain: FloatArray
    stopping: FloatArray
    trusted: npt.NDArray[np.bool_]
    approach: FloatArray


def predict(scenario: Scenario, *, quantile: float = 0.999) -> Prediction:
    """Foretell the peak force of one scenario, N = 1; see :func:`predict_batch`."""
    problem = CollisionProblem.from_scenario(scenario)
    check_foretold(problem, quantile)
    return _predict(problem, problem.q[None], problem.velocity[None], quantile)


def predict_batch(
    scenario: Scenario, q: npt.ArrayLike, velocity: npt.ArrayLike, *, quantile: float = 0.999
) -> Prediction:
    """Foretell the peak forces of many poses and velocities; all else is as in ``scenario``.

    Args:
        scenario: a straight line into clamped contact; its pose and velocity are replaced.
        q: joint positions (N, dof) [rad or m].
        velocity: of the tip, base frame (N, 3) [m/s].
        quantile: of the bound.

    Raises:
        InputError: a shape or value cannot be used, or nothing is foretold for such a scenario.
    """
    problem = CollisionProblem.from_scenario(scenario)
    check_foretold(problem, quantile)
    poses = as_float_array(q, "q", (None, problem.robot.dof))
    return _predict(problem, poses, as_float_array(velocity, "velocity", (len(poses), 3)), quantile)


def check_foretold(problem: CollisionProblem, quantile: float) -> None:
    """Refuse a scenario or quantile for which nothing is foretold.

    Raises:
        InputError: names the key.
    """
    scenario = problem.scenario
    if not 0.5 <= quantile <= 1 - 1e-9:
        raise InputError("quantile", f"{quantile:g} cannot be used", "wanted 0.5 to 0.999999999")
    if problem.trajectory is not None:
        raise InputError("motion.kind", "'trajectory' is not predicted", "wanted 'line'")
    if scenario.contact.kind == "free":
        raise InputError("contact.kind", "'free' is not predicted", "wanted 'clamped'")
    if problem.residuals is not None:
        raise InputError("detector.residuals", "measured noise is not predicted", "give detector.noise_sd_Nm")
    if problem.first_armed_tick > 0:
        raise InputError("detector.arming_delay_s", "a detector that is armed late is not predicted", "wanted 0")
    if not np.isfinite(problem.thresholds).any():
        raise InputError("detector.thresholds_Nm", "watch no joint", "give one a finite threshold")


def _predict(problem: CollisionProblem, q: FloatArray, velocity: FloatArray, quantile: float) -> Prediction:
    found = foretold_scenario(problem, quantile).foretell(np.ascontiguousarray(q), np.ascontiguousarray(velocity))
    return Prediction(quantile=quantile, **found)


def foretold_scenario(problem: CollisionProblem, quantile: float) -> Any:
    """All but pose and velocity for the kernels, where everything is worked out: include/bumpstop/study."""
    contact = problem.scenario.contact
    half_normal = contact.offset_law == "half_normal"
    return core.ForetoldScenario(
        setup=problem.setup,
        detector=problem.detector,
        stiffness=problem.stiffness,
        offset_kind=contact.offset_law,
        offset_size=contact.offset_sd_s if half_normal else (contact.offset_mm or 0.0) / 1e3,
        quantile=quantile,
    )
