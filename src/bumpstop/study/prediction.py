"""Peak forces predicted from the pose by one closed form, without tracing a motion.

The force at which a collision is detected, and the travel from there: a control cycle where the worst is asked for, the
latency, and the stopping distance by the reaction's law of deceleration.

    F = F_detect + K v (T + t_latency + t_stop / 2)

with t_stop the time of a stop that goes as far while rates fall linearly.

Workspace studies ask for the force of a speed, :func:`predict_batch`; speed maps for the speed of a force,
:func:`predicted_speed_limit`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.collision import CollisionProblem
from bumpstop.errors import InputError
from bumpstop.study.pose_batch import PoseBatch

if TYPE_CHECKING:
    from bumpstop.collision import Scenario

# Joint rates that change by more than this share of themselves on the way are no longer those of the start.
MAX_TURNING = 0.15
# Forces at which the probability of an alarm is known, from and to so many standard deviations about a threshold.
_POINTS, _FAR = 65, 6.0
# How often the lag of an observer is put right.
_ROUNDS = 12
# Poses at once: arrays of a few megabytes.
_AT_ONCE = 500


@dataclass(frozen=True, eq=False)
class PeakForcePrediction:
    """Predicted peak forces of N poses; NaN where the start is singular, infinite where contact loads no joint.

    Attributes:
        expected: mean peak force (N,) [N].
        bound: peak force (N,) [N] exceeded with a probability of at most 1 - ``quantile``; infinite where not trusted.
        quantile: of the bound.
        undetectable: the largest force along the motion that exceeds no threshold without noise, min_j theta_j / |a_j|
            (N,) [N].
        trigger: the joint whose threshold that is, from 0 (N,).
        gain: largest joint rate per speed of the tip (N,) [rad/m].
        stopping: travel expected between detection and the farthest point (N,) [m].
        trusted: (N,) whether the form holds: joint rates change by no more than :data:`MAX_TURNING` until the arm
            stands, and neither a limit of joint or velocity nor the end of the motion comes before. Elsewhere
            ``expected`` is a guess.
        approach: speed of the contact point along the normal at the start (N,) [m/s].
    """

    expected: FloatArray
    bound: FloatArray
    quantile: float
    undetectable: FloatArray
    trigger: npt.NDArray[np.int64]
    gain: FloatArray
    stopping: FloatArray
    trusted: npt.NDArray[np.bool_]
    approach: FloatArray


def predict(scenario: Scenario, *, quantile: float = 0.999) -> PeakForcePrediction:
    """Predict the peak force of one scenario, N = 1; see :func:`predict_batch`."""
    problem = CollisionProblem.from_scenario(scenario)
    check_predictable(problem, quantile)
    return predict_poses(problem, problem.q[None], problem.velocity[None], quantile)


def predict_batch(
    scenario: Scenario, q: npt.ArrayLike, velocity: npt.ArrayLike, *, quantile: float = 0.999
) -> PeakForcePrediction:
    """Predict the peak forces of many poses and velocities; all else is as in ``scenario``.

    Args:
        scenario: a straight line into clamped contact; its pose and velocity are replaced.
        q: joint positions (N, dof) [rad or m].
        velocity: of the tip, base frame (N, 3) [m/s].
        quantile: of the bound.

    Raises:
        InputError: a shape or value cannot be used, or such a scenario cannot be predicted.
    """
    problem = CollisionProblem.from_scenario(scenario)
    check_predictable(problem, quantile)
    poses = as_float_array(q, "q", (None, problem.robot.dof))
    return predict_poses(problem, poses, as_float_array(velocity, "velocity", (len(poses), 3)), quantile)


def check_predictable(problem: CollisionProblem, quantile: float) -> None:
    """Reject a scenario or quantile that cannot be predicted.

    Raises:
        InputError: names the key.
    """
    if not 0.5 <= quantile <= 1 - 1e-9:
        raise InputError("quantile", f"{quantile:g} cannot be used", "wanted 0.5 to 0.999999999")
    if problem.trajectory is not None:
        raise InputError("motion.kind", "'trajectory' cannot be predicted", "wanted 'line'")
    if problem.elastic:
        raise InputError("arm.model", "an elastic arm cannot be predicted", "wanted 'rigid'")
    if problem.gives_way:
        field = "contact.kind" if problem.gets_away else "contact.damping_Ns_m or contact.gauge_mass_kg"
        raise InputError(field, "only a clamped spring can be predicted", "wanted 'clamped', without damping or mass")
    if problem.residuals is not None:
        raise InputError("detector.residuals", "measured noise cannot be predicted", "give detector.noise_sd_Nm")
    if problem.first_armed_tick > 0:
        raise InputError("detector.arming_delay_s", "a detector that is armed late cannot be predicted", "wanted 0")
    if problem.deceleration.independent:
        problem_text = "0 cannot be predicted: joints that brake by themselves leave the line"
        raise InputError("reaction.stop_category", problem_text, "wanted 1 or 2")
    if not np.isfinite(problem.thresholds).any():
        raise InputError("detector.thresholds_Nm", "monitor no joint", "give one a finite threshold")


def predict_poses(
    problem: CollisionProblem, q: FloatArray, velocity: FloatArray, quantile: float
) -> PeakForcePrediction:
    """Predict the peak forces of a checked problem's arm at poses (N, dof) with tip velocities (N, 3) [m/s]."""
    with np.errstate(all="ignore"):
        parts = [
            _predict(problem, q[first : first + _AT_ONCE], velocity[first : first + _AT_ONCE], quantile)
            for first in range(0, max(1, len(q)), _AT_ONCE)
        ]
    arrays = [field.name for field in fields(PeakForcePrediction) if field.name != "quantile"]
    return PeakForcePrediction(
        quantile=quantile, **{name: np.concatenate([getattr(part, name) for part in parts]) for name in arrays}
    )


