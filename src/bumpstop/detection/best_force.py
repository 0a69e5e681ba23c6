"""How well the shortest force that fits a residual best is known: isolation.hpp gives the force itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bumpstop import _native
    from bumpstop.arrays import FloatArray

# Directions whose square of torques per newton is a smaller share of the largest have no force, as in the kernels.
_MIN_SQUARE = 1e-9


@dataclass(frozen=True, eq=False)
class BestForceNoise:
    """What a force at a point of an arm is told by.

    Attributes:
        chain: of the arm.
        link: number of the link, from 0.
        point: in its frame (3,) [m].
        noise_sd: of the residual (n,), infinite of a joint that is not used [Nm or N].
    """

    chain: _native.Chain
    link: int
    point: FloatArray
    noise_sd: FloatArray

    def sd(self, q: FloatArray, residual: FloatArray, hidden: FloatArray) -> FloatArray:
        """Standard deviation (3,) of the components of the force [N, base frame]; zero where nothing loads a joint.

        Args:
            q: (n,) pose [rad or m].
            residual: (n,) that the force is told of [Nm or N].
            hidden: (n,) torque that friction may hide [Nm or N].
        """
        sd = np.hypot(self.noise_sd, hidden)
        hides = (hidden > self.noise_sd) & (np.abs(residual) <= 3 * self.noise_sd)
        used = np.where(hides, np.inf, sd)
        # Where friction may hide the torque of every joint, all are used.
        weight = 1 / (used if np.isfinite(used).any() else sd)
        lever = self.chain.jacobians(q[None], self.link, self.point)[0, :3]
        fit = np.linalg.pinv(lever.T * weight[:, None], rcond=_MIN_SQUARE**0.5)
        return np.asarray(np.linalg.norm(fit, axis=1))
