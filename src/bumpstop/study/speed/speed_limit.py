"""The highest speed at which a collision at a pose, in a direction, is still acceptable."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.collision import CollisionProblem
from bumpstop.study.pose_batch import PoseBatch
from bumpstop.study.prediction import predicted_speed_limit, stopping_time_per_speed, undetected_force
from bumpstop.study.requirement.risk import allowed_force
from bumpstop.study.requirement.sampling_ripple import risk_may_fall
from bumpstop.study.speed.crest_scan import CrestScan
from bumpstop.study.speed.speed_risk import speed_risks
from bumpstop.study.speed.speed_search import MIN_SPEED, SearchRange, highest_met

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import Scenario

_FIRST = 5e-3  # m/s; the first guess is no slower: distributions of slow arms are long


@dataclass(frozen=True, eq=False)
class SpeedLimits:
    """Highest safe speeds; 0 where not even :data:`MIN_SPEED` is safe.

    Attributes:
        speed: of the tip (N,) [m/s].
        risk: probability of passing a limit at that speed, by the integrated distribution; NaN where ``speed`` is 0.
        limited_by: (N,) what holds it down: ``"risk"``, ``"joint_rates"`` (joints that turn faster than a straight line
            asks for), ``"max_speed"``, ``"nothing_safe"`` (no speed is safe), ``"untouched"`` (in most cases nothing
            is hit: no speed has been put to the test) or ``"singularity"`` (no straight line can be followed there; the
            distribution of the trajectory itself).
        evaluations: integrated distributions computed.
        untouched: (N,) in most cases nothing is hit at that speed.
    """

    speed: FloatArray
    risk: FloatArray
    limited_by: npt.NDArray[np.str_]
    evaluations: int
    untouched: npt.NDArray[np.bool_]

    def put_to_the_test(self, untouched: npt.NDArray[np.bool_]) -> SpeedLimits:
        """Without the speeds of rows (N,) at which nothing was hit."""
        return replace(
            self,
            speed=np.where(untouched, 0.0, self.speed),
            risk=np.where(untouched, np.nan, self.risk),
            limited_by=np.where(untouched, "untouched", self.limited_by),
        )


def speed_limits(
    scenario: Scenario | CollisionProblem,
    q: FloatArray,
    direction: FloatArray,
    max_speed: FloatArray,
    *,
    threads: int = 1,
) -> SpeedLimits:
    """Find the highest safe speeds along straight lines through poses.

    A formula gives the first guess, integrated distributions decide: every speed returned has been computed and meets
    verdict.accepted_probability, and one at most 1 % higher does not, unless the max_speed or the formula for turning
    joints is lower. What hits nothing in most cases meets it, too: ``untouched`` says so. Where the risk may fall with
    speed no slower one is left that fails, down to a fifth; of a force that may fall, one at most 3 % higher does not
    meet it.

    Args:
        scenario: a straight line of the tip, checked or not; its pose and velocity are replaced.
        q: poses (N, dof) [rad or m].
        direction: unit vectors, base frame (N, 3).
        max_speed: no speed above it is looked at (N,) [m/s].
        threads: for the integrated distributions.
    """
    problem = scenario if isinstance(scenario, CollisionProblem) else CollisionProblem.from_scenario(scenario)
    limit, accepted = allowed_force(problem), problem.scenario.verdict.accepted_probability
    arms = PoseBatch(problem, q, direction)
    torque = np.einsum("nij,ni->nj", arms.linear_jacobian(q), direction)
    with np.errstate(invalid="ignore", over="ignore"):
        gain = stopping_time_per_speed(problem, arms.joint_rates(q))
    undetected = undetected_force(problem, torque, accepted)
    guess = np.nan_to_num(predicted_speed_limit(problem, undetected, gain, limit))
    count = len(q)
    risk, untouched = np.full(count, np.nan), np.zeros(count, dtype=bool)

    def tried(rows: npt.NDArray[np.int64], speed: FloatArray) -> tuple[npt.NDArray[np.bool_], FloatArray]:
        found = speed_risks(problem, q[rows], direction[rows] * speed[:, None], threads=threads)
        good = found.over <= accepted
        risk[rows[good]], untouched[rows[good]] = found.over[good], found.untouched[good]
        return good, found.force

    within = SearchRange(
        first=np.clip(guess, np.minimum(_FIRST, max_speed), max_speed),
        undetected=0.8 * undetected,
        min_speed=np.full(count, MIN_SPEED),
        max_speed=max_speed,
    )
    met, evaluations = highest_met(tried, limit, within)
    limited_by = np.where(met >= max_speed * (1 - 1e-12), "max_speed", np.where(met > 0, "risk", "nothing_safe"))
    if risk_may_fall(problem.scenario):
        scan = CrestScan(problem, q, direction, gain, threads)
        slower = scan.highest_safe(met, risk)
        limited_by = np.where(slower < met, np.where(slower > 0, "risk", "nothing_safe"), limited_by)
        met, evaluations = slower, evaluations + scan.evaluations
    return SpeedLimits(met, np.where(met > 0, risk, np.nan), limited_by, evaluations, untouched)