def _predict(problem: CollisionProblem, q: FloatArray, velocity: FloatArray, quantile: float) -> PeakForcePrediction:
    K, (cycle, latency), scenario = problem.stiffness, delays(problem), problem.scenario
    start = _Posture.of(problem, q, velocity)
    mean_offset, max_offset, rare = _offsets(problem, start.approach, 1 - quantile)
    # Once at the start, to know where the arm is by then, and there.
    force = detection_force(problem, start.torque, K * start.approach * cycle)
    time = (mean_offset + force / K) / start.approach
    detected = start.after(time)
    force = detection_force(problem, detected.torque, K * detected.approach * cycle)
    # A sub-step begins with its new rates: the arm stands sooner than one that brakes evenly.
    substep = scenario.simulation.step_s / scenario.simulation.substeps
    time_braking = latency + np.maximum(detected.stopping_time - substep, 0) / 2
    # A straight line in joint space says where, an even speed about how far: a guess that turns much stays near it.
    even = detected.approach * time_braking
    stopping = np.clip(detected.travel(time_braking), even / 2, 2 * even)

    late = (max_offset + undetected_force(problem, start.torque, rare) / K) / start.approach + cycle
    end = late + latency + start.stopping_time / 2
    stopped = detected.after(end - time)
    # The bound takes the worst of these postures, and more travel where rates change: a reversing arm lags behind the
    # negative of new ones. Three times their share is found by trial.
    along = (start, detected, stopped)
    signs = np.sign([each.torque for each in along])
    torque = np.where(abs(signs.sum(axis=0)) == 3, np.min([abs(each.torque) for each in along], axis=0), 0.0)
    approach = np.max([each.approach for each in along], axis=0)
    stopping_time = np.max([each.stopping_time for each in along], axis=0)
    rates = np.linalg.norm(start.rates, axis=1)
    turning = np.max([np.linalg.norm(each.rates - start.rates, axis=1) for each in along], axis=0) / rates
    travel = np.maximum(approach * (latency + stopping_time / 2), stopping) * (1 + 3 * turning)
    per_cycle = K * approach * cycle
    bound = detection_bound(problem, torque, per_cycle, rare) + per_cycle + K * travel

    outside = problem.robot.beyond_limits(stopped.q).any(axis=1)
    trusted = (turning <= MAX_TURNING) & ~outside & ~np.any([each.limited for each in along], axis=0)
    trusted &= np.isfinite(bound) & (end <= scenario.motion.duration_s) & (scenario.motion.start != "rest")
    usable = np.isfinite(rates) & (start.approach > 0)
    expected = np.where(np.isfinite(force), force + K * stopping, np.inf)
    each_joint = problem.thresholds / abs(start.torque)
    return PeakForcePrediction(
        expected=np.where(usable, expected, np.nan),
        bound=np.where(usable, np.where(trusted, bound, np.inf), np.nan),
        quantile=quantile,
        undetectable=each_joint.min(axis=1),
        trigger=each_joint.argmin(axis=1),
        gain=abs(start.rates).max(axis=1) / np.linalg.norm(velocity, axis=1),
        stopping=np.where(usable, stopping, np.nan),
        trusted=trusted & usable,
        approach=start.approach,
    )


