"""How far collisions that begin at given times of a trajectory use the limits of the body, whatever gives way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.collision.trajectory.onset import approach
from bumpstop.collision.trajectory.trajectory_curve import trajectory_kernel
from bumpstop.collision.trajectory.undetected import undetected_forces
from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S, greater_share
from bumpstop.study.requirement.risk import allowed_force

if TYPE_CHECKING:
    from bumpstop import _native
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionProblem

_MOVES = 1e-6  # [m/s]


@dataclass(frozen=True, eq=False)
class OnsetShares:
    """Collisions of onsets: each detection, and what stays undetected.

    Attributes:
        onset: number of the onset of each, from 0.
        probability: of each.
        share: peak force of each over the greatest that the limits allow; 1 is the limit itself.
        onsets: how many onsets there are; one at which the contact point does not move toward the body has none.
    """

    onset: npt.NDArray[np.int64]
    probability: FloatArray
    share: FloatArray
    onsets: int

    def over_limit(self) -> FloatArray:
        """Probability that a limit is passed (onsets,)."""
        return np.asarray(np.bincount(self.onset, self.probability * (self.share > 1), self.onsets))

    def exceeded_with(self, probability: float) -> FloatArray:
        """Share that is exceeded with a probability (onsets,); zero where none is."""
        order = np.lexsort((-self.share, self.onset))
        onset, mass, share = self.onset[order], self.probability[order], self.share[order]
        total = np.cumsum(mass)
        first = np.searchsorted(onset, np.arange(self.onsets))
        passed = np.flatnonzero(total - np.append(0.0, total)[first][onset] > probability)
        # The first of each onset at which that probability is passed, hardest first.
        own, place = np.unique(onset[passed], return_index=True)
        found = np.zeros(self.onsets)
        found[own] = np.maximum(share[passed[place]], 0.0)
        return found


def onset_shares(
    problem: CollisionProblem, begin: FloatArray, kernel: _native.Trajectory | None = None, *, threads: int = 1
) -> OnsetShares:
    """Of collisions that begin at times (N,) [s], by the distribution of each.

    It is the integrated one of ``bumpstop evaluate`` with ``motion.contact_onset_s``: of a rigid or an elastic arm,
    clamped or free contact, a spring alone or with mass and damping, judged by one limit or in two phases.

    Args:
        problem: of a trajectory, against a body with limits.
        begin: times of the trajectory.
        kernel: of the problem, where it is known already.
        threads: that share the times.
    """
    normal, speed = approach(problem, begin)
    moving = np.flatnonzero(speed > _MOVES)
    if not moving.size:
        return OnsetShares(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0), len(begin))
    kernel = kernel or trajectory_kernel(problem)
    own = np.ascontiguousarray(normal[moving])
    out = kernel.integrate(problem.detector, problem.contact, begin[moving], own, threads)
    missed = np.flatnonzero(out.undetected > 0)
    undetected = undetected_forces(problem, begin[moving[missed]], own[missed])
    # The kernel gives a new array each time it is asked.
    undetected_peak, undetected_lasting = out.undetected_peak, out.undetected_lasting
    for force in (undetected_peak, undetected_lasting):
        force[missed] = undetected.of(force[missed])
    onset = moving[np.append(out.onset, np.arange(moving.size))]
    probability = np.append(out.probability, out.undetected)
    stiffness, lasting, transient = problem.stiffness, allowed_force(problem), problem.transient_limits
    contact = problem.scenario.contact
    first = None if transient is None else transient.allowed_force_N(contact.area_cm2, contact.peak_factor)
    if problem.gives_way:
        peak = np.append(out.peak, undetected_peak)
        share = peak / lasting
        if first is not None:
            share = greater_share(peak, np.append(out.lasting, undetected_lasting), (1 / first, 1 / lasting))
    elif first is not None:
        at = moving[out.onset]
        phases = kernel.phases(out.tick.tolist(), begin[at], np.ascontiguousarray(normal[at]), FIRST_PHASE_S)
        detected = stiffness * np.maximum(phases[:, 0] / first, phases[:, 1] / lasting)
        share = np.append(detected, stiffness * out.undetected_distance / lasting)
    else:
        share = stiffness * np.append(out.max_distance, out.undetected_distance) / lasting
    if not (problem.gets_away or undetected.bounded):
        # An arm that moves on where its file ends, and whose drives nobody knows, presses without bound.
        share[out.probability.size + missed] = np.inf
    return OnsetShares(onset, probability, share, len(begin))
