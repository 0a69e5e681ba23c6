"""The distribution of a collision that begins at any time of a joint trajectory: a mixture over the time of contact."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from bumpstop import _native
from bumpstop.arrays import FloatArray
from bumpstop.collision.arm_mass import arm_mass_at
from bumpstop.collision.curve import StoppingCurve
from bumpstop.collision.distribution.distribution import NEGLIGIBLE, Distribution, SampledDistribution
from bumpstop.collision.distribution.transient_contact import ImpactBounds, bounds_at
from bumpstop.collision.probability_text import percent
from bumpstop.collision.problem import CollisionProblem
from bumpstop.collision.result import CollisionResult
from bumpstop.collision.trajectory.onset import (
    OnsetQuadrature,
    approach,
    onset_quadrature,
    sample_onsets,
    trajectory_of,
)
from bumpstop.collision.trajectory.onset_mixture import DetectedCollisions, OnsetMixture
from bumpstop.collision.trajectory.trajectory import Trajectory, point_motion
from bumpstop.collision.trajectory.trajectory_curve import trajectory_curve, trajectory_kernel
from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S
from bumpstop.errors import InputError

# Every pair of a contact time and a tick that may detect it takes some 300 bytes of memory.
_MAX_DETECTIONS = 20_000_000
_CONTACTS_AT_ONCE = 500


@dataclass(frozen=True, eq=False, repr=False)
class TrajectoryCollisionResult(CollisionResult):
    """The distribution of one collision over the time of contact and sensor noise.

    ``curve`` is the stopping curve of the onset with the greatest mean force, or of the run with the greatest force;
    ``kernel`` is the compiled trajectory. Runs have ``contact_duration`` [s].

    Attributes:
        times: when contact may begin.
        onset: of ``curve`` [s].
        contact_durations: of a reversing arm, or of a body that gets away [s]; None where the arm stops in clamped
            contact.
        detections: the detected collisions one by one.
        max_undetected_force: the greatest force of a collision never detected [N].
        undetected_force: force of such collisions, given one [N]; of the integrated distribution of clamped contact,
            where there are any.
    """

    kernel: _native.Trajectory = field(kw_only=True)
    times: OnsetQuadrature = field(kw_only=True)
    onset: float = field(kw_only=True)
    contact_durations: Distribution | None = field(kw_only=True)
    detections: DetectedCollisions = field(kw_only=True)
    max_undetected_force: float = field(kw_only=True)
    undetected_force: Distribution | None = field(kw_only=True, default=None)

    @cached_property
    def contact_duration(self) -> Distribution | None:
        """From contact until arm and body separate [s], given that; None where the arm stops in clamped contact."""
        return self.contact_durations

    @cached_property
    def impact_bounds(self) -> ImpactBounds | None:
        """Peak force by formula of an undetected impact at the contact of ``curve``; None for clamped contact."""
        if self.problem.body_mass is None:
            return None
        q = trajectory_of(self.problem).at(self.onset)
        arm = arm_mass_at(
            self.problem.robot, self.scenario.contact, np.ascontiguousarray(q).reshape(-1), self.curve.normal
        )
        return bounds_at(self.problem, self.curve.approach_speed, arm)

    def phase_shares(self, first: float, later: float) -> tuple[Distribution, float]:
        """See :meth:`CollisionResult.phase_shares`."""
        own = self.detections
        max_compression = self.kernel.phases(own.tick.tolist(), own.begin, own.normal, FIRST_PHASE_S)
        share = self.problem.stiffness * np.maximum(max_compression[:, 0] * first, max_compression[:, 1] * later)
        found, weight = own.distribution(share)
        if self.samples is not None:
            weight = own.tick.size / self.samples
        return found, weight

    def curve_at(self, begin: float) -> StoppingCurve:
        """The stopping curve of a contact that begins at a time of the trajectory [s]."""
        return trajectory_curve(self.problem, self.kernel, begin)

    def motion_notes(self) -> list[str]:
        """What was assumed of the motion, and when contact begins."""
        motion, trajectory = self.scenario.motion, trajectory_of(self.problem)
        joined = "cubic Hermite splines" if trajectory.velocity is not None else "a cubic spline"
        notes = [
            f"The arm follows a joint trajectory of {len(trajectory.time)} rows and {trajectory.duration:.4g} s; "
            f"{joined} between the rows. Once it reacts it slows down along that path."
        ]
        if motion.contact_onset_s == "uniform":
            notes.append("Contact begins at any time of the motion with the same probability.")
        else:
            notes.append(f"Contact begins {motion.contact_onset_s:g} s after the start of the motion.")
        if self.times.still > NEGLIGIBLE:
            notes.append(
                f"In {percent(self.times.still)} of the time the contact point does not move toward a body: no contact "
                "begins then, and that time does not count."
            )
        return notes

    def end_notes(self) -> list[str]:
        """How the motion ends, and what braking cannot keep."""
        notes = []
        if self.kernel.acceleration_overload > 1 + 1e-6:
            notes.append(
                "The trajectory's own joint accelerations are up to "
                f"{self.kernel.acceleration_overload:.3g} times those of the "
                "reaction: there the arm brakes as far as it can with the least excess."
            )
        if stops_short(trajectory_of(self.problem)):
            notes.append(
                "The trajectory ends while the arm still moves. It is taken to stand still there at once, so contact "
                "near the end is harder than it says."
            )
        if self.no_contact_probability > NEGLIGIBLE:
            share = percent(self.no_contact_probability, integrated=self.kind == "exact")
            notes.append(f"In {share} of cases the point turns back within a simulation step, and nothing is touched.")
        if self.undetected_probability > NEGLIGIBLE and self.problem.body_mass is None:
            because = self.unbounded_because
            count = "They count with their force"
            if because is not None:
                count = f"They are not detected {because} and count as over every limit, whatever their force"
            share = percent(self.undetected_probability, integrated=self.kind == "exact")
            notes.append(
                f"In {share} of cases the motion ends without a detection. {count}; the greatest of it is "
                f"{self.max_undetected_force:.4g} N."
            )
        return notes

    def why_no_contact(self) -> str:
        """See :meth:`CollisionResult.why_no_contact`."""
        return ": the contact point turns back within a simulation step"

    def approach_cosine(self) -> float:
        """Speed along the contact normal as a share of the contact point's own, over the times of contact."""
        velocity, _ = point_motion(
            trajectory_of(self.problem), self.problem.robot, self.problem.contact_point, self.times.begin
        )
        along = np.einsum("ni,ni->n", velocity, self.times.normal)
        speed = np.maximum(np.linalg.norm(velocity, axis=1), 1e-300)
        return float(self.times.weight @ (along / speed))

    def contact_alone(self) -> dict[str, Any]:
        """See :meth:`CollisionResult.contact_alone`."""
        return {"motion.contact_onset_s": self.onset}

    @property
    def unbounded_because(self) -> str | None:
        """See :attr:`CollisionResult.unbounded_because`."""
        if self.problem.body_mass is not None or not stops_short(trajectory_of(self.problem)):
            return None
        return "before the trajectory (motion.file) ends while the arm still moves"

    def undetected_over(self, force: float) -> float:
        """See :meth:`CollisionResult.undetected_over`."""
        if self.samples is not None or self.unbounded_because is not None:
            return super().undetected_over(force)
        if self.undetected_force is None:
            return 0.0
        return self.undetected_force.exceedance(force) * self.undetected_probability


