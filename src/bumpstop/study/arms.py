"""Rates of many poses and directions of one arm at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import Problem


@dataclass(frozen=True, eq=False)
class Arms:
    """Many poses and velocities of one scenario's arm.

    Attributes:
        problem: says all else.
        q: (N, dof) [rad or m].
        velocity: of the tip, base frame (N, 3) [m/s].
    """

    problem: Problem
    q: FloatArray
    velocity: FloatArray

    def unlimited_rates(self, q: FloatArray) -> FloatArray:
        """Least-norm joint rates that move the tip with ``velocity`` from ``q`` (N, dof) [rad/s or m/s].

        Velocity limits are not looked at. Not finite where the pose is singular and motion.damping is 0.
        """
        problem, robot = self.problem, self.problem.robot
        motion = problem.scenario.motion
        free = [j for j in range(robot.dof) if j not in problem.held]
        link, point = robot.frame(None)
        jacobian = robot.chain.jacobians(np.ascontiguousarray(q), link, point)[:, :, free]
        wanted = np.zeros((len(q), 6))
        wanted[:, :3] = self.velocity
        if motion.task == "position":
            jacobian, wanted = jacobian[:, :3], wanted[:, :3]
        gram = jacobian @ jacobian.transpose(0, 2, 1) + motion.damping**2 * np.eye(jacobian.shape[1])
        rates = np.zeros_like(q)
        if jacobian.shape[1] == jacobian.shape[2] and motion.damping == 0:
            rates[:, free] = _solve(jacobian, wanted)
        else:
            rates[:, free] = np.einsum("nij,ni->nj", jacobian, _solve(gram, wanted))
        return rates

    def linear_jacobian(self, q: FloatArray) -> FloatArray:
        """J_v of the contact point, base frame (N, 3, dof)."""
        link, point = self.problem.contact_point
        return np.asarray(self.problem.robot.chain.jacobians(np.ascontiguousarray(q), link, point)[:, :3])


def _solve(matrix: FloatArray, target: FloatArray) -> FloatArray:
    """Solutions (N, rows); not finite where a matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, target[..., None])[..., 0])
    except np.linalg.LinAlgError:
        whole = np.abs(np.linalg.det(matrix)) > 0
        out = np.full_like(target, np.nan)
        out[whole] = np.linalg.solve(matrix[whole], target[whole][..., None])[..., 0]
        return out
