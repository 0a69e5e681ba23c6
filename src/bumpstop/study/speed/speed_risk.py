"""The risk of straight lines at many speeds, each followed long enough for its speed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from bumpstop.collision import evaluate_batch
from bumpstop.collision.verdict.verdict_notes import MAX_UNTOUCHED
from bumpstop.study.requirement.risk import allowed_force
from bumpstop.study.speed.motion_duration import duration_s

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionProblem


class SpeedRisks(NamedTuple):
    """Risks of lines; ``over`` and ``force`` are NaN where there is no distribution, as at a singularity.

    Attributes:
        over: probability of exceeding a limit (N,).
        force: exceeded with the accepted probability (N,) [N].
        untouched: in most cases nothing is hit (N,): a verdict would be inconclusive.
    """

    over: FloatArray
    force: FloatArray
    untouched: npt.NDArray[np.bool_]


def speed_risks(problem: CollisionProblem, q: FloatArray, velocity: FloatArray, *, threads: int = 1) -> SpeedRisks:
    """Find the risks of lines.

    Lines slower than the problem's own are followed as far as it is, which takes them longer.

    Args:
        problem: a straight line of the tip; its pose and velocity are replaced.
        q: poses (N, dof) [rad or m].
        velocity: of the tip, base frame (N, 3) [m/s].
        threads: for the integrated distributions.
    """
    limit, accepted = allowed_force(problem), problem.scenario.verdict.accepted_probability
    over, force, touched = np.empty(len(q)), np.empty(len(q)), np.empty(len(q))

    def follow(rows: npt.NDArray[np.int64], factor: float) -> npt.NDArray[np.bool_]:
        """Follow rows as long as it takes at ``factor`` times the problem's speed; which have come to no end."""
        found = evaluate_batch(
            _followed(problem, factor), q[rows], velocity[rows], probabilities=[1 - accepted], limits_N=[limit, 0.0],
            threads=threads,
        )  # fmt: skip
        over[rows], force[rows] = found.exceedance[:, 0], found.quantile[:, 0]
        touched[rows] = found.exceedance[:, 1]
        return np.asarray(found.end == "motion_end")

    factor = np.minimum(np.linalg.norm(velocity, axis=1) / np.linalg.norm(problem.velocity), 1.0)
    # A batch has one duration. Most are detected in half of theirs; the others are followed to their own end, alone.
    halvings = np.ceil(np.log2(factor))
    for number in np.unique(halvings):
        rows = np.flatnonzero(halvings == number)
        for row in rows[follow(rows, 2.0**number) & (factor[rows] < 2.0**number)]:
            follow(np.array([row]), float(factor[row]))
    return SpeedRisks(over, force, (1 - touched > MAX_UNTOUCHED) & (over <= accepted))


def _followed(problem: CollisionProblem, factor: float) -> CollisionProblem:
    """The problem, followed as long as it takes at ``factor`` times its speed."""
    motion = problem.scenario.motion
    duration = duration_s(problem.scenario, factor)
    if duration == motion.duration_s:
        return problem
    longer = motion.model_copy(update={"duration_s": duration})
    return replace(problem, scenario=problem.scenario.model_copy(update={"motion": longer}))
