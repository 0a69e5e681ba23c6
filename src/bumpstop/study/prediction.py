"""Peak forces foretold from the pose alone: an expected value and an upper bound, without tracing a motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.collision import Problem
from bumpstop.errors import InputError
from bumpstop.study.braking import stopping
from bumpstop.study.noticing import Noticing
from bumpstop.study.short_path import Arms, ShortPath

if TYPE_CHECKING:
    from bumpstop.collision import Scenario

# The stretch foreseen is longer than the shortest that is noticed, for noise and falling sensitivity.
_LONGER = 1.25
# The same, of the longest that the noise lets pass but for the share of cases the bound leaves out.
_RARELY_LONGER = 1.1
# Moments at which the path is known: of most motions, and of those that turn on the way.
_STEPS, _MANY_STEPS = 2, 16
# How much joint rates may change on the way, in shares of themselves.
_TURNING = 0.4
# Where they change by more than this, both numbers of moments must agree so well.
_DOUBTED, _AGREE = 0.1, 0.02
# How far the speed of the tip may be from the speed asked for.
_OFF_SPEED = 0.02
# Where it does not hold, the formula is kept within this factor of that of one line.
_ASTRAY = 3.0
# Places of the body, out of all it may have, at which the least torque per newton is looked for.
_PLACES = 3


@dataclass(frozen=True, eq=False)
class Prediction:
    """What is foretold of every pose; NaN where the start is singular, infinite where no joint feels the contact.

    Attributes:
        expected: mean peak force (N,) [N].
        bound: peak force (N,) [N] passed with a probability of at most 1 - ``quantile``.
        quantile: of the bound.
        unnoticed: the largest force along the motion that no threshold notices, min_j theta_j / |a_j| (N,) [N].
        trigger: the joint that notices it, from 0 (N,).
        gain: largest joint rate per speed of the tip (N,) [rad/m].
        stopping: travel expected between the tick of detection and the farthest point (N,) [m].
        trusted: (N,) whether the formula holds: the joints can follow the line, do not turn much on the way, and meet
            no limit before the arm must have noticed. Elsewhere ``expected`` is a guess and ``bound`` infinite.
        approach: speed of the contact point along the normal (N,) [m/s].
        condition, singular_value: condition number and smallest singular value of J_v at the contact point, for
            comparison with the source (N,), (N,) [1, m/rad].
    """

    expected: FloatArray
    bound: FloatArray
    quantile: float
    unnoticed: FloatArray
    trigger: npt.NDArray[np.int64]
    gain: FloatArray
    stopping: FloatArray
    trusted: npt.NDArray[np.bool_]
    approach: FloatArray
    condition: FloatArray
    singular_value: FloatArray


def predict(scenario: Scenario, *, quantile: float = 0.999) -> Prediction:
    """Foretell the peak force of one scenario, N = 1; see :func:`predict_batch`."""
    problem = Problem.from_scenario(scenario)
    _check(problem, quantile)
    return _predict(problem, problem.q[None], problem.velocity[None], quantile)


def predict_batch(
    scenario: Scenario, q: npt.ArrayLike, velocity: npt.ArrayLike, *, quantile: float = 0.999
) -> Prediction:
    """Foretell the peak forces of many poses and velocities; all else is as in ``scenario``.

    Args:
        scenario: a straight line into clamped contact; its pose and velocity are replaced.
        q: joint positions (N, dof) [rad or m].
        velocity: of the tip, base frame (N, 3) [m/s].
        quantile: of the bound.

    Raises:
        InputError: a shape or value cannot be used, or nothing is foretold for such a scenario.
    """
    problem = Problem.from_scenario(scenario)
    _check(problem, quantile)
    poses = as_float_array(q, "q", (None, problem.robot.dof))
    return _predict(problem, poses, as_float_array(velocity, "velocity", (len(poses), 3)), quantile)


def _check(problem: Problem, quantile: float) -> None:
    scenario = problem.scenario
    if not 0.5 <= quantile <= 1 - 1e-9:
        raise InputError("quantile", f"{quantile:g} cannot be used", "wanted 0.5 to 0.999999999")
    if problem.trajectory is not None:
        raise InputError("motion.kind", "'trajectory' is not foretold", "wanted 'line'")
    if scenario.contact.kind == "free":
        raise InputError("contact.kind", "'free' is not foretold", "wanted 'clamped'")
    if problem.residuals is not None:
        raise InputError("detector.residuals", "measured noise is not foretold", "give detector.noise_sd_Nm")
    if problem.first_armed_tick > 0:
        raise InputError("detector.arming_delay_s", "a detector that is armed late is not foretold", "wanted 0")
    if not np.isfinite(problem.thresholds).any():
        raise InputError("detector.thresholds_Nm", "watch no joint", "give one a finite threshold")


def _predict(problem: Problem, q: FloatArray, velocity: FloatArray, quantile: float) -> Prediction:
    arms = Arms(problem, q, velocity)
    normal = _normals(problem, velocity)
    jacobian = arms.linear_jacobian(q)
    torque = np.einsum("nij,ni->nj", jacobian, normal)
    with np.errstate(invalid="ignore", over="ignore"):
        rates = arms.rates(q)
    approach = (torque * rates).sum(axis=1)
    with np.errstate(divide="ignore"):
        each = problem.thresholds / np.abs(torque)
    unnoticed = each.min(axis=1)
    values: FloatArray = np.asarray(np.linalg.svd(jacobian, compute_uv=False), dtype=np.float64)
    speed = np.linalg.norm(velocity, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        condition = values[:, 0] / values[:, -1]
        gain = np.abs(rates).max(axis=1) / speed
        stop = (np.abs(rates) / problem.joint_acceleration).max(axis=1)
    expected, bound, stopping = (np.full(len(q), np.nan) for _ in range(3))
    trusted = np.zeros(len(q), dtype=bool)
    usable = np.isfinite(rates).all(axis=1) & (approach > 0)
    deaf = usable & ~np.isfinite(unnoticed)
    expected[deaf] = bound[deaf] = np.inf
    rows = np.flatnonzero(usable & ~deaf)
    for steps in (_STEPS, _MANY_STEPS):
        if not rows.size:
            break
        some = Arms(problem, q[rows], velocity[rows])
        with np.errstate(invalid="ignore", over="ignore"):
            found = _forces(some, normal[rows], torque[rows], approach[rows], quantile, steps)
        earlier, checked = bound[rows], trusted[rows]
        expected[rows], bound[rows], stopping[rows], trusted[rows], turned = found
        if steps == _MANY_STEPS:
            with np.errstate(invalid="ignore"):
                agrees = np.abs(bound[rows] - earlier) <= _AGREE * earlier
            trusted[rows] &= agrees | ~checked
            bound[rows] = np.where(checked, np.maximum(bound[rows], earlier), bound[rows])
        rows = rows[~trusted[rows] | (turned > _DOUBTED)]
    # Elsewhere the formula of one line keeps the guess from going far astray.
    rough = _in_one_line(problem, unnoticed, approach, stop)
    guess = np.clip(np.where(np.isfinite(expected), expected, rough), rough / _ASTRAY, rough * _ASTRAY)
    expected = np.where(usable & ~deaf & ~trusted, guess, expected)
    bound[~trusted & ~deaf] = np.where(usable, np.inf, np.nan)[~trusted & ~deaf]
    return Prediction(
        expected=expected,
        bound=bound,
        quantile=quantile,
        unnoticed=unnoticed,
        trigger=each.argmin(axis=1),
        gain=gain,
        stopping=stopping,
        trusted=trusted,
        approach=approach,
        condition=condition,
        singular_value=values[:, -1],
    )


def _in_one_line(problem: Problem, unnoticed: FloatArray, approach: FloatArray, stop: FloatArray) -> FloatArray:
    """F = min_j theta_j / |a_j| + K v (T / 2 + t_latency + t_stop / 2): no noise, and nothing turns (N,) [N].

    Args:
        problem: clamped contact.
        unnoticed: first term (N,) [N].
        approach: v (N,) [m/s].
        stop: time to stop, max_j |qd_j| / qdd_j (N,) [s].
    """
    step = problem.scenario.simulation.step_s
    late = (problem.period_steps / 2 + problem.latency_steps) * step
    return np.asarray(unnoticed + problem.stiffness * approach * (late + stop / 2))


def _normals(problem: Problem, velocity: FloatArray) -> FloatArray:
    given = problem.scenario.contact.normal
    if given is not None:
        normal = np.array(given, dtype=np.float64)
        return np.tile(normal / np.linalg.norm(normal), (len(velocity), 1))
    return np.asarray(velocity / np.linalg.norm(velocity, axis=1)[:, None])


def _forces(
    arms: Arms, normal: FloatArray, torque: FloatArray, approach: FloatArray, quantile: float, steps: int
) -> tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.bool_], FloatArray]:
    """Expected force, bound, stopping travel, where they hold, and how much the joints turn on the way."""
    from scipy.special import ndtri

    problem = arms.problem
    step, K = problem.scenario.simulation.step_s, problem.stiffness
    period, latency = problem.period_steps * step, problem.latency_steps * step
    offset, farthest = _offsets(problem, approach, quantile)
    watched = np.isfinite(problem.thresholds)
    thresholds, sd, mean = problem.thresholds[watched], problem.noise_sd[watched], problem.noise_mean[watched]
    # The bound leaves half of what may be missed to the body's place, where that has a tail.
    rarest = 1 - quantile if problem.offset_kind != "half_normal" else (1 - quantile) / 2

    def missed(deviations: float) -> FloatArray:
        with np.errstate(divide="ignore"):
            force = (thresholds + np.abs(mean) + deviations * sd) / np.abs(torque[:, watched])
        return np.asarray(force.min(axis=1))

    noisy = missed(2.0)
    length = np.maximum(_LONGER * noisy, _RARELY_LONGER * missed(float(-ndtri(rarest))))
    length = (farthest + length / K) / approach + 2 * period + latency
    length = np.minimum(length, problem.scenario.motion.duration_s + latency)
    path = ShortPath.of(arms, normal, length, steps)

    def noticing(place: FloatArray, per_tick: FloatArray, *, cautious: bool) -> Noticing:
        def residual(force: FloatArray) -> FloatArray:
            felt = (force - _lag(problem, force, per_tick))[..., None]
            if not cautious:
                return felt * path.torque_at(path.share_at(place[:, None] + force / K))[:, :, watched]
            # An observer's residual is a mean over all of the way since contact began.
            since = np.linspace(0, 1, _PLACES) if problem.observer_memory > 0 else np.ones(1)
            some = [
                path.torque_at(path.share_at(share * place[:, None] + part * force / K))[:, :, watched]
                for share in np.linspace(0, 1, _PLACES)
                for part in since
            ]
            # What is felt at least, wherever the body is.
            same = np.all([np.sign(a) == np.sign(some[0]) for a in some], axis=0)
            return np.asarray(np.where(same, np.min(np.abs(some), axis=0), 0.0) * felt)

        return Noticing.of(
            residual,
            torque[:, watched],
            per_tick,
            thresholds,
            sd,
            mean,
            remembers=problem.scenario.detector.noise_correlation != 0,
            rarest=rarest,
            cautious=cautious,
        )

    found = noticing(offset, K * path.speed_at(offset + noisy / K) * period, cautious=False).mean
    worst = noticing(farthest, K * path.fastest * period, cautious=True).worst(rarest)
    last = farthest + worst / K
    expected = stopping(path, path.time_of(offset + found / K), latency)
    most, bent = expected.most, expected.bent
    for time in (np.zeros_like(worst), path.time_of(last)):
        at = stopping(path, time, latency)
        most, bent = np.maximum(most, at.most), np.maximum(bent, at.bent)
    foretold = found + K * expected.travel
    # Beyond a joint limit the motion is over, and what was not noticed never is.
    q = path.position_at(path.time_of(last))
    seen = (last <= path.distance[-1]) & ((q >= problem.robot.lower) & (q <= problem.robot.upper)).all(axis=1)
    bound = np.where(seen, worst + K * most, np.inf)
    turned = np.maximum(bent, path.turned)
    trusted = (turned < _TURNING) & (path.off_speed < _OFF_SPEED) & np.isfinite(foretold) & np.isfinite(bound)
    return foretold, bound, expected.travel, trusted, turned


def _offsets(problem: Problem, approach: FloatArray, quantile: float) -> tuple[FloatArray, FloatArray]:
    """Where the body is expected, and how far at most but for (1 - quantile) / 2 of cases (N,), (N,) [m]."""
    from scipy.special import ndtri

    contact, step = problem.scenario.contact, problem.scenario.simulation.step_s
    if contact.offset_law == "fixed":
        place = np.full_like(approach, (contact.offset_mm or 0.0) / 1e3)
        return place, place
    if contact.offset_law == "uniform":
        travel = problem.period_steps * step * approach
        return travel / 2, travel
    spread = contact.offset_sd_s * approach
    return spread * np.sqrt(2 / np.pi), spread * float(-ndtri((1 - quantile) / 4))


def _lag(problem: Problem, force: FloatArray, per_tick: FloatArray) -> FloatArray:
    """How far an observer's residual is behind a force that grows evenly (N, G) [N]; 0 for the direct residual."""
    keep = problem.observer_memory
    if keep == 0:
        return np.zeros_like(force)
    steady = per_tick[:, None] * keep / (1 - keep)
    return np.asarray(steady * -np.expm1(np.log(keep) * force / per_tick[:, None]))
