"""Complete integrated distributions of many poses at once."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bumpstop import _native
from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.collision.arm.pressing_limit import knows_torque_limits, undetected_force
from bumpstop.collision.curve import stopping_curve
from bumpstop.collision.problem import CollisionProblem
from bumpstop.collision.retreats import retreats_in_memory
from bumpstop.collision.scenario.scenario import Scenario, as_scenario
from bumpstop.errors import InputError

# Reasons for the end of a path by their number; 255 is a singular start.
_ENDS = {0: "motion_end", 1: "joint_limit", 2: "singularity", 3: "all_detected", 255: "singular_start"}


@dataclass(frozen=True, eq=False)
class BatchResult:
    """What is kept of the distribution of every pose; NaN where the start is singular.

    Attributes:
        mean, sd: of the peak force (N,) [N]; the mean is infinite where it has no bound.
        quantile: (N, probabilities) of the peak force [N]; infinite in the undetected share that has no bound.
        exceedance: (N, limits) P(peak force > limit); that share counts as over.
        trigger_joint_probability: (N, dof), given detection; NaN where that is too improbable to tell.
        false_alarm_probability, undetected_probability, no_contact_probability: (N,).
        end: (N,) why the path ends, as :attr:`StoppingCurve.end`, or ``"singular_start"``.
    """

    mean: FloatArray
    sd: FloatArray
    quantile: FloatArray
    exceedance: FloatArray
    trigger_joint_probability: FloatArray
    false_alarm_probability: FloatArray
    undetected_probability: FloatArray
    no_contact_probability: FloatArray
    end: npt.NDArray[np.str_]


def evaluate_batch(
    scenario: Scenario | CollisionProblem,
    q: npt.ArrayLike,
    velocity: npt.ArrayLike,
    *,
    probabilities: npt.ArrayLike = (0.5, 0.95, 0.99, 0.999),
    limits_N: npt.ArrayLike = (),
    threads: int = 1,
) -> BatchResult:
    """Compute the integrated distributions of many poses and velocities; all else is as in ``scenario``.

    Forces are those of :func:`bumpstop.evaluate` within 1e-5 of their mean; within 5e-4 where the body gives way, and
    1e-3 where the arm does.

    Args:
        scenario: its pose and velocity are replaced. A checked problem will do too: its robot counts, whose joint
            limits may be others than the scenario's.
        q: joint positions (N, dof) [rad or m]. Poses beyond the joint limits are refused.
        velocity: of the tip, base frame (N, 3) [m/s].
        probabilities: of the quantiles to return.
        limits_N: peak forces whose exceedance to return [N].
        threads: the result is the same whatever their number.

    Raises:
        InputError: a shape or value cannot be used; names the first pose.
    """
    problem = (
        scenario if isinstance(scenario, CollisionProblem) else CollisionProblem.from_scenario(as_scenario(scenario))
    )
    scenario = problem.scenario
    if problem.trajectory is not None:
        raise InputError("motion.kind", "batches are computed for straight lines only", "wanted 'line'")
    if scenario.contact.arm == "two_mass":
        raise InputError("contact.arm", "'two_mass' has another mass in every pose", "wanted 'position_driven'")
    if problem.residuals is not None:
        raise InputError(
            "detector.residuals", "measured residuals have no integrated distribution", "give detector.noise_sd_Nm"
        )
    robot = problem.robot
    poses = as_float_array(q, "q", (None, robot.dof))
    velocities = as_float_array(velocity, "velocity", (len(poses), 3))
    quantiles = as_float_array(probabilities, "probabilities", (None,))
    limits = as_float_array(limits_N, "limits_N", (None,))
    if threads < 1:
        raise InputError("threads", f"{threads} is too few", "wanted at least 1")
    if ((quantiles <= 0) | (quantiles >= 1)).any():
        raise InputError("probabilities", "are not all between 0 and 1")
    outside = robot.beyond_limits(poses)
    if outside.any():
        row, joint = (int(i) for i in np.argwhere(outside)[0])
        raise InputError(f"q[{row}]", f"joint {joint + 1} at {poses[row, joint]:g} is outside its limits")
    still = ~velocities.any(axis=1)
    if still.any():
        raise InputError(f"velocity[{int(np.flatnonzero(still)[0])}]", "is zero", "wanted a motion")
    contact = scenario.contact
    elsewhere = {
        "link": contact.link is not None,
        "point_m": any(contact.point_m),
        "normal": contact.normal is not None,
    }
    for key in (key for key, given in elsewhere.items() if given):
        raise InputError(
            f"contact.{key}", "batches are computed for contact at the tip along the motion only", "leave it out"
        )
    size = {
        "half_normal": contact.offset_sd_s,
        "uniform": problem.period_steps * scenario.simulation.step_s,
        "fixed": (contact.offset_mm or 0.0) / 1e3,
    }[contact.offset_law]
    met = _native.Contact()
    met.body = problem.contact.body
    met.offset.kind, met.offset.size = _native.OffsetKind[contact.offset_law], size
    settings = _native.BatchSettings()
    settings.probability, settings.limit, settings.threads = quantiles.tolist(), limits.tolist(), threads

    def evaluated(rows: slice | npt.NDArray[np.int64], pressed_with: FloatArray | None = None) -> _native.BatchResult:
        with retreats_in_memory():
            return _native.evaluate_batch(
                problem.setup, problem.detector, met, poses[rows], velocities[rows], settings, pressed_with
            )

    out = evaluated(slice(None))
    mean, sd, quantile, above = (np.array(each) for each in (out.mean, out.sd, out.quantile, out.exceedance))
    missed = np.flatnonzero(out.undetected > 0)
    # What drives press with takes a good part of a distribution's time, and counts in these alone.
    if missed.size and knows_torque_limits(problem):
        pressed = evaluated(missed, _pressed_with(problem, poses[missed], velocities[missed]))
        mean[missed], sd[missed] = pressed.mean, pressed.sd
        quantile[missed], above[missed] = pressed.quantile, pressed.exceedance
    names = np.array([_ENDS.get(i, "") for i in range(256)])
    # Sums over cells: rounding may take them a little beyond the ends.
    exceedance, false_alarm, undetected, no_contact = (
        np.clip(p, 0.0, 1.0) for p in (above, out.false_alarm, out.undetected, out.no_contact)
    )
    return BatchResult(
        mean=mean,
        sd=sd,
        quantile=quantile,
        exceedance=exceedance,
        trigger_joint_probability=out.trigger,
        false_alarm_probability=false_alarm,
        undetected_probability=undetected,
        no_contact_probability=no_contact,
        end=names[out.end],
    )


def _pressed_with(problem: CollisionProblem, poses: FloatArray, velocities: FloatArray) -> FloatArray:
    """What drives press a held body with that they never detect, by pose (N,) [N]; infinite where nobody knows."""
    most = np.full(len(poses), math.inf)
    for i, (q, velocity) in enumerate(zip(poses, velocities, strict=True)):
        each = replace(problem, q=q, velocity=velocity)
        most[i] = undetected_force(each, stopping_curve(each)) or math.inf
    return most
