"""The highest speed at which a collision at a pose, in a direction, is still acceptable."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.collision import CollisionProblem
from bumpstop.study.pose_batch import PoseBatch
from bumpstop.study.prediction import predicted_speed_limit, stopping_time_per_speed, undetected_force
from bumpstop.study.requirement.risk import allowed_force
from bumpstop.study.requirement.sampling_ripple import (
    SOME_RISK,
    RippleScan,
    force_may_fall,
    has_ripple,
    nearly_fails,
    risk_may_fall,
    slower_speeds,
)
from bumpstop.study.speed.speed_risk import speed_risks
from bumpstop.study.speed.speed_search import CLOSE, MIN_SPEED, SearchRange, highest_met

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import Scenario

_FIRST = 5e-3  # m/s; the first guess is no slower: distributions of slow arms are long
# Between speeds of a first scan where the force may fall, in the logarithm.
_COARSE = 0.15
_BETWEEN = 8  # parts of a step beside a peak of the risk


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
        slower, more = _below_all_crests(problem, q, direction, met, risk, gain, threads)
        limited_by = np.where(slower < met, np.where(slower > 0, "risk", "nothing_safe"), limited_by)
        met, evaluations = slower, evaluations + more
    return SpeedLimits(met, np.where(met > 0, risk, np.nan), limited_by, evaluations, untouched)


def _below_all_crests(
    problem: CollisionProblem,
    q: FloatArray,
    direction: FloatArray,
    met: FloatArray,
    risk: FloatArray,
    gain: FloatArray,
    threads: int,
) -> tuple[FloatArray, int]:
    """Highest speeds (N,) [m/s] below which no crest of the risk passes what is accepted, and distributions computed.

    ``risk`` is brought to these speeds.
    """
    limit, accepted = allowed_force(problem), problem.scenario.verdict.accepted_probability
    scenario, evaluations = problem.scenario, 0
    falls = force_may_fall(scenario)

    def risks(trials: dict[int, FloatArray]) -> dict[int, tuple[FloatArray, FloatArray]]:
        """Of speeds by row, and the forces."""
        nonlocal evaluations
        trials = {row: speeds for row, speeds in trials.items() if speeds.size}
        if not trials:
            return {}
        rows = np.repeat(list(trials), [each.size for each in trials.values()])
        speed = np.concatenate(list(trials.values()))
        evaluations += rows.size
        found = speed_risks(problem, q[rows], direction[rows] * speed[:, None], threads=threads)
        ends = np.cumsum([each.size for each in trials.values()])[:-1]
        return dict(zip(trials, zip(np.split(found.over, ends), np.split(found.force, ends), strict=True), strict=True))

    def met_by(found: tuple[FloatArray, FloatArray]) -> bool:
        return bool((found[0] <= accepted).all())

    def below(row: int) -> FloatArray:
        """Speeds to look at, descending from the top."""
        speeds = top[[row]]
        if has_ripple(scenario):
            ripple = RippleScan.of(problem, limit, speed=float(top[row]), start_acceleration=float(1 / gain[row]))
            count = math.ceil(-math.log(1 - ripple.share) / min(ripple.apart, 0.9 * CLOSE))
            speeds = top[row] * (1 - ripple.share) ** (np.arange(count + 1) / count)
        if falls:
            slower = slower_speeds(float(top[row]), apart=_COARSE)
            speeds = np.union1d(speeds, np.maximum(slower, MIN_SPEED))[::-1]
        return np.asarray(speeds)

    top, safe = met.copy(), np.zeros_like(met)
    open_ = np.flatnonzero(met > 0).tolist()
    while open_:
        trials = {row: below(row) for row in open_}
        found = risks(trials)
        if falls:
            between = {row: _close(trials[row], found[row][1], limit) for row in open_}
            for row, more in risks(between).items():
                order = np.argsort(-np.concatenate([trials[row], between[row]]))
                trials[row] = np.concatenate([trials[row], between[row]])[order]
                over, force = (np.concatenate(pair)[order] for pair in zip(found[row], more, strict=True))
                found[row] = over, force
        # A crest may fail at its point alone.
        peaks = {}
        for row in open_:
            over, force = found[row]
            if met_by(found[row]):
                at = _peaks(over)
                if falls:
                    at = at & (over > SOME_RISK * accepted) | _peaks(force) & nearly_fails(force, limit)
                peaks[row] = _about(trials[row], np.flatnonzero(at))
        high = risks(peaks)
        again = []
        for row in open_:
            failing = trials[row][~(found[row][0] <= accepted)]
            if row in high:
                failing = peaks[row][~(high[row][0] <= accepted)]
            if not failing.size:
                safe[row], risk[row] = trials[row][0], found[row][0][0]
                continue
            lower = trials[row][trials[row] < failing.min()]
            top[row] = lower[0] if lower.size else failing.min() * (1 - CLOSE)
            if top[row] >= MIN_SPEED:
                again.append(row)
        open_ = again
    return safe, evaluations


def _peaks(height: FloatArray) -> npt.NDArray[np.bool_]:
    """Which are the greatest of their neighbourhood (N,)."""
    beside = np.pad(height, 1, constant_values=-1.0)
    return np.asarray((height >= beside[:-2]) & (height >= beside[2:]))


def _close(speed: FloatArray, force: FloatArray, limit: float) -> FloatArray:
    """Speeds between those of a coarse scan, descending (N,), where the force (N,) may pass the limit [N] between them.

    As long as it does not fall it grows with the speed.
    """
    ratio = speed[:-1] / speed[1:]
    near = np.flatnonzero(nearly_fails(ratio * np.maximum(force[:-1], force[1:]), limit))
    pieces = [slower_speeds(float(speed[i]), float(speed[i + 1]))[1:-1] for i in near]
    return np.concatenate([np.empty(0), *pieces])


def _about(speed: FloatArray, peak: npt.NDArray[np.int64]) -> FloatArray:
    """Speeds between those beside some, given by place, descending as all speeds given (N,)."""
    if speed.size < 2:
        return np.empty(0)
    pieces = np.unique(np.concatenate([np.maximum(peak - 1, 0), np.minimum(peak, speed.size - 2)]))
    share = np.arange(1, _BETWEEN) / _BETWEEN
    return np.asarray((speed[pieces, None] ** (1 - share) * speed[pieces + 1, None] ** share).ravel())
