"""Force laws: the whole distribution of one collision, exact or sampled."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray, as_whole_number
from bumpstop.collision.curve import AT_REST, StoppingCurve, stopping_curve
from bumpstop.collision.distribution.contact_duration import (
    first_passage_times,
    integrated_contact_duration,
    monte_carlo_contact_duration,
)
from bumpstop.collision.distribution.distribution import (
    NEGLIGIBLE,
    Distribution,
    ExactDistribution,
    SampledDistribution,
)
from bumpstop.collision.distribution.monte_carlo_blocks import Progress, block_seed, in_blocks
from bumpstop.collision.distribution.transient_contact import ImpactBounds, TransientQuantities, impact_bounds
from bumpstop.collision.notes import notes_of
from bumpstop.collision.problem import CollisionProblem
from bumpstop.collision.scenario.scenario import as_scenario
from bumpstop.collision.verdict.alarm_rate import alarm_rate
from bumpstop.collision.verdict.two_phase import TwoPhaseUse, phase_shares
from bumpstop.collision.verdict.verdict import Verdict, judge, percent
from bumpstop.collision.verdict.verdict_notes import nothing_hit, verdict_notes
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario import Scenario


# Runs of a law that can only be sampled, where their number is not given.
RESAMPLED_RUNS = 100_000


@dataclass(frozen=True, eq=False, repr=False)
class CollisionResult:
    """The distribution of one collision over contact offset and sensor noise.

    Attributes:
        problem: the checked scenario.
        curve: its stopping curve.
        kind: ``"exact"`` or ``"sampled"``; ``samples`` and ``seed`` belong to the latter.
        peak_force: [N]; a collision never detected counts with the greatest force of a motion that comes to rest, and
            as unbounded where only the simulated time ended the motion (:attr:`unbounded_because`).
        force_at_detection: [N], given a detection after contact.
        detection_delay: from contact to the tick that detects it [s], given the same.
        trigger_joint_probability: (dof,) joint over its threshold at the tick of detection, given detection. Sums to
            more than 1 where joints fire together.
        multi_joint_probability: two or more joints at that tick, given detection.
        false_alarm_probability: detection before contact.
        undetected_probability: contact, but no detection by the end of the motion.
        no_contact_probability: neither contact nor alarm by the end of the motion.
        runs: of the sampled law: offset [m], tick (-1: never), triggers (bit j: joint j + 1), noise and residual, and
            whether it was ``felt``: detected after contact.
        transient_contact_duration: of free contact, until the body has got away [s].
    """

    problem: CollisionProblem
    curve: StoppingCurve
    kind: Literal["exact", "sampled"]
    peak_force: Distribution
    force_at_detection: Distribution
    detection_delay: Distribution
    trigger_joint_probability: FloatArray
    multi_joint_probability: float
    false_alarm_probability: float
    undetected_probability: float
    no_contact_probability: float
    samples: int | None = None
    seed: int | None = None
    runs: dict[str, npt.NDArray[Any]] | None = None
    kernel: Any = None
    transient_contact_duration: Distribution | None = None

    def __repr__(self) -> str:
        """What hits how hard: its arrays would fill screens."""
        who, verdict = f"{self.problem.robot.name} {self.problem.motion_in_words}", self.verdict.acceptable
        return f"{type(self).__name__}({self.kind}, {who}, acceptable={verdict}, peak_force={self.peak_force!r})"

    @property
    def scenario(self) -> Scenario:
        """The scenario as given."""
        return self.problem.scenario

    @property
    def pressure(self) -> Distribution:
        """Peak pressure [N/cm2]: peak factor times peak force over contact area."""
        contact = self.scenario.contact
        return self.peak_force.scaled(contact.peak_factor / contact.area_cm2)

    @property
    def compression(self) -> Distribution:
        """Deepest compression of the body [mm]: peak force over stiffness."""
        return self.peak_force.scaled(1e3 / self.problem.body_stiffness)

    @cached_property
    def contact_duration(self) -> Distribution | None:
        """From contact until arm and body have parted [s], given that; None where the arm stops in clamped contact."""
        if self.problem.body_mass is not None:
            return self.transient_contact_duration
        if self.scenario.reaction.kind == "stop":
            return None
        if self.kind == "exact":
            return self._integrated_contact_duration[0]
        assert self.runs is not None
        times = monte_carlo_contact_duration(self.problem, self.curve.kernel, self.runs["tick"], self.runs["offset"])
        return SampledDistribution(times[np.isfinite(times)])

    @cached_property
    def _integrated_contact_duration(self) -> tuple[Distribution, float]:
        return integrated_contact_duration(self.problem, self.curve.kernel, self.kernel)

    @property
    def left_in_contact_probability(self) -> float:
        """Detected, and still in clamped contact where the reversing arm is followed no farther; exact laws only."""
        if self.kind != "exact" or self.problem.body_mass is not None or self.scenario.reaction.kind == "stop":
            return 0.0
        return self._integrated_contact_duration[1]

    @cached_property
    def verdict(self) -> Verdict:
        """Judged by the limits of the body region, or with ``acceptable`` None where only a stiffness was given.

        So it is, too, where most cases touch nothing. What else weakens the verdict is in :attr:`warnings`.
        """
        return judge(
            self.peak_force,
            self.pressure,
            self.problem.limits,
            self.false_alarm_probability,
            # One whose force is known has that force all the same: no failure by itself.
            0.0 if self.unbounded_because is None else self.undetected_probability,
            self.scenario.verdict,
            transient=self.problem.transient_limits,
            over=self._over_in_two_phases,
            unbounded_because=self.unbounded_because or "",
            nothing_hit=nothing_hit(self),
            false_alarms_per_hour=alarm_rate(self.problem).per_hour,
        )

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What makes the verdict mean less than it says: to be read beside it."""
        return tuple(verdict_notes(self))

    def why_no_contact(self) -> str:
        """Why a motion ends before contact, to follow those words."""
        motion, curve = self.scenario.motion, self.curve
        if curve.end == "joint_limit":
            return f" where joint {curve.end_joint} reaches its limit"
        if curve.end == "singularity":
            return " at a singularity"
        return f" after {motion.duration_s:g} s (motion.duration_s)"

    def approach_cosine(self) -> float:
        """Speed along the contact normal as a share of the contact point's own, at the start of the motion."""
        return self.problem.approach_speed / float(np.linalg.norm(self.problem.start["point_velocity"]))

    def contact_alone(self) -> dict[str, Any]:
        """Keys that leave one contact of many; empty where there is but one."""
        return {}

    @property
    def unbounded_because(self) -> str | None:
        """Why a collision never detected has no bound on its force, to follow "not detected"; None where it has one.

        A free body has got away, and an arm that has come to rest presses no harder.
        """
        if self.problem.body_mass is not None or self.curve.end in AT_REST:
            return None
        return f"within {self.scenario.motion.duration_s:g} s (motion.duration_s)"

    def motion_notes(self) -> list[str]:
        """Where the body is."""
        problem, contact = self.problem, self.scenario.contact
        if contact.offset_law == "half_normal":
            return [
                f"The body is a half-normal distance away, sd {problem.offset_size * 1e3:.4g} mm "
                f"({contact.offset_sd_s:g} s of travel)."
            ]
        if contact.offset_law == "uniform":
            return [f"The body is 0 to {problem.offset_size * 1e3:.4g} mm away, evenly: one feedback period of travel."]
        return []

    def end_notes(self) -> list[str]:
        """How the motion ends, where that is not as asked for."""
        curve, notes = self.curve, []
        ends = {
            "joint_limit": f"The motion ends after {_end_time(self):.3g} s: joint {curve.end_joint} reaches its limit.",
            "singularity": f"The motion ends after {_end_time(self):.3g} s near a singularity.",
        }
        if curve.end in ends:
            notes.append(ends[curve.end])
        if curve.kernel.velocity_limited:
            notes.append("A joint-velocity limit slows the motion below the speed asked for.")
        if self.undetected_probability > NEGLIGIBLE and self.problem.body_mass is None:
            notes.append(self._undetected_note())
        if self.no_contact_probability > NEGLIGIBLE:
            notes.append(f"In {percent(self.no_contact_probability)} of cases the motion ends before contact.")
        return notes

    def _undetected_note(self) -> str:
        share = percent(self.undetected_probability)
        share = share[0].upper() + share[1:]
        if self.unbounded_because is None:
            return (
                f"{share} of collisions are not detected before the motion ends. They count with the greatest force "
                "until then, and then the arm stands."
            )
        return (
            f"{share} of collisions are not detected {self.unbounded_because}. They count as over every limit: their "
            "force has no bound and the mean is not given."
        )

    @cached_property
    def _over_in_two_phases(self) -> tuple[float, float | None] | None:
        """Probability of passing the force and the pressure limit of either phase; None where contact has one phase."""
        transient, lasting = self.problem.transient_limits, self.problem.limits
        if transient is None or lasting is None:
            return None
        if not transient.permitted:
            return 1.0, 1.0
        use = TwoPhaseUse.of(self, transient, lasting)
        # An arm that has come to rest goes on pressing: the limit for what lasts judges those never detected.
        force = self.undetected_over(lasting.force_N)
        pressure = None
        if use.pressure is not None and lasting.pressure_N_cm2 is not None:
            contact = self.scenario.contact
            per_newton = contact.peak_factor / contact.area_cm2
            pressure = use.over(use.pressure, self.undetected_over(lasting.pressure_N_cm2 / per_newton))
        return use.over(use.force, force), pressure

    def undetected_over(self, force: float) -> float:
        """P(a collision is never detected and its force exceeds ``force`` [N]); all of them where there is no bound."""
        if self.unbounded_because is not None:
            return self.undetected_probability
        if self.runs is not None:
            missed = (self.runs["tick"] < 0) & (self.runs["offset"] < self.curve.distance.max())
            return float((missed & (self.runs["peak_force"] > force)).mean())
        return float(self.kernel.tail("end_force", np.array([force]))[0, 0])

    def phase_shares(self, first: float, later: float) -> tuple[Distribution, float]:
        """How far detected clamped collisions use the limits of two phases, and the probability of these collisions.

        Args:
            first: share of its limit that a newton takes in the first half second of contact.
            later: the same after that.
        """
        return phase_shares(self, first, later)

    @cached_property
    def impact_bounds(self) -> ImpactBounds | None:
        """Peak force of an undetected free impact by formula; None for clamped contact."""
        return impact_bounds(self.problem)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """What was assumed, and what was cut short."""
        return tuple(notes_of(self))

    def to_json(self) -> dict[str, Any]:
        """The object that ``bumpstop evaluate --json`` prints; figures that are not finite are None."""
        contact_duration = self.contact_duration
        result: dict[str, Any] = {
            "peak_force_N": self.peak_force.to_json(),
            "pressure_N_cm2": self.pressure.to_json(),
            "compression_mm": self.compression.to_json(),
            "force_at_detection_N": self.force_at_detection.to_json(),
            "detection_delay_s": self.detection_delay.to_json(),
            "contact_duration_s": None if contact_duration is None else contact_duration.to_json(),
            "trigger_joint_probability": [_finite(p) for p in self.trigger_joint_probability],
            "multi_joint_probability": _finite(self.multi_joint_probability),
            "false_alarm_probability": self.false_alarm_probability,
            "undetected_probability": self.undetected_probability,
            "no_contact_probability": self.no_contact_probability,
            "law": self.kind,
        }
        if self.impact_bounds is not None:
            result["impact_bounds"] = self.impact_bounds.to_json()
        if self.kind == "sampled":
            result |= {"samples": self.samples, "seed": self.seed}
        verdict = self.verdict.to_json() | {"warnings": list(self.warnings)}
        return result | {"verdict": verdict, "notes": list(self.notes)}


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def evaluate(
    scenario: Scenario,
    *,
    samples: int | None = None,
    seed: int = 0,
    threads: int = 1,
    refinement: int = 1,
    progress: Progress | None = None,
) -> CollisionResult:
    """Work out the whole distribution of a collision.

    Args:
        scenario: what happens.
        samples: None for the exact law; else the number of runs of the sampled law. Measured residuals know no exact
            law: None then means 100 000 runs. Of more than a million runs only the first million are kept one by one.
        seed: of the sampled law, 0 to 2^64 - 1. The same seed gives the same runs, whatever the threads.
        threads: for the sampled law, 1 to 256.
        refinement: multiplies the order of the exact law's quadrature, 1 to 100. 2 shows that 1 is converged.
        progress: told the share of the runs of the sampled law that are done.

    Raises:
        InputError: the scenario cannot be computed.
    """
    problem = CollisionProblem.from_scenario(as_scenario(scenario))
    refinement = as_whole_number(refinement, "refinement", 1, 100)
    as_whole_number(threads, "threads", 1, 256)
    as_whole_number(seed, "seed", 0, 2**64 - 1, "0 to 2^64 - 1")
    if samples is not None:
        _check_sample(samples, seed, threads)
    elif problem.residuals is not None:
        samples = RESAMPLED_RUNS
    if problem.trajectory is not None:
        from bumpstop.collision.trajectory.trajectory_result import integrate_trajectory, monte_carlo_trajectory

        if samples is None:
            return integrate_trajectory(problem, refinement=refinement)
        return in_blocks(
            lambda first, size: monte_carlo_trajectory(
                problem, samples=size, seed=block_seed(seed, first), threads=threads
            ),
            samples,
            progress,
        )
    curve = stopping_curve(problem)
    if samples is None:
        return integrate(problem, curve, refinement=refinement)
    return in_blocks(
        lambda first, size: monte_carlo(problem, curve, samples=size, seed=seed, threads=threads, first=first),
        samples,
        progress,
    )


