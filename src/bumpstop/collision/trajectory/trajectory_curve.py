"""Stopping curves of contacts that begin on a joint trajectory."""

from __future__ import annotations

import numpy as np

from bumpstop import _native
from bumpstop.collision.curve import StoppingCurve, TrajectoryReactions
from bumpstop.collision.problem import CollisionProblem
from bumpstop.collision.trajectory.onset import approach, trajectory_of


def trajectory_kernel(problem: CollisionProblem) -> _native.Trajectory:
    """The motion and the reactions to every tick of it, compiled."""
    trajectory = trajectory_of(problem)
    return _native.Trajectory(problem.setup, np.ascontiguousarray(trajectory.time), trajectory.coefficients)


def trajectory_curve(problem: CollisionProblem, kernel: _native.Trajectory, begin: float) -> StoppingCurve:
    """The stopping curve of a contact that begins at a time of the trajectory [s].

    Distances are those from the place of contact and never above zero before it.
    """
    normal, speed = approach(problem, np.array([begin]))
    traced = kernel.curve(begin, normal[0].tolist())
    step = problem.scenario.simulation.step_s
    index = np.arange(kernel.ticks) * problem.period_steps + 1
    distance = traced.distance
    return StoppingCurve(
        kernel=TrajectoryReactions(kernel, begin, normal[0]),
        tick_time=np.asarray(index * step, dtype=np.float64),
        tick_distance=distance[index],
        max_distance=traced.max_distance,
        torque_per_newton=traced.torque_per_newton,
        distance=distance,
        start=traced.start,
        normal=normal[0],
        approach_speed=float(speed[0]),
        end="trajectory",
        end_joint=None,
    )