# --- The parts of the form --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Posture:
    """The arm on its line at poses ``q`` (N, dof) [rad or m].

    Attributes:
        normal: of the contact, base frame (N, 3).
        rates: of the joints (N, dof) [rad/s or m/s].
        torque: a = J_v' n (N, dof) [Nm/N or 1].
        approach: speed of the contact point along the normal (N,) [m/s].
        stopping_time: of the arm, if rates fell linearly over as long a way (N,) [s].
        limited: (N,) whether a joint would have to turn faster than it can.
    """

    problem: CollisionProblem
    q: FloatArray
    velocity: FloatArray
    normal: FloatArray
    rates: FloatArray
    torque: FloatArray
    approach: FloatArray
    stopping_time: FloatArray
    limited: npt.NDArray[np.bool_]

    @classmethod
    def of(
        cls, problem: CollisionProblem, q: FloatArray, velocity: FloatArray, normal: FloatArray | None = None
    ) -> _Posture:
        arms = PoseBatch(problem, q, velocity)
        rates, jacobian = arms.joint_rates(q), arms.linear_jacobian(q)
        # All rates of an arm too slow for its line are lowered in one proportion.
        slower = (problem.robot.velocity / np.maximum(abs(rates), 1e-300)).min(axis=1)
        rates = rates * np.minimum(slower, 1.0)[:, None]
        if normal is None:
            given = problem.scenario.contact.normal
            normal = np.einsum("nij,nj->ni", jacobian, rates) if given is None else np.tile(given, (len(q), 1))
            normal = normal / np.linalg.norm(normal, axis=1)[:, None]
        torque = np.einsum("nij,ni->nj", jacobian, normal)
        approach = np.einsum("nj,nj->n", torque, rates)
        stopping_time = _stopping_time(problem, q, rates)
        return cls(problem, q, velocity, normal, rates, torque, approach, stopping_time, slower < 1)

    def travel(self, time: FloatArray) -> FloatArray:
        """Along the normal (N,) [m] while the joints turn on for so long (N,) [s] as they do, in a straight line."""
        link, point = self.problem.contact_point
        ends = [self.q, self.q + self.rates * time[:, None]]
        at = [self.problem.robot.chain.poses(np.nan_to_num(q), link, point)[:, :3, 3] for q in ends]
        return np.asarray(np.einsum("ni,ni->n", self.normal, at[1] - at[0]))

    def after(self, time: FloatArray) -> _Posture:
        """The arm so much later (N,) [s], by its rates."""
        q = self.q + self.rates * np.clip(time, 0.0, self.problem.scenario.motion.duration_s)[:, None]
        return self.of(self.problem, np.nan_to_num(q), self.velocity, self.normal)


