"""The highest speed at which a collision at a pose, in a direction, is still acceptable."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.collision import CollisionProblem, evaluate_batch
from bumpstop.study.pose_batch import PoseBatch
from bumpstop.study.prediction import predicted_speed_limit, stopping_time_per_speed, undetected_force
from bumpstop.study.requirement.risk import allowed_force
from bumpstop.study.requirement.sampling_ripple import RippleScan, has_ripple

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import Scenario

MIN_SPEED = 1e-3  # m/s; slower arms are not looked at
_FIRST = 5e-3  # m/s; the first guess is no slower: distributions of slow arms are long
# The search ends by itself, mostly after five; late ones look at the middle too, so that none can go on for long.
_ROUNDS = 48
_BETWEEN = 8  # parts of a step beside a peak of the risk
CLOSE = 0.01  # between a speed that is met and one that is not


@dataclass(frozen=True, eq=False)
class SpeedLimits:
    """Highest safe speeds; 0 where not even :data:`MIN_SPEED` is safe.

    Attributes:
        speed: of the tip (N,) [m/s].
        risk: probability of passing a limit at that speed, by the integrated distribution; NaN where ``speed`` is 0.
        limited_by: (N,) what holds it down: ``"risk"``, ``"joint_rates"`` (joints that turn faster than a straight line
            asks for), ``"max_speed"``, ``"nothing_safe"`` (no speed is safe) or ``"singularity"`` (no straight line can
            be followed there; the distribution of the trajectory itself).
        evaluations: integrated distributions computed.
    """

    speed: FloatArray
    risk: FloatArray
    limited_by: npt.NDArray[np.str_]
    evaluations: int


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
    joints is lower. Where the risk has a sampling ripple over speed no slower one is left that fails.

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
    met, fails = np.zeros(count), np.full(count, np.inf)
    risk = np.full(count, np.nan)
    force_met, force_fails = np.zeros(count), np.full(count, np.inf)
    trial = np.clip(guess, np.minimum(_FIRST, max_speed), max_speed)
    open_ = np.flatnonzero(max_speed >= MIN_SPEED)
    evaluations = 0
    for number in range(_ROUNDS):
        if not open_.size:
            break
        v = trial[open_]
        found = evaluate_batch(
            problem, q[open_], direction[open_] * v[:, None], probabilities=[1 - accepted], limits_N=[limit],
            threads=threads,
        )  # fmt: skip
        evaluations += open_.size
        over, force = found.exceedance[:, 0], found.quantile[:, 0]
        good = over <= accepted
        for rows, at, forces, chosen in (
            (open_[good], met, force_met, good),
            (open_[~good], fails, force_fails, ~good),
        ):
            at[rows], forces[rows] = v[chosen], np.nan_to_num(force[chosen], nan=np.inf, posinf=np.inf)
        risk[open_[good]] = over[good]
        done = (met >= max_speed * (1 - 1e-12)) | (fails <= met * (1 + CLOSE)) | (fails <= MIN_SPEED * (1 + 1e-9))
        open_ = open_[~done[open_]]
        trial[open_] = _next(
            met[open_], fails[open_], force_met[open_], force_fails[open_], limit, 0.8 * undetected[open_],
            max_speed[open_], number,
        )  # fmt: skip
    limited_by = np.where(met >= max_speed * (1 - 1e-12), "max_speed", np.where(met > 0, "risk", "nothing_safe"))
    if has_ripple(problem.scenario):
        slower, more = _below_all_crests(problem, q, direction, met, risk, gain, threads)
        limited_by = np.where(slower < met, np.where(slower > 0, "risk", "nothing_safe"), limited_by)
        met, evaluations = slower, evaluations + more
    return SpeedLimits(met, np.where(met > 0, risk, np.nan), limited_by, evaluations)


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
    evaluations = 0

    def risks(trials: dict[int, FloatArray]) -> dict[int, FloatArray]:
        """Of speeds by row."""
        nonlocal evaluations
        rows = np.repeat(list(trials), [each.size for each in trials.values()])
        speed = np.concatenate(list(trials.values()))
        evaluations += rows.size
        over = evaluate_batch(
            problem, q[rows], direction[rows] * speed[:, None], limits_N=[limit], threads=threads
        ).exceedance[:, 0]
        ends = np.cumsum([each.size for each in trials.values()])
        return dict(zip(trials, np.split(over, ends[:-1]), strict=True))

    top, safe = met.copy(), np.zeros_like(met)
    open_ = np.flatnonzero(met > 0).tolist()
    while open_:
        trials = {}
        for row in open_:
            ripple = RippleScan.of(problem, limit, speed=float(top[row]), start_acceleration=float(1 / gain[row]))
            count = math.ceil(-math.log(1 - ripple.share) / min(ripple.apart, 0.9 * CLOSE))
            trials[row] = top[row] * (1 - ripple.share) ** (np.arange(count + 1) / count)
        found = risks(trials)
        # A crest may fail at its point alone.
        peaks = {row: _about_peaks(trials[row], found[row]) for row in open_ if (found[row] <= accepted).all()}
        high = risks(peaks) if peaks else {}
        again = []
        for row in open_:
            failing = trials[row][~(found[row] <= accepted)]
            if row in peaks:
                failing = peaks[row][~(high[row] <= accepted)]
            if not failing.size:
                safe[row], risk[row] = trials[row][0], found[row][0]
                continue
            lower = trials[row][trials[row] < failing.min()]
            top[row] = lower[0] if lower.size else failing.min() * (1 - CLOSE)
            if top[row] >= MIN_SPEED:
                again.append(row)
        open_ = again
    return safe, evaluations


def _about_peaks(speed: FloatArray, risk: FloatArray) -> FloatArray:
    """Speeds between those beside the greatest risks of their neighbourhood, descending as the speeds given."""
    beside = np.pad(risk, 1, constant_values=-1.0)
    peak = np.flatnonzero((risk >= beside[:-2]) & (risk >= beside[2:]))
    pieces = np.unique(np.concatenate([np.maximum(peak - 1, 0), np.minimum(peak, speed.size - 2)]))
    share = np.arange(1, _BETWEEN) / _BETWEEN
    return np.asarray((speed[pieces, None] ** (1 - share) * speed[pieces + 1, None] ** share).ravel())


def _next(
    met: FloatArray,
    fails: FloatArray,
    low: FloatArray,
    high: FloatArray,
    limit: float,
    undetected: FloatArray,
    max_speed: FloatArray,
    number: int,
) -> FloatArray:
    """Speeds to try: where a straight line through the logarithms reaches the limit, or steps where there is none yet.

    Args:
        met: fastest speed known to be safe, or 0 (N,) [m/s].
        fails: slowest known not to be, or infinite (N,) [m/s].
        low: force at the former (N,) [N].
        high: force at the latter (N,) [N].
        limit: force to reach [N].
        undetected: force that even a slow arm reaches, about (N,) [N].
        max_speed: no speed above it (N,) [m/s].
        number: of the round, from 0.
    """
    # Where even what is missed passes the limit, nothing tells how far it is up: steps of 1 % would never arrive.
    least = min(2.0, (1 + CLOSE) ** (2 ** min(number, 7)))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.log(limit / low) / np.log(high / low)
        between = met * (fails / met) ** np.clip(share, 0.1, 0.9) * (1 - 0.2 * CLOSE)
        if number > 8 and number % 3 == 2:
            between = np.sqrt(met * fails)
        between = np.where(np.isfinite(between) & (between > met), between, np.sqrt(met * fails))
        left = (limit - undetected) / (low - undetected)
        up = met * np.clip(np.where(left > 0, left**0.8, 3.0), least, 3.0)
        down = np.maximum(fails * np.clip(limit / np.where(np.isfinite(high), high, 4 * limit), 0.2, 0.6), MIN_SPEED)
    trial = np.where(met > 0, np.where(np.isfinite(fails), between, up), down)
    return np.asarray(np.minimum(trial, max_speed))
