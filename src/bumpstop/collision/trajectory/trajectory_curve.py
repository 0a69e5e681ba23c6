"""Stopping curves of contacts that begin on a joint trajectory."""

from __future__ import annotations

from typing import Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.collision.curve import StoppingCurve
from bumpstop.collision.problem import CollisionProblem
from bumpstop.collision.trajectory.onset import approach, trajectory_of
from bumpstop.kernels import core


class _Reactions:
    """The reactions of one contact, in the manner of the kernels' stopping curve."""

    def __init__(self, kernel: Any, begin: float, normal: FloatArray) -> None:
        self._kernel, self._begin, self._normal = kernel, begin, normal

    def reaction_paths(self, ticks: list[int], return_to: list[float]) -> list[FloatArray]:
        """Distances [m] after every simulation step of the reactions to ticks, until contact is over."""
        return [self._kernel.reaction_distances(tick, self._begin, self._normal) for tick in ticks]


def trajectory_kernel(problem: CollisionProblem) -> Any:
    """The motion and the reactions to every tick of it, for the kernels."""
    trajectory, scenario = trajectory_of(problem), problem.scenario
    link, point = problem.contact_point
    return core.Trajectory(
        chain=problem.robot.chain,
        time=np.ascontiguousarray(trajectory.time),
        coefficient=trajectory.coefficients,
        contact_link=link,
        contact_point=np.ascontiguousarray(point),
        step=scenario.simulation.step_s,
        substeps=scenario.simulation.substeps,
        acceleration=problem.joint_acceleration,
        period=problem.period_steps,
        latency=problem.latency_steps,
        reverse=scenario.reaction.kind == "reverse",
    )


def trajectory_curve(problem: CollisionProblem, kernel: Any, begin: float) -> StoppingCurve:
    """The stopping curve of a contact that begins at a time of the trajectory [s].

    Distances are those from the place of contact and never above zero before it.
    """
    normal, speed = approach(problem, np.array([begin]))
    traced = kernel.curve(begin, normal[0])
    step = problem.scenario.simulation.step_s
    index = np.arange(kernel.ticks) * problem.period_steps + 1
    distance = traced["distance"]
    return StoppingCurve(
        kernel=_Reactions(kernel, begin, normal[0]),
        tick_time=index * step,
        tick_distance=distance[index],
        farthest=traced["farthest"],
        torque_per_newton=traced["torque_per_newton"],
        # A reaction may begin a latency after the end, where the arm stands.
        distance=np.append(distance, np.full(problem.latency_steps, distance[-1])),
        start=traced["start"],
        normal=normal[0],
        approach_speed=float(speed[0]),
        end="trajectory",
        end_joint=None,
    )
