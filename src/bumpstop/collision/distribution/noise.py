"""What one run's detector sees: its noise tick by tick, and the residual a contact makes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray

if TYPE_CHECKING:
    from bumpstop.collision.problem import CollisionProblem


def noise_of_run(problem: CollisionProblem, seed: int, run: int, ticks: int) -> FloatArray:
    """Noise of a run of the sampled distribution at its first ``ticks`` ticks, mean included: (ticks, dof) [Nm or N].

    The same numbers as the law's own; before the detector is armed it is not monitored and taken as it is when it is.
    """
    if problem.residuals is not None:
        record = problem.residuals
        assert problem.residual_record is not None
        played: FloatArray = record.rows[problem.residual_record.rows_of_run(seed, run, ticks)]
        return played
    white = _native.standard_noise(seed, run, 1, ticks, problem.robot.dof)[0] * problem.noise_sd
    correlation = problem.scenario.detector.noise_correlation
    if correlation != 0:
        first = problem.first_armed_tick
        fresh = np.sqrt((1 - correlation) * (1 + correlation))
        for k in range(first + 1, ticks):
            white[k] = correlation * white[k - 1] + fresh * white[k]
    noise: FloatArray = white + problem.noise_mean
    return noise


def contact_residual(problem: CollisionProblem, torque: FloatArray) -> FloatArray:
    """What the detector makes of contact torques, without noise: the torques themselves, or an observer's of them.

    Args:
        problem: says which.
        torque: (ticks, ..., joints) [Nm or N]; before the first tick there is none.

    Returns:
        The same shape [Nm or N]. An observer sees the mean torque between two ticks, as ``MomentumObserver`` of the
        running detector does.
    """
    keep = problem.observer_memory
    if keep == 0:
        return torque
    residual = np.empty_like(torque)
    here = before = np.zeros(torque.shape[1:])  # a motion may end before the first tick
    for k, now in enumerate(torque):
        mean = (before + now) / 2
        residual[k] = here = mean + keep * (here - mean)
        before = now
    return residual
