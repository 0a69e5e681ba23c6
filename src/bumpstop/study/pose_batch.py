"""Rates of many poses and directions of one arm at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionProblem


@dataclass(frozen=True, eq=False)
class PoseBatch:
    """Many poses and velocities of one scenario's arm.

    Attributes:
        problem: says all else.
        q: (N, dof) [rad or m].
        velocity: of the tip, base frame (N, 3) [m/s].
    """

    problem: CollisionProblem
    q: FloatArray
    velocity: FloatArray

    def joint_rates(self, q: FloatArray) -> FloatArray:
        """Least-norm joint rates that move the tip with ``velocity`` from ``q`` (N, dof) [rad/s or m/s].

        Velocity limits are not looked at. Not finite where the pose is singular and motion.damping is 0.
        """
        motion, free = self.problem.scenario.motion, self._free
        jacobian = self._task_jacobian(q)
        wanted = np.zeros((len(q), jacobian.shape[1]))
        wanted[:, :3] = self.velocity
        gram = jacobian @ jacobian.transpose(0, 2, 1) + motion.damping**2 * np.eye(jacobian.shape[1])
        rates = np.zeros_like(q)
        if jacobian.shape[1] == jacobian.shape[2] and motion.damping == 0:
            rates[:, free] = _solve(jacobian, wanted)
        else:
            rates[:, free] = np.einsum("nij,ni->nj", jacobian, _solve(gram, wanted))
        return rates

    def passes_singularity(self, q: FloatArray) -> npt.NDArray[np.bool_]:
        """Whether a singularity lies on the way from each of the poses ``q`` (N, dof) to the next (N - 1,).

        By the sign of det(J J_next'), which is positive for poses close together. An arm with as many joints as its
        task has rows turns it over where it passes a singularity; one with more goes round most of them, and turns it
        over where it comes nearer to one than the poses lie apart.
        """
        jacobian = self._task_jacobian(q)
        return np.asarray(np.linalg.det(jacobian[:-1] @ jacobian[1:].transpose(0, 2, 1)) <= 0)

    @property
    def _free(self) -> list[int]:
        return [j for j in range(self.problem.robot.dof) if j not in self.problem.held]

    def _task_jacobian(self, q: FloatArray) -> FloatArray:
        """Of the tip over the joints that move (N, 6 or 3, free): linear, then angular where the tip is not to turn."""
        link, point = self.problem.robot.frame(None)
        jacobian = self.problem.robot.chain.jacobians(np.ascontiguousarray(q), link, point)[:, :, self._free]
        return np.asarray(jacobian[:, :3] if self.problem.scenario.motion.task == "position" else jacobian)

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
