"""Peak force of one collision with a gauge: what is expected, and how far single shots scatter."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bumpstop import _native
from bumpstop.collision.contact_course import arm_in_contact
from bumpstop.collision.distribution.noise import contact_residual
from bumpstop.errors import InputError
from bumpstop.measure.traced_motion import TracedMotion

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision.scenario.scenario import Scenario

# Ticks fall anywhere relative to the contact: so many phases stand for all.
_PHASES = 8
# Reactions that are simulated; the peak force of one that begins between them is interpolated.
_REACTIONS = 8
# Detections rarer than this do not decide where reactions are simulated.
_NEGLIGIBLE = 1e-4
# The motion is followed for so long, doubled until the contact is detected [s].
_FIRST_WINDOW_S, _LAST_WINDOW_S = 0.12, 0.9
# A stopped arm oscillates for so long [s].
_OSCILLATES_S = 0.1
# Where more of the shots are never detected, a clamped gauge would be pressed on and on.
MAX_UNDETECTED = 1e-3


@dataclass(frozen=True)
class ShotForce:
    """Peak force of one shot at a place, over the phase of the control cycle and the noise.

    Attributes:
        force: possible peak forces in ascending order (N,) [N].
        probability: of each (N,).
        undetected: share of shots that are never detected; those against a body that gets away count with their own
            peak force, and of others there are next to none.
    """

    force: FloatArray
    probability: FloatArray
    undetected: float

    @property
    def median(self) -> float:
        """Half of the detected shots stay below [N]."""
        return self.quantile(0.5)

    @property
    def log_mean(self) -> float:
        """Mean of the logarithm of the peak force [log N]."""
        return float(np.average(np.log(self.force), weights=self.probability))

    @property
    def log_sd(self) -> float:
        """Standard deviation of the logarithm of the peak force [1]."""
        deviation = np.log(self.force) - self.log_mean
        return math.sqrt(float(np.average(deviation**2, weights=self.probability)))

    def quantile(self, p: float) -> float:
        """Peak force that a share p of the detected shots stays below [N]."""
        cumulated = (np.cumsum(self.probability) - self.probability / 2) / self.probability.sum()
        return float(np.interp(p, cumulated, self.force))


def shot_force(scenario: Scenario, latency: float | None = None, *, speed: float = 1.0) -> ShotForce:
    """Peak force of a collision at full speed, of clamped and free contact, rigid and elastic arms.

    The motion is traced once, with a reaction that may begin in any simulation step. The undisturbed collision gives
    the residual over time, so the probability of detection at each tick; collisions in which the arm reacts give the
    peak force over the begin of the reaction. The noise counts as white.

    Args:
        scenario: of a line, whose offset and start from rest do not count: the contact is at its pose. Or of a
            trajectory, with the time at which it meets the gauge.
        latency: from detection to the begin of the reaction with its dead time [s]; None: the scenario's.
        speed: of a trajectory, as a share of its own.

    Raises:
        InputError: a trajectory has no such time, or nothing is ever detected.
    """
    late = scenario.reaction.latency_s + scenario.reaction.dead_time_s if latency is None else latency
    window = max(_FIRST_WINDOW_S, 2 * late)
    while True:
        collision = TracedCollision(scenario, window, speed)
        weights = collision.detections(late)
        undetected = max(0.0, 1.0 - float(weights.sum()) / _PHASES)
        over = collision.problem.gets_away or collision.ended or window > _LAST_WINDOW_S
        if undetected < MAX_UNDETECTED or over:
            break
        window *= 2.0
    if undetected > MAX_UNDETECTED and not collision.undetected_counts:
        raise InputError(
            "detector.thresholds_Nm",
            f"{100 * undetected:.3g} % of the shots are never detected: no peak force can be expected",
            "lower thresholds, a higher speed or another place",
        )
    return collision.outcome(weights, late, undetected)


class TracedCollision:
    """A motion against a body that stands a few steps ahead, with ticks in every simulation step."""

    def __init__(self, scenario: Scenario, window: float, speed: float = 1.0) -> None:
        motion = TracedMotion.of(scenario, window, speed)
        self.problem, self.curve, self.offset = motion.problem, motion.curve, motion.offset
        self.period, self.step = motion.period_steps, scenario.simulation.step_s
        self.contact_step, self.ended = motion.contact_step, motion.ended
        # Without a detection the peak force is that of the undisturbed collision.
        self.undetected_counts = self.problem.gets_away or motion.rests
        self.arm = arm_in_contact(self.problem, self.curve, self.offset)
        self.path = self.curve.distance[: motion.contact_step + math.ceil(window / self.step) + 1]
        self.undisturbed = self._course(self.path, self.path.size)

    def _course(self, path: FloatArray, reaction: int) -> _native.ContactCourse:
        return _native.contact_course(
            self.arm, self.problem.contact.body, self.step, np.ascontiguousarray(path), self.offset, reaction
        )

    def _torque(self) -> FloatArray:
        """Contact torque after every step (steps, dof) [Nm]."""
        if self.problem.elastic:
            return np.asarray(self.undisturbed.residual, dtype=np.float64)
        lever = self.curve.torque_per_newton
        rows = np.clip(np.arange(self.path.size) - 1, 0, len(lever) - 1)
        return np.asarray(self.undisturbed.force)[:, None] * lever[rows]

    def detections(self, late: float) -> FloatArray:
        """Probability of detection by phase and tick (phases, ticks)."""
        from scipy.special import log_ndtr

        problem, torque = self.problem, self._torque()[self.contact_step :]
        phase = (np.arange(_PHASES) + 0.5) / _PHASES
        # A reaction must begin within the path that was traced.
        ticks = max(1, int((torque.shape[0] - 1 - late / self.step) / self.period))
        self.begin = (phase[:, None] + np.arange(ticks)) * self.period
        at = np.minimum(self.begin, torque.shape[0] - 1)
        low = np.minimum(at.astype(int), torque.shape[0] - 2)
        share = (at - low)[..., None]
        here = torque[low] * (1 - share) + torque[low + 1] * share
        # The observer's memory is that of a whole period, not of one step.
        observed = replace(problem, period_steps=self.period)
        residual = np.stack([contact_residual(observed, row) for row in here])
        sd = np.maximum(problem.noise_sd, 1e-9 * np.where(np.isfinite(problem.thresholds), problem.thresholds, 1.0))
        over = (np.abs(residual + problem.noise_mean) - problem.thresholds) / sd
        quiet = np.where(np.isfinite(problem.thresholds), log_ndtr(-over), 0.0).sum(axis=-1)
        alarm = -np.expm1(quiet)
        before = np.exp(np.cumsum(quiet, axis=1) - quiet)
        return np.asarray(alarm * before, dtype=np.float64)

    def outcome(self, weights: FloatArray, late: float, undetected: float) -> ShotForce:
        """Peak forces with their probabilities."""
        begin = self.contact_step + self.begin + late / self.step
        chosen = weights > _NEGLIGIBLE
        if not chosen.any():
            chosen = weights == weights.max()
        last = self.path.size - 2
        low, high = int(begin[chosen].min()), min(math.ceil(begin[chosen].max()), last)
        low = min(low, high)
        nodes = np.unique(np.round(np.linspace(low, high, min(_REACTIONS, high - low + 1))).astype(int))
        peaks = self._reacting(nodes)
        forces = np.interp(np.clip(begin[chosen], low, high), nodes, peaks)
        probability = weights[chosen] / _PHASES
        if self.undetected_counts and undetected > 0:
            forces, probability = np.append(forces, self.undisturbed.peak), np.append(probability, undetected)
        order = np.argsort(forces, kind="stable")
        return ShotForce(forces[order], probability[order], undetected)

    def _reacting(self, begins: FloatArray) -> FloatArray:
        """Peak force where the arm begins to react at a step (begins,) [N]."""
        ticks = [int(begin) - 1 for begin in begins]
        paths = self.curve.kernel.reaction_paths(ticks, [self.offset] * len(ticks))
        stops = self.problem.scenario.reaction.kind == "stop"
        stand = math.ceil(_OSCILLATES_S / self.step) if self.problem.gives_way and stops else 0
        peaks = np.empty(len(ticks))
        for i, (begin, reaction) in enumerate(zip(begins, paths, strict=True)):
            path = np.concatenate([self.path[: int(begin)], reaction])
            if stand:
                path = np.append(path, np.full(stand, path[-1]))
            peaks[i] = self._course(path, int(begin)).peak
            if stops and not self.problem.gets_away:
                peaks[i] = max(peaks[i], self._static_stiffness * max(0.0, float(path[-1]) - self.offset))
        return peaks

    @cached_property
    def _static_stiffness(self) -> float:
        """Of arm and body at rest, as the distribution has it: ``1 / (1/K + sum a^2 (1/Kg + 1/P))`` [N/m]."""
        body = self.problem.contact.body
        compliance = 1 / body.stiffness
        if body.ground_stiffness > 0:
            compliance += 1 / body.ground_stiffness
        if self.problem.elastic:
            from bumpstop.model import mass_matrix

            drive = self.problem.drive_train
            inertia = drive.rotor_inertia + np.diag(mass_matrix(self.problem.robot, self.problem.q))
            servo = drive.servo_position_gain * drive.servo_bandwidth * inertia
            lever = self.curve.torque_per_newton[min(self.contact_step, self.curve.ticks - 1)]
            compliance += float((lever**2 * (1 / drive.gear_stiffness + 1 / servo)).sum())
        return 1 / compliance
