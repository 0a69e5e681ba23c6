"""Stopping curves: where the contact point is at every tick, and how far it gets if the arm reacts there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.collision.problem import CollisionProblem
from bumpstop.errors import InputError
from bumpstop.kernels import core

# Ends of a line at which the arm comes to rest; at the others it would go on.
AT_REST = ("joint_limit", "singularity")


@dataclass(frozen=True, eq=False, repr=False)
class StoppingCurve:
    """Where the contact point is at every feedback tick, and the farthest it still gets if the arm reacts there.

    Attributes:
        kernel: the kernels' curve.
        tick_time: (ticks,) [s] after the start of the motion.
        tick_distance: s(k), (ticks,) distance along the contact normal [m].
        farthest: s_stop(k), (ticks,) [m].
        torque_per_newton: a(k) = J_v' n, (ticks, dof): residual per newton of contact force [Nm/N or 1].
        distance: (steps + 1,) distance after every simulation step [m]; entry 0 is the start.
        start, normal: contact point at the start [m] and contact normal, base frame (3,).
        approach_speed: of the contact point along the normal at full speed [m/s].
        end: why the curve ends: ``"horizon"``, ``"joint_limit"``, ``"singularity"``, ``"certain_detection"`` or
            ``"trajectory"``, with the trajectory.
        end_joint: the joint at its limit, from 1, or None.
    """

    kernel: Any
    tick_time: FloatArray
    tick_distance: FloatArray
    farthest: FloatArray
    torque_per_newton: FloatArray
    distance: FloatArray
    start: FloatArray
    normal: FloatArray
    approach_speed: float
    end: Literal["horizon", "joint_limit", "singularity", "certain_detection", "trajectory"]
    end_joint: int | None

    def __repr__(self) -> str:
        """How long it is, and why it ends."""
        return f"StoppingCurve({self.ticks} ticks, {1e3 * self.distance[-1]:.4g} mm, end={self.end!r})"

    @property
    def ticks(self) -> int:
        """Number of feedback ticks."""
        return int(self.tick_time.size)


def stopping_curve(problem: CollisionProblem, *, whole: bool = False) -> StoppingCurve:
    """Trace the motion of a problem and the reaction to every feedback tick.

    Args:
        problem: a checked scenario.
        whole: trace to the end of the motion. By default the curve ends where even the farthest body would have been
            noticed for certain, which is all that a law needs.

    Raises:
        InputError: what is given is no problem, or its motion is a trajectory, which has such a curve for every time of
            contact.
    """
    if not isinstance(problem, CollisionProblem):
        raise InputError(
            "problem", f"a {type(problem).__name__} is no checked one", "wanted CollisionProblem.from_scenario(...)"
        )
    if problem.trajectory is not None:
        raise InputError("motion.kind", "a trajectory has a stopping curve for every time of contact", "wanted 'line'")
    kernel = problem.setup.trace(
        problem.q,
        problem.velocity,
        None if whole else _certain_detector(problem),
        problem.stiffness,
        problem.largest_offset,
        problem.moving_mass,
    )
    period, step = problem.period_steps, problem.scenario.simulation.step_s
    distance = kernel.distance
    index = np.arange(kernel.ticks) * period + 1
    return StoppingCurve(
        kernel=kernel,
        tick_time=index * step,
        tick_distance=distance[index],
        farthest=kernel.farthest,
        torque_per_newton=kernel.torque_per_newton,
        distance=distance,
        start=kernel.start,
        normal=kernel.normal,
        approach_speed=kernel.approach_speed,
        end=kernel.end,
        end_joint=kernel.end_joint + 1 if kernel.end == "joint_limit" else None,
    )


def _certain_detector(problem: CollisionProblem) -> Any:
    """A detector that alarms for certain only where the problem's does.

    Measured noise is neither centred nor white nor Gaussian: a tick is certain to alarm where each row of the record
    does, and the number of ticks says nothing.
    """
    record = problem.residuals
    if record is None:
        return problem.detector
    low, high = record.rows.min(axis=0), record.rows.max(axis=0)
    return core.Detector(
        threshold=problem.thresholds + (high - low) / 2,
        sd=np.zeros_like(low),
        mean=(high + low) / 2,
        arming_delay=problem.scenario.detector.arming_delay_s,
        correlation=0.0,
        filter=problem.observer_memory,
    )