def stops_short(trajectory: Trajectory) -> bool:
    """Whether a trajectory ends while the arm still moves.

    The last row is no place of rest: a joint is faster there than a hundredth of the greatest speed of all.
    """
    rates = np.abs(trajectory.at(np.linspace(0, trajectory.duration, 500), 1))
    return bool((rates[-1] > 0.01 * rates.max()).any())


def integrate_trajectory(problem: CollisionProblem, *, refinement: int = 1) -> TrajectoryCollisionResult:
    """Integrate over the time of contact and sensor noise."""
    if problem.residuals is not None:
        raise InputError(
            "detector.residuals", "measured residuals have no integrated distribution", "draw it: give samples"
        )
    kernel, times = trajectory_kernel(problem), onset_quadrature(problem, refinement)
    used = np.flatnonzero(times.weight > 0)
    begin, weight, K = times.begin[used], times.weight[used], problem.stiffness
    normal = np.ascontiguousarray(times.normal[used])
    out = _onsets(problem, kernel, begin, normal)
    contact, tick, probability = out["onset"], out["tick"], out["probability"]
    free = problem.gives_way
    mass = weight[contact] * probability
    peak, undetected_peak = (
        (out["peak"], out["undetected_peak"]) if free else (K * out["max_distance"], K * out["undetected_distance"])
    )
    after = out["distance"] >= 0
    never = weight * out["undetected"]
    mixer = OnsetMixture(times, used[contact], tick)
    late = (tick * problem.period_steps + 1) * problem.scenario.simulation.step_s - begin[contact]
    false_alarm = float(weight @ out["false_alarm"])
    detected = float(mass[after].sum()) + false_alarm
    zero = float(weight @ out["zero_force"])
    contact_durations: Distribution | None = None
    undetected_force: Distribution | None = None
    rests = not stops_short(trajectory_of(problem))
    if problem.gets_away or rests:
        # What goes undetected is like what one more tick detects.
        missed = np.flatnonzero(never > 0)
        everything = OnsetMixture(
            times,
            used[np.append(contact, missed)],
            np.append(tick, np.full(missed.size, kernel.ticks, dtype=tick.dtype)),
        )
        all_mass = np.append(mass, never[missed])
        peak_force = everything.distribution(np.append(peak, undetected_peak[missed]), all_mass, zero=zero)
    else:
        peak_force = mixer.distribution(peak, mass, zero=zero, end=(undetected_peak[never > 0], never[never > 0]))
    if free:
        if problem.gets_away:
            lasts = np.append(out["duration"], out["undetected_duration"][missed])
            contact_durations = everything.distribution(np.where(lasts > 0, lasts, math.nan), all_mass)
        elif problem.scenario.reaction.kind == "reverse":
            lasts = out["duration"]
            contact_durations = mixer.distribution(np.where(lasts > 0, lasts, math.nan), mass)
        force = out["force"]
    else:
        if rests and missed.size:
            alone = OnsetMixture(times, used[missed], np.full(missed.size, kernel.ticks, dtype=tick.dtype))
            undetected_force = alone.distribution(undetected_peak[missed], never[missed])
        if problem.scenario.reaction.kind == "reverse":
            contact_durations = mixer.distribution(kernel.contact_durations(tick.tolist(), begin[contact]), mass)
        force = K * out["distance"]
    expected = np.bincount(contact, probability * peak, len(begin)) + out["undetected"] * undetected_peak
    worst_onset = float(begin[int(np.argmax(expected))])
    with np.errstate(invalid="ignore"):
        triggers = np.minimum(1.0, weight @ out["trigger"] / (detected if detected > 0 else math.nan))
    return TrajectoryCollisionResult(
        problem=problem,
        curve=trajectory_curve(problem, kernel, worst_onset),
        kind="exact",
        peak_force=peak_force,
        force_at_detection=mixer.distribution(np.where(after, force, math.nan), mass),
        detection_delay=mixer.distribution(np.where(after, late, math.nan), mass),
        trigger_joint_probability=triggers,
        multi_joint_probability=min(1.0, float(weight @ out["multi_joint"]) / detected) if detected > 0 else math.nan,
        false_alarm_probability=false_alarm,
        undetected_probability=min(1.0, float(never.sum())),
        no_contact_probability=max(0.0, float(weight @ out["no_contact"])),
        kernel=kernel,
        times=times,
        onset=worst_onset,
        contact_durations=contact_durations,
        detections=DetectedCollisions(tick, begin[contact], np.ascontiguousarray(normal[contact]), mass, mixer),
        max_undetected_force=float(undetected_peak.max(where=never > 0, initial=0.0)),
        undetected_force=undetected_force,
    )