def delays(problem: CollisionProblem) -> tuple[float, float]:
    """Control cycle T and latency [s]."""
    step = problem.scenario.simulation.step_s
    return problem.period_steps * step, problem.latency_steps * step


def detection_force(problem: CollisionProblem, torque: FloatArray, per_cycle: FloatArray) -> FloatArray:
    """Mean force (N,) [N] at detection, as it grows by D = ``per_cycle`` (N,) [N] a control cycle.

    D / 2 + integral of S dF: S is the probability that the cycle at F and those before it, at F - D, F - 2 D ..., are
    without an alarm, and a contact begins anywhere between two cycles.
    """
    mean = -problem.noise_mean * np.sign(torque)
    force, hazard, cumulated = _hazard(problem, torque, mean, _threshold_force(problem, torque, _FAR, mean))
    if not problem.scenario.detector.noise_correlation:
        # The sum over cycles: the last one alone, or an integral where many are close together.
        hazard = np.maximum(hazard, cumulated / per_cycle[:, None] + hazard / 2)
    undetected = np.exp(-hazard)
    width = (force[:, -1] - force[:, 0]) / (_POINTS - 1)
    found = force[:, 0] + width * (undetected.sum(axis=1) - (undetected[:, 0] + undetected[:, -1]) / 2) + per_cycle / 2
    return np.asarray(found + _observer_lag(problem, found, per_cycle))


def detection_bound(
    problem: CollisionProblem, torque: FloatArray, per_cycle: FloatArray, probability: float
) -> FloatArray:
    """Force (N,) [N] of a control cycle up to which at most this share of collisions is without an alarm.

    However the cycles fall: their hazards add up to no less than that of the last, nor than their integral over F / D.
    Of correlated noise the last counts alone.
    """
    last = undetected_force(problem, torque, probability)
    force, hazard, cumulated = _hazard(problem, torque, np.abs(problem.noise_mean), last)
    if not problem.scenario.detector.noise_correlation:
        hazard = np.maximum(hazard, cumulated / per_cycle[:, None])
    enough = hazard >= -math.log(probability)
    found = np.where(enough.any(axis=1), force[np.arange(len(force)), enough.argmax(axis=1)], last)
    return found + _observer_lag(problem, found, per_cycle)