def integrate(problem: CollisionProblem, curve: StoppingCurve, *, refinement: int = 1) -> CollisionResult:
    """Integrate over contact offset and noise on a stopping curve of this problem's pose, motion and reaction.

    Args:
        problem: a checked scenario.
        curve: of :func:`stopping_curve`; traced whole it serves other bodies, offsets, thresholds and noise, too.
        refinement: multiplies the order of the quadrature.

    Raises:
        InputError: the noise is measured residuals, of which there are only samples.
    """
    if problem.residuals is not None:
        raise InputError("detector.residuals", "measured residuals have no exact law", "draw it: give samples")
    question = (problem.detector, problem.stiffness, problem.offset_kind, problem.offset_size)
    law = curve.kernel.exact_law(*question, refinement, problem.moving_mass)
    undetected = min(1.0, max(0.0, law.undetected))
    after_contact = law.total("force_at_detection")
    detected = after_contact + law.false_alarm
    with np.errstate(invalid="ignore"):
        triggers = np.minimum(1.0, np.asarray(law.trigger) / (detected if detected > 0 else math.nan))
    if problem.body_mass is not None:
        free = TransientQuantities(law)
        peak_force: Distribution = free.peak_force()
        force_at_detection: Distribution = free.force_at_detection()
        contact_duration: Distribution | None = free.contact_duration()
    else:
        peak_force = ExactDistribution(
            law,
            "peak_force",
            undetected=0.0 if law.rests else undetected,
            bounded=curve.end != "horizon",
            far_tail=lambda force: float(curve.kernel.tail_directly(*question, force)),
        )
        force_at_detection = ExactDistribution(law, "force_at_detection", condition=after_contact)
        contact_duration = None
    return CollisionResult(
        problem=problem,
        curve=curve,
        kind="exact",
        peak_force=peak_force,
        force_at_detection=force_at_detection,
        transient_contact_duration=contact_duration,
        detection_delay=ExactDistribution(law, "detection_delay", condition=after_contact),
        trigger_joint_probability=triggers,
        multi_joint_probability=min(1.0, law.several / detected) if detected > 0 else math.nan,
        false_alarm_probability=law.false_alarm,
        undetected_probability=undetected,
        no_contact_probability=max(0.0, law.no_contact),
        kernel=law,
    )


