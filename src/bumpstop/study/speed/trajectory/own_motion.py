"""Safe speeds of a trajectory as it goes on itself, where no straight line says anything about it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.trajectory.trajectory import Trajectory
from bumpstop.study.speed.speed_search import MIN_SPEED
from bumpstop.study.speed.trajectory.onset_shares import onset_shares

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionProblem

# From one speed looked at to the next slower one.
_STEP = 0.9
# So many times the trajectory's own speed is far above it; and no motion of more steps is looked at.
_FAR_ABOVE, _MAX_STEPS = 2.0, 120_000


def own_speeds(
    problem: CollisionProblem, time: FloatArray, speed: FloatArray, guess: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Highest safe speeds of the tip, and risks there, where the whole trajectory is followed at one path speed.

    The integrated distribution of a collision that begins at a time of the trajectory decides, as in ``bumpstop
    evaluate`` with ``motion.contact_onset_s``: contact at that place, and an arm that brakes along its path. Speeds are
    tried from the guess down, or from the trajectory's own where that is higher; what lies above is not looked at. A
    guess far above the trajectory's own speed is taken as it is.

    Args:
        problem: of the trajectory; clamped contact.
        time: of the trajectory, at which contact begins (N,) [s].
        speed: of the tip then (N,) [m/s], above zero.
        guess: a formula's (N,) [m/s].

    Returns:
        Speeds (N,) [m/s], 0 where none down to a millimetre a second is safe, and probabilities of passing a limit
        there (N,), NaN where the speed is 0 or the guess.
    """
    given = problem.trajectory
    assert given is not None
    accepted = problem.scenario.verdict.accepted_probability
    found, risk = np.zeros(len(time)), np.full(len(time), np.nan)
    # Rows share the steps of the path speed, so that one motion serves all that are tried at it.
    level = np.ceil(np.log(np.maximum(guess, speed) / speed) / np.log(_STEP)).astype(np.int64)
    far = guess > _FAR_ABOVE * speed
    found[far] = guess[far]
    open_ = ~far
    slowest = given.duration / (_MAX_STEPS * problem.scenario.simulation.step_s)
    while open_.any():
        now = int(level[open_].min())
        rows = np.flatnonzero(open_ & (level == now))
        share = _STEP**now
        slower = Trajectory(given.time / share, given.position, share * _velocity(given))
        over = onset_shares(replace(problem, trajectory=slower), time[rows] / share).over_limit()
        met = over <= accepted
        found[rows[met]], risk[rows[met]] = share * speed[rows[met]], over[met]
        level[rows] += 1
        open_[rows] = ~met & (share * _STEP * speed[rows] >= MIN_SPEED) & (share * _STEP >= slowest)
    return found, risk


def _velocity(trajectory: Trajectory) -> FloatArray:
    return trajectory.at(trajectory.time, 1) if trajectory.velocity is None else trajectory.velocity
