"""Single collisions, followed in time: the distribution says how often, a rollout shows how."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bumpstop import _native
from bumpstop.arrays import FloatArray
from bumpstop.collision import monte_carlo
from bumpstop.collision.contact_course import contact_course
from bumpstop.collision.distribution.noise import contact_residual, noise_of_run
from bumpstop.collision.trajectory.trajectory_evaluation import monte_carlo_trajectory
from bumpstop.collision.trajectory.trajectory_result import TrajectoryCollisionResult

if TYPE_CHECKING:
    from bumpstop.collision import CollisionProblem, CollisionResult

# Runs to choose from where the distribution itself has none: some twenty lie beyond the 99 % quantile.
_SAMPLES = 2000
# How long a stopped arm that gives way is shown [s].
_OSCILLATES_S = 0.1
# By how much the oscillation of a body that gets away may turn between two times that are drawn [rad].
_TURN = 0.02


@dataclass(frozen=True, eq=False)
class Rollout:
    """One collision in time. Time zero is the touch; without one the detection, and without that the start.

    Attributes:
        run, seed: which sampled run it is.
        offset: distance from the start to the body along the normal [m]; zero in a trajectory.
        stiffness: of the body [N/m].
        time: of every simulation step, and between them while a body that gets away is touched (times,) [s].
        distance: of the contact point along the normal at those times (times,) [m].
        displacement: of a body that gets away (times,) [m]; zero where it is clamped.
        peak_force: the greatest at those times; of a body that gets away the distribution's own, between them too [N].
        touch: when the point first reaches the body [s], or None.
        detection: the tick that detected [s], or None.
        reaction: when the arm began to react [s], or None.
        joint: whose residual is shown, from 0: of those that fired the one farthest over its threshold.
        tick_time: feedback ticks up to the detection (ticks,) [s].
        residual: of that joint at those ticks: contact torque and noise (ticks,) [Nm or N].
        contact_torque: the part of the contact alone (ticks,) [Nm or N].
        threshold: of that joint [Nm or N]; infinite where it is not monitored.
    """

    run: int
    seed: int
    offset: float
    stiffness: float
    time: FloatArray
    distance: FloatArray
    displacement: FloatArray
    peak_force: float
    touch: float | None
    detection: float | None
    reaction: float | None
    joint: int
    tick_time: FloatArray
    residual: FloatArray
    contact_torque: FloatArray
    threshold: float

    @cached_property
    def force(self) -> FloatArray:
        """Contact force at those times (times,) [N]: the body answers as a spring."""
        return _force(self.stiffness, self.distance, self.offset, self.displacement)


class Rollouts:
    """The runs behind a result: its own, or for an integrated one some drawn on the same stopping curve."""

    def __init__(self, result: CollisionResult) -> None:
        self._result = result
        sampled = result if result.runs is not None else _sampled(result)
        assert sampled.runs is not None
        assert sampled.seed is not None
        self._runs: dict[str, npt.NDArray[Any]] = sampled.runs
        self.seed = sampled.seed

    def nearest(self, p: float) -> Rollout:
        """The run whose peak force is nearest the distribution's quantile at ``p``.

        Where that quantile lies in the undetected share: an undetected run with a middling offset. In a trajectory then
        the run nearest the quantile of all sampled forces, as those of undetected runs are known.
        """
        peak, offset, tick = self._runs["peak_force"], self._runs["offset"], self._runs["tick"]
        wanted = self._result.peak_force.quantile(p)
        if math.isfinite(wanted):
            # Without a bound, runs never detected count as beyond every quantile, whatever force is left at the end.
            bounded = self._result.unbounded_because is None
            missed = np.where((tick >= 0) | bounded, np.abs(peak - wanted), math.inf)
        elif isinstance(self._result, TrajectoryCollisionResult):
            # The force of a run never detected is known, too: the arm stops at the end of its trajectory.
            missed = np.abs(peak - np.quantile(peak, p))
        else:
            undetected = (tick < 0) & (peak > 0)
            middle = np.median(offset[undetected]) if undetected.any() else 0.0
            missed = np.where(undetected, np.abs(offset - middle), math.inf)
        return self.rollout(int(np.argmin(missed)))

    def rollout(self, run: int) -> Rollout:
        """Follow one run from the start of the motion until the force is gone, or the motion ends."""
        problem, curve = self._result.problem, self._result.curve
        if isinstance(self._result, TrajectoryCollisionResult):
            curve = self._result.curve_at(float(self._runs["onset"][run]))
        offset, tick = float(self._runs["offset"][run]), int(self._runs["tick"][run])
        step, period = problem.scenario.simulation.step_s, problem.period_steps
        distance: FloatArray = curve.distance
        begin = None
        if tick < 0:
            # The path goes on for a latency beyond the motion's end, for the reactions.
            distance = distance[: _motion_steps(self._result, distance) + 1]
            reaction = distance.size - 1
            if curve.end in ("joint_limit", "singularity"):
                distance = np.append(distance, curve.line.braking)
        else:
            # An arm that cannot follow its line as far brakes where it ends.
            begin = min(tick * period + 1 + problem.latency_steps, distance.size - 1)
            # The reaction's path starts with the step in which it begins.
            reaction = begin
            distance = np.concatenate([distance[:begin], curve.kernel.reaction_paths([tick], [offset])[0]])
        displacement = np.zeros_like(distance)
        course = None
        if problem.gives_way:
            path = distance.size
            distance = np.append(distance, np.full(_settling_steps(problem, tick), distance[-1]))
            course = contact_course(problem, curve, distance, offset, reaction)
            displacement = np.maximum(0.0, distance - offset) - course.force / problem.stiffness
            if problem.gets_away:
                end = max(path, int(np.flatnonzero(course.force > 0).max(initial=-2)) + 2)
                distance, displacement = distance[:end], displacement[:end]
        time: FloatArray = np.arange(distance.size, dtype=np.float64) * step
        touch = _first_passage(distance, time, offset)
        detection = None if tick < 0 else float(curve.tick_time[tick])
        zero = touch if touch is not None else detection if detection is not None else 0.0

        ticks = tick + 1 if tick >= 0 else curve.ticks
        # The arm looks before it reacts: its own path and this one are the same up to the last of these ticks.
        pushed = displacement[np.arange(ticks) * period + 1]
        force = problem.stiffness * np.maximum(0.0, curve.tick_distance[:ticks] - offset - pushed)
        torque = curve.torque_per_newton[:ticks] * force[:, None]
        if course is not None and problem.elastic:
            torque = course.residual[np.arange(ticks) * period + 1]
        torque = contact_residual(problem, torque)
        residual = torque + noise_of_run(problem, self.seed, run, ticks)
        # Of unmonitored joints, the one that the force loads most; any, where the motion ends before the first tick.
        over = np.abs(residual[-1:]) / problem.thresholds
        joint = int(np.argmax(over if over.any() else np.abs(torque[-1:]))) if ticks else 0
        peak = float(_force(problem.stiffness, distance, offset, displacement).max())
        if problem.gets_away and not problem.elastic:
            time, distance, displacement = _between_steps(problem, time, distance, displacement, offset)
        if problem.gets_away or (problem.gives_way and tick >= 0):
            peak = float(self._runs["peak_force"][run])
        return Rollout(
            run=run,
            seed=self.seed,
            offset=offset,
            stiffness=problem.stiffness,
            time=time - zero,
            distance=distance,
            displacement=displacement,
            peak_force=peak,
            touch=None if touch is None else touch - zero,
            detection=None if detection is None else detection - zero,
            reaction=None if begin is None else begin * step - zero,
            joint=joint,
            tick_time=curve.tick_time[:ticks] - zero,
            residual=residual[:, joint],
            contact_torque=torque[:, joint],
            threshold=float(problem.thresholds[joint]),
        )


def _sampled(result: CollisionResult) -> CollisionResult:
    if isinstance(result, TrajectoryCollisionResult):
        return monte_carlo_trajectory(result.problem, result.evaluate, samples=_SAMPLES, seed=0)
    return monte_carlo(result.problem, result.curve, samples=_SAMPLES, seed=0)


def _motion_steps(result: CollisionResult, distance: FloatArray) -> int:
    """Simulation steps until an undetected motion ends."""
    problem = result.problem
    if isinstance(result, TrajectoryCollisionResult):
        return distance.size - 1 - problem.latency_steps
    return round(problem.scenario.motion.duration_s / problem.scenario.simulation.step_s)


def _settling_steps(problem: CollisionProblem, tick: int) -> int:
    """Simulation steps in which an arm that stands still goes on oscillating, or a body gets away from it."""
    seconds = 0.0
    if problem.elastic and tick >= 0 and problem.scenario.reaction.kind == "stop":
        seconds += _OSCILLATES_S
    if problem.gets_away:
        seconds += math.pi * math.sqrt(problem.moving_mass / problem.stiffness)
    return math.ceil(seconds / problem.scenario.simulation.step_s)


def _between_steps(
    problem: CollisionProblem, time: FloatArray, distance: FloatArray, pushed: FloatArray, offset: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of a rigid arm at times between the steps, too, while it touches: a light body rings faster than they come."""
    touched = np.flatnonzero(distance - offset > pushed)
    if not touched.size:
        return time, distance, pushed
    first, last = max(int(touched[0]) - 1, 0), min(int(touched[-1]) + 1, time.size - 1)
    step, frequency = problem.scenario.simulation.step_s, math.sqrt(problem.stiffness / problem.moving_mass)
    parts = max(4, math.ceil(frequency * step / _TURN))
    fine = np.linspace(time[first], time[last], (last - first) * parts + 1)
    path = np.interp(fine, time, distance)
    course = _native.contact_course(_native.ElasticArm(), problem.contact.body, step / parts, path, offset, 0)
    moved = np.maximum(0.0, path - offset) - course.force / problem.stiffness

    def joined(steps: FloatArray, between: FloatArray) -> FloatArray:
        return np.concatenate([steps[:first], between, steps[last + 1 :]])

    return joined(time, fine), joined(distance, path), joined(pushed, moved)


def _force(stiffness: float, distance: FloatArray, offset: float, displacement: FloatArray) -> FloatArray:
    return np.asarray(stiffness * np.maximum(0.0, distance - offset - displacement))


def _first_passage(distance: FloatArray, time: FloatArray, offset: float) -> float | None:
    """When the distance first passes the offset, linear between steps; None: never."""
    beyond = np.flatnonzero(distance > offset)
    if not beyond.size:
        return None
    i = int(beyond[0])
    if i == 0:
        return float(time[0])
    share = (offset - distance[i - 1]) / (distance[i] - distance[i - 1])
    return float(time[i - 1] + share * (time[i] - time[i - 1]))