def _hazard(
    problem: CollisionProblem, torque: FloatArray, mean: FloatArray, last: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Forces up to ``last`` (N, M) [N], -log P(no alarm) of a cycle at each, and its integral over the force [N].

    ``mean`` is what the noise's mean adds to the thresholds (dof,) or (N, dof).
    """
    from scipy.special import log_ndtr

    monitored = np.isfinite(problem.thresholds)
    first = np.minimum(np.maximum(_threshold_force(problem, torque, -_FAR, mean), 0.0), last)
    force = first[:, None] + (last - first)[:, None] * np.linspace(0, 1, _POINTS)
    room = np.broadcast_to(problem.thresholds + mean, torque.shape)[:, None, monitored]
    sd = np.maximum(problem.noise_sd, 1e-9 * problem.thresholds)[monitored]
    z = (room - np.abs(torque)[:, None, monitored] * force[:, :, None]) / sd
    hazard = np.asarray(-log_ndtr(z).sum(axis=2))
    steps = np.diff(force, axis=1) * (hazard[:, 1:] + hazard[:, :-1]) / 2
    return force, hazard, np.concatenate([np.zeros((len(force), 1)), np.cumsum(steps, axis=1)], axis=1)


def undetected_force(problem: CollisionProblem, torque: FloatArray, probability: float) -> FloatArray:
    """The largest force (N,) [N] that a single control cycle misses with this probability."""
    return _threshold_force(problem, torque, -NormalDist().inv_cdf(probability), abs(problem.noise_mean))


def _threshold_force(
    problem: CollisionProblem, torque: FloatArray, deviations: float, mean: FloatArray | float = 0.0
) -> FloatArray:
    with np.errstate(divide="ignore"):
        return np.asarray(((problem.thresholds + mean + deviations * problem.noise_sd) / np.abs(torque)).min(axis=1))


def _observer_lag(problem: CollisionProblem, force: FloatArray, per_cycle: FloatArray) -> FloatArray:
    """How far (N,) [N] the force is ahead of an observer's residual of ``force``; 0 for the direct residual."""
    keep = problem.observer_memory
    if keep == 0:
        return np.zeros_like(force)
    # Of a ramp that begins at a tick; a contact that begins between two is followed a little more closely.
    most = per_cycle * (1 + keep) / (2 * (1 - keep))
    lag = most
    for _ in range(_ROUNDS):
        lag = most * -np.expm1(math.log(keep) * (force + lag) / per_cycle)
    return lag


def _offsets(problem: CollisionProblem, approach: FloatArray, rare: float) -> tuple[FloatArray, FloatArray, float]:
    """Mean and greatest distance of the body (N,) [m], and the probability left for late detections."""
    contact = problem.scenario.contact
    if contact.offset_law == "fixed":
        offset = np.full_like(approach, (contact.offset_mm or 0.0) / 1e3)
        return offset, offset, rare
    if contact.offset_law == "uniform":
        farthest = delays(problem)[0] * approach
        return farthest / 2, farthest, rare
    # Half of what may be left out is left to bodies farther away, at both sides of a normal distribution.
    sd = contact.offset_sd_s * approach
    return sd * math.sqrt(2 / math.pi), -sd * NormalDist().inv_cdf(rare / 4), rare / 2


def stopping_time_per_speed(problem: CollisionProblem, rates: FloatArray) -> FloatArray:
    """Time (N,) [s] in which the slowest joint stops from rates (N, dof) at its limit; of rates per speed, [s2/m]."""
    return np.asarray((np.abs(rates) / problem.joint_acceleration).max(axis=1))


def _stopping_time(problem: CollisionProblem, q: FloatArray, rates: FloatArray) -> FloatArray:
    """Of the reaction's law (N,) [s], see :attr:`_Posture.stopping_time`."""
    times = problem.deceleration.times
    if times is None:
        return problem.deceleration.even_time(stopping_time_per_speed(problem, rates))
    return np.asarray(times.by_joint(problem.robot, q, rates).max(axis=1))


def predicted_speed_limit(
    problem: CollisionProblem, undetected: FloatArray, gain: FloatArray, limit: float
) -> FloatArray:
    """Speed (N,) [m/s] whose predicted force reaches the limit: F + K v (T + t_latency + t_stop / 2) = limit.

    With constant deceleration t_stop is v g. Of a stopping table the longest of its times counts.

    Args:
        problem: clamped contact.
        undetected: F, the force that goes undetected (N,) [N], see :func:`undetected_force`.
        gain: g, time to stop at the limits per speed of the tip (N,) [s2/m], see :func:`stopping_time_per_speed`.
        limit: force [N].
    """
    left = np.maximum(0.0, limit - undetected) / problem.stiffness
    late = (problem.period_steps + problem.latency_steps) * problem.scenario.simulation.step_s
    if problem.deceleration.law == "constant":
        return np.asarray(2 * left / (late + np.sqrt(late**2 + 2 * gain * left)))
    # Distances grow with the speed: between standstill and the speed of an arm that stops at once.
    low, high = np.zeros_like(left), left / late
    for _ in range(60):
        speed = (low + high) / 2
        far = speed * (late + problem.deceleration.even_time(speed * gain) / 2) > left
        low, high = np.where(far, low, speed), np.where(far, speed, high)
    return np.asarray(np.where(np.isfinite(gain), low, 0.0))