def monte_carlo(
    problem: CollisionProblem, curve: StoppingCurve, *, samples: int, seed: int = 0, threads: int = 1, first: int = 0
) -> CollisionResult:
    """Draw single collisions on a stopping curve of this problem's pose, motion and reaction.

    Args:
        problem: a checked scenario.
        curve: as for :func:`integrate`.
        samples: number of collisions.
        seed: 0 to 2^64 - 1. The same seed gives the same collisions, whatever the threads.
        threads: that share the work.
        first: number of the first of them.

    Raises:
        InputError: no samples, or a seed that is none.
    """
    _check_sample(samples, seed, threads)
    runs = curve.kernel.sample(
        problem.detector,
        problem.stiffness,
        problem.offset_kind,
        problem.offset_size,
        seed,
        first,
        samples,
        True,
        threads,
        problem.residuals.rows if problem.residuals is not None else None,
        problem.residuals.block_rows if problem.residuals is not None else 1,
        problem.moving_mass,
    )
    offset, tick = runs["offset"], runs["tick"]
    detected = tick >= 0
    at = np.where(detected, tick, 0)
    K, step = problem.stiffness, problem.scenario.simulation.step_s

    def at_tick(values: FloatArray) -> FloatArray:
        # A motion that ends before the first tick has none to look up, and no detection.
        return values[at] if values.size else np.zeros(at.shape)

    peak = K * np.maximum(0.0, at_tick(curve.farthest) - offset)
    # The path goes on for a latency beyond the horizon, for the reactions; the motion does not.
    motion = curve.distance[: _horizon(problem) + 1]
    braking = curve.kernel.braking if curve.end in ("joint_limit", "singularity") else np.zeros(0)
    if problem.body_mass is not None:
        motion, braking = np.append(motion, braking), np.zeros(0)
    touches = offset < motion.max()
    # A body that the arm reaches only while it brakes at the end of its line is pressed as deep as any other.
    greatest = K * np.maximum(0.0, max(motion.max(), braking.max(initial=-math.inf)) - offset)
    missed = ~detected & touches
    peak = np.where(detected, peak, np.where(missed & (curve.end == "horizon"), math.inf, greatest))
    force = K * np.maximum(0.0, at_tick(curve.tick_distance) - offset)
    transient_contact_duration = None
    # From the first tick in contact on, also where the arm falls back from the body again.
    felt = detected & (tick >= np.searchsorted(np.maximum.accumulate(curve.tick_distance), offset, side="right"))
    if problem.body_mass is not None:
        peak, force = runs["peak_force"], np.where(detected, runs["force_at_detection"], 0.0)
        felt = detected & (force > 0)
        transient_contact_duration = SampledDistribution(runs["duration"][runs["duration"] > 0])
    delay = at_tick(curve.tick_time) - first_passage_times(curve.distance, offset, step)
    dof = problem.robot.dof
    fired = (runs["triggers"][:, None] >> np.arange(dof, dtype=np.uint32)) & 1
    some = detected.any()
    return CollisionResult(
        problem=problem,
        curve=curve,
        kind="sampled",
        peak_force=SampledDistribution(peak, None if problem.body_mass is not None or curve.end in AT_REST else missed),
        transient_contact_duration=transient_contact_duration,
        force_at_detection=SampledDistribution(force[felt]),
        detection_delay=SampledDistribution(delay[felt]),
        trigger_joint_probability=fired[detected].mean(axis=0) if some else np.full(dof, math.nan),
        multi_joint_probability=float((fired[detected].sum(axis=1) > 1).mean()) if some else math.nan,
        false_alarm_probability=float((detected & ~felt).mean()),
        undetected_probability=float(missed.mean()),
        no_contact_probability=float((~detected & ~touches).mean()),
        samples=samples,
        seed=seed,
        runs=runs | {"peak_force": peak, "force_at_detection": force, "felt": felt},
    )


def _check_sample(samples: int, seed: int, threads: int) -> None:
    as_whole_number(samples, "samples", 1, 100_000_000)
    as_whole_number(seed, "seed", 0, 2**64 - 1, "0 to 2^64 - 1")
    as_whole_number(threads, "threads", 1, 256)


def _horizon(problem: CollisionProblem) -> int:
    return round(problem.scenario.motion.duration_s / problem.scenario.simulation.step_s)


def _end_time(law: CollisionResult) -> float:
    return float(law.curve.kernel.cut_step * law.scenario.simulation.step_s)
