"""The time of a motion at which contact is hardest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.trajectory.trajectory_curve import trajectory_kernel
from bumpstop.study.speed.onset_shares import onset_shares

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionProblem

# Times looked at along a motion, then about the worst of them. No motion of the control cycle divides their distance:
# contact begins at all phases of it.
_TIMES, _BESIDE = 173, 41


def worst_onset(problem: CollisionProblem) -> tuple[float, float]:
    """Time of the trajectory at which contact is hardest [s], and how hard.

    That is the peak force that is exceeded with the accepted probability, over the allowed one; zero where the contact
    point never moves toward the body.
    """
    trajectory, accepted = problem.trajectory, problem.scenario.verdict.accepted_probability
    assert trajectory is not None
    end, kernel = trajectory.duration, trajectory_kernel(problem)
    width = end / _TIMES
    times: FloatArray = (np.arange(_TIMES, dtype=np.float64) + 0.5) * width
    share = onset_shares(problem, times, kernel).exceeded_with(accepted)
    best = int(share.argmax())
    beside: FloatArray = np.clip(times[best] + np.linspace(-width, width, _BESIDE), 0.0, np.nextafter(end, 0.0))
    nearer = onset_shares(problem, beside, kernel).exceeded_with(accepted)
    if nearer.max() > share[best]:
        return float(beside[int(nearer.argmax())]), float(nearer.max())
    return float(times[best]), float(share[best])
