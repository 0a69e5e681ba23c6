"""The peak force of collisions that begin at given times of a trajectory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.trajectory.onset import approach
from bumpstop.collision.trajectory.trajectory_curve import trajectory_kernel

if TYPE_CHECKING:
    from bumpstop import _native
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionProblem

# Times looked at along a motion, then about the worst of them. No motion of the control cycle divides their distance:
# contact begins at all phases of it.
_TIMES, _BESIDE = 173, 41
_MOVES = 1e-6  # [m/s]


def onset_forces(problem: CollisionProblem, begin: FloatArray, kernel: _native.Trajectory | None = None) -> FloatArray:
    """Peak force that is exceeded with the accepted probability (N,) [N], where contact begins at times (N,) [s].

    By the integrated distribution of each, as in ``bumpstop evaluate`` with ``motion.contact_onset_s``; zero where the
    contact point does not move toward the body.

    Args:
        problem: of a trajectory; clamped contact.
        begin: times of the trajectory.
        kernel: of the problem, where it is known already.
    """
    normal, speed = approach(problem, begin)
    moving = np.flatnonzero(speed > _MOVES)
    force = np.zeros(len(begin))
    if not moving.size:
        return force
    out = (kernel or trajectory_kernel(problem)).integrate(
        problem.detector, problem.contact, begin[moving], np.ascontiguousarray(normal[moving])
    )
    # An onset's detections and what stays undetected, hardest first: where their probability comes to the accepted one.
    onset = np.append(out.onset, np.arange(moving.size))
    probability = np.append(out.probability, out.undetected)
    distance = np.append(out.max_distance, out.undetected_distance)
    order = np.lexsort((-distance, onset))
    onset, probability, distance = onset[order], probability[order], distance[order]
    total = np.cumsum(probability)
    first = np.searchsorted(onset, np.arange(moving.size))
    above = total - np.append(0.0, total)[first][onset]
    over = above > problem.scenario.verdict.accepted_probability
    # The first of each onset at which that is passed.
    passed = np.flatnonzero(over)
    own, place = np.unique(onset[passed], return_index=True)
    found = np.zeros(moving.size)
    found[own] = problem.stiffness * np.maximum(distance[passed[place]], 0.0)
    force[moving] = found
    return force


def worst_onset(problem: CollisionProblem) -> tuple[float, float]:
    """Time of the trajectory at which contact is hardest [s], and the force there, as above [N].

    Zero force where the contact point never moves toward the body.
    """
    trajectory = problem.trajectory
    assert trajectory is not None
    end, kernel = trajectory.duration, trajectory_kernel(problem)
    times: FloatArray = (np.arange(_TIMES, dtype=np.float64) + 0.5) * (end / _TIMES)
    force = onset_forces(problem, times, kernel)
    best = int(force.argmax())
    width = end / _TIMES
    beside: FloatArray = np.clip(times[best] + np.linspace(-width, width, _BESIDE), 0.0, np.nextafter(end, 0.0))
    nearer = onset_forces(problem, beside, kernel)
    if nearer.max() > force[best]:
        return float(beside[int(nearer.argmax())]), float(nearer.max())
    return float(times[best]), float(force[best])
