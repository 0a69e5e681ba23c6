"""What drives press a held body with that a trajectory meets and no detector feels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.collision.arm.pressing_limit import Drives, PressingLimit, knows_torque_limits
from bumpstop.collision.problem import CollisionProblem
from bumpstop.collision.trajectory.onset import trajectory_of
from bumpstop.collision.trajectory.trajectory import point_motion, point_places

# Poses of a trajectory that are looked at, at most: the levers change little between them.
_MAX_POSES = 1000


@dataclass(frozen=True, eq=False)
class UndetectedForces:
    """What bounds the forces of collisions that are never detected.

    Attributes:
        rests: the arm stands at the end of its trajectory, and presses with no more than its path gives.
        most: that the drives press with, of each onset (onsets,) [N]; infinite: nobody knows.
        limit: the greatest of it; None where an onset has no bound.
    """

    rests: bool
    most: FloatArray
    limit: PressingLimit | None

    @property
    def bounded(self) -> bool:
        """Whether every such force has a bound."""
        return self.rests or self.limit is not None

    def of(self, path: FloatArray) -> FloatArray:
        """Forces (onsets,) [N] of those that have ``path`` [N] up to the end of the trajectory.

        An arm that moves on there presses as hard as its drives can.
        """
        return np.minimum(path, self.most) if self.rests or self.limit is None else self.most

    def at(self, begin: FloatArray, times: FloatArray) -> UndetectedForces:
        """The same of other onsets ``times`` (N,) [s], between those at ``begin`` (onsets,) [s], ascending."""
        if self.limit is None:
            return UndetectedForces(self.rests, np.full(len(times), math.inf), None)
        return UndetectedForces(self.rests, np.interp(times, begin, self.most), self.limit)


def undetected_forces(problem: CollisionProblem, begin: FloatArray, normal: FloatArray) -> UndetectedForces:
    """Of collisions that begin at times of the trajectory.

    The greatest of all poses counts at which the reference is beyond the place of contact, as
    :func:`~bumpstop.collision.arm.pressing_limit.pressing_limit` has it of a line.

    Args:
        problem: of a trajectory.
        begin: times (onsets,) [s].
        normal: unit vectors into the body (onsets, 3), base frame.

    Raises:
        InputError: the inertia of a link is not known.
    """
    trajectory, robot, point = trajectory_of(problem), problem.robot, problem.contact_point
    rests, unknown = not trajectory.stops_short, np.full(len(begin), math.inf)
    if not knows_torque_limits(problem) or not len(begin):
        return UndetectedForces(rests, unknown, None)
    period = problem.period_steps * problem.scenario.simulation.step_s
    count = min(_MAX_POSES, math.ceil(trajectory.duration / period) + 1)
    poses = np.linspace(0.0, trajectory.duration, count)

    def states(t: FloatArray) -> tuple[Drives, FloatArray]:
        _, jacobian = point_motion(trajectory, robot, point, t)
        return Drives.at(problem, trajectory.at(t), trajectory.at(t, 1)), jacobian

    # At the touch itself, and at all poses after it.
    own, jacobian = states(begin)
    static, joint, most = own.press(np.einsum("nij,ni->nj", jacobian, normal))
    drives, jacobian = states(poses)
    place, origin = point_places(trajectory, robot, point, poses), point_places(trajectory, robot, point, begin)
    for i, direction in enumerate(normal):
        beyond = np.flatnonzero((poses > begin[i]) & ((place - origin[i]) @ direction > 0))
        if not beyond.size:
            continue
        of_pose: tuple[FloatArray, npt.NDArray[np.int64], FloatArray] = drives.press(
            np.einsum("nij,i->nj", jacobian[beyond], direction), beyond
        )
        worst = int(of_pose[2].argmax())
        static[i] = max(static[i], of_pose[0].max())
        if of_pose[2][worst] > most[i]:
            joint[i], most[i] = of_pose[1][worst], of_pose[2][worst]
    limit = PressingLimit.greatest(static, joint, most)
    return UndetectedForces(rests, unknown if limit is None else most, limit)