# Of onsets, then of their detections.
_COLUMNS = (
    *("false_alarm", "undetected", "no_contact", "multi_joint", "zero_force", "undetected_distance", "trigger"),
    *("undetected_peak", "undetected_duration"),
    *("tick", "probability", "max_distance", "distance", "peak", "duration", "force"),
)


def _onsets(
    problem: CollisionProblem, kernel: _native.Trajectory, begin: FloatArray, normal: FloatArray
) -> dict[str, npt.NDArray[Any]]:
    """The distributions of onsets, some hundreds at a time: of slow motions each has thousands of detections."""
    parts: list[dict[str, npt.NDArray[Any]]] = []
    detections = 0
    for first in range(0, begin.size, _CONTACTS_AT_ONCE):
        own = slice(first, first + _CONTACTS_AT_ONCE)
        found = kernel.integrate(problem.detector, problem.contact, begin[own], normal[own])
        part = {name: getattr(found, name) for name in _COLUMNS} | {"onset": found.onset + first}
        detections += found.onset.size
        if detections > _MAX_DETECTIONS:
            raise InputError(
                "motion.file",
                f"collisions stay undetected for so long that the integrated distribution has more than "
                f"{_MAX_DETECTIONS:,} pairs of a contact time and a control cycle that detects it",
                "draw it: give samples; or give motion.contact_onset_s, or a part of the motion",
            )
        parts.append(part)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def monte_carlo_trajectory(
    problem: CollisionProblem, *, samples: int, seed: int = 0, threads: int = 1
) -> TrajectoryCollisionResult:
    """Draw single collisions: a time of contact, then noise until a joint alarms."""
    kernel, times = trajectory_kernel(problem), onset_quadrature(problem)
    begin = sample_onsets(times, seed, samples)
    normal, _ = approach(problem, begin)
    settings = _native.MonteCarloSettings()
    settings.seed, settings.count, settings.threads = seed, samples, threads
    runs = kernel.monte_carlo(problem.detector, problem.contact, begin, normal, settings, problem.residual_record)
    K, tick = problem.stiffness, runs.tick
    detected = tick >= 0
    undetected = ~detected & (runs.undetected_distance > 0)
    peak = K * np.where(detected, runs.max_distance, runs.undetected_distance)
    tick_time = (tick * problem.period_steps + 1) * problem.scenario.simulation.step_s
    # From the first tick in contact on, also where the point falls back from the body again.
    after_contact = detected & (runs.distance >= 0)
    force = K * np.maximum(0.0, runs.distance)
    free = problem.gives_way
    if free:
        peak, force = runs.peak_force, np.where(detected, runs.force_at_detection, 0.0)
    fired = (runs.triggers[:, None] >> np.arange(problem.robot.dof, dtype=np.uint32)) & 1
    some = bool(detected.any())
    contact_durations = None
    if problem.gets_away or (free and problem.scenario.reaction.kind == "reverse"):
        lasts = runs.duration[(runs.duration > 0) & (detected | problem.gets_away)]
        contact_durations = SampledDistribution(lasts)
    if problem.scenario.reaction.kind == "reverse" and not free:
        lasts = kernel.contact_durations(tick[detected].tolist(), begin[detected])
        contact_durations = SampledDistribution(lasts[np.isfinite(lasts)])
    worst_onset = float(begin[int(np.argmax(peak))])
    return TrajectoryCollisionResult(
        problem=problem,
        curve=trajectory_curve(problem, kernel, worst_onset),
        kind="sampled",
        peak_force=SampledDistribution(
            peak, undetected if not problem.gets_away and stops_short(trajectory_of(problem)) else None
        ),
        force_at_detection=SampledDistribution(force[after_contact]),
        detection_delay=SampledDistribution((tick_time - begin)[after_contact]),
        trigger_joint_probability=fired[detected].mean(axis=0) if some else np.full(problem.robot.dof, math.nan),
        multi_joint_probability=float((fired[detected].sum(axis=1) > 1).mean()) if some else math.nan,
        false_alarm_probability=float((detected & ~after_contact).mean()),
        undetected_probability=float(undetected.mean()),
        no_contact_probability=float((~detected & ~undetected).mean()),
        samples=samples,
        seed=seed,
        runs={
            "onset": begin,
            "offset": np.zeros(samples),
            "tick": tick,
            "triggers": runs.triggers,
            "noise": runs.noise,
            "residual": runs.residual,
            "peak_force": peak,
            "force_at_detection": force,
            "detected_after_contact": after_contact,
        },
        kernel=kernel,
        times=times,
        onset=worst_onset,
        contact_durations=contact_durations,
        detections=DetectedCollisions(
            tick[detected].astype(np.int64), begin[detected], np.ascontiguousarray(normal[detected])
        ),
        max_undetected_force=float(peak.max(where=undetected, initial=0.0)),
    )
