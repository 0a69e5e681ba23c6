"""One collision in time, of an arm or a body that gives way."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop import _native
from bumpstop.collision.curve import TrajectoryReactions

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision.curve import StoppingCurve
    from bumpstop.collision.problem import CollisionProblem


def arm_in_contact(problem: CollisionProblem, curve: StoppingCurve, distance: float) -> _native.ElasticArm:
    """The arm, linear about the pose in which its reference has come so far [m]; without joints where it is rigid."""
    if not problem.elastic:
        return _native.ElasticArm()
    if not isinstance(curve.kernel, TrajectoryReactions):
        return curve.line.elastic_arm(distance)
    trajectory, onset = problem.trajectory, curve.kernel.onset
    assert trajectory is not None
    assert problem.setup.arm is not None
    q, qd = (np.ascontiguousarray(trajectory.at(onset, order)).reshape(-1) for order in (0, 1))
    tick = min(int(np.searchsorted(curve.tick_time, onset, side="right")), curve.ticks - 1)
    lever = np.ascontiguousarray(curve.torque_per_newton[tick])
    return _native.ElasticArm(problem.robot.chain, problem.setup.arm, q, lever, qd / curve.approach_speed)


def contact_course(
    problem: CollisionProblem, curve: StoppingCurve, path: FloatArray, offset: float, reaction: int
) -> _native.ContactCourse:
    """Force [N] and noiseless residuals [Nm] after every simulation step.

    Args:
        problem: whose arm and body meet.
        curve: of its motion.
        path: distance of the reference along the normal at every simulation step (steps,) [m].
        offset: where the body stands at rest [m].
        reaction: the step with which the reaction begins, the last one of ``path`` that is undisturbed.
    """
    arm = arm_in_contact(problem, curve, offset)
    step = problem.scenario.simulation.step_s
    return _native.contact_course(arm, problem.contact.body, step, np.ascontiguousarray(path), offset, reaction)
