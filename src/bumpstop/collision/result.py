"""What came of a collision: distributions of its forces and times, probabilities, verdict, notes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from bumpstop import _native
from bumpstop.arrays import FloatArray, finite_or_none
from bumpstop.collision.arm.other_arm import arm_to_json, other_arm
from bumpstop.collision.arm.pressing_limit import PressingLimit, pressing_limit
from bumpstop.collision.curve import AT_REST, StoppingCurve
from bumpstop.collision.distribution.contact_duration import (
    integrated_contact_duration,
    may_be_left_in_contact,
    monte_carlo_contact_duration,
    monte_carlo_left_in_contact,
)
from bumpstop.collision.distribution.distribution import (
    NEGLIGIBLE,
    Distribution,
    SampledDistribution,
)
from bumpstop.collision.distribution.transient_contact import ImpactBounds, impact_bounds
from bumpstop.collision.notes import notes_of
from bumpstop.collision.probability_text import percent
from bumpstop.collision.problem import CollisionProblem
from bumpstop.collision.verdict.alarm_rate import alarm_rate
from bumpstop.collision.verdict.two_phase import TwoPhaseUse, phase_shares
from bumpstop.collision.verdict.verdict import Verdict, judge
from bumpstop.collision.verdict.verdict_notes import nothing_hit, verdict_notes
from bumpstop.display import CURVE, FAINT, LIMIT, Displayed

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes

    from bumpstop.collision.scenario.scenario import Scenario


@dataclass(frozen=True, eq=False, repr=False)
class CollisionResult(Displayed):
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
        runs: of the sampled distribution: offset [m], tick (-1: never), triggers (bit j: joint j + 1), noise and
            residual, and whether it was ``detected_after_contact``.
        kernel: the compiled distribution, of an integrated one; of a trajectory that.
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
    kernel: _native.CollisionDistribution | _native.Trajectory | None = None
    transient_contact_duration: Distribution | None = None

    def __repr__(self) -> str:
        """What hits how hard: its arrays would fill screens."""
        who, verdict = f"{self.problem.robot.name} {self.problem.motion_in_words}", self.verdict.acceptable
        return f"{type(self).__name__}({self.kind}, {who}, acceptable={verdict}, peak_force={self.peak_force!r})"

    @property
    def integral(self) -> _native.CollisionDistribution:
        """The compiled distribution of a line that is integrated."""
        assert isinstance(self.kernel, _native.CollisionDistribution)
        return self.kernel

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
        """From contact until arm and body separate [s], given that; None where the arm stops in clamped contact."""
        if self.problem.gives_way:
            return self.transient_contact_duration
        if self.scenario.reaction.kind == "stop":
            return None
        if self.kind == "exact":
            return self._integrated_contact_duration[0]
        assert self.runs is not None
        times = monte_carlo_contact_duration(self.problem, self.curve.line, self.runs["tick"], self.runs["offset"])
        return SampledDistribution(times[np.isfinite(times)])

    @cached_property
    def _integrated_contact_duration(self) -> tuple[Distribution, float]:
        return integrated_contact_duration(self.problem, self.curve.line, self.integral)

    @property
    def left_in_contact_probability(self) -> float:
        """Detected, and in clamped contact where the reversing arm is followed no farther."""
        if self.problem.gives_way or self.scenario.reaction.kind == "stop":
            return 0.0
        if self.runs is not None:
            tick, offset = self.runs["tick"], self.runs["offset"]
            return monte_carlo_left_in_contact(self.problem, self.curve.line, tick, offset)
        # Mostly there is none, and to look is a tenth of the work.
        if not may_be_left_in_contact(self.problem, self.curve.line, self.integral):
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
            integrated=self.kind == "exact",
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
        return self.problem.approach_speed / float(np.linalg.norm(self.problem.start.point_velocity))

    def contact_alone(self) -> dict[str, Any]:
        """Keys that leave one contact of many; empty where there is but one."""
        return {}

    @cached_property
    def other_arm(self) -> CollisionResult | None:
        """The same collision of a rigid arm in the place of an elastic one, or the reverse; see :mod:`.other_arm`."""
        return other_arm(self.problem)

    @cached_property
    def pressing_limit(self) -> PressingLimit | None:
        """Greatest force of an undetected elastic arm; None where its motion ends, or torque limits are unknown."""
        if self.problem.trajectory is not None or self.curve.end in AT_REST:
            return None
        return pressing_limit(self.problem, self.curve)

    @property
    def unbounded_because(self) -> str | None:
        """Why a collision never detected has no bound on its force, to follow "not detected"; None where it has one.

        A free body has got away, an arm that has come to rest presses no harder, and one whose motors are at their
        limits neither.
        """
        if self.problem.body_mass is not None or self.curve.end in AT_REST or self.pressing_limit is not None:
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
        if curve.line.velocity_limited:
            notes.append("A joint-velocity limit slows the motion below the speed asked for.")
        if self.undetected_probability > NEGLIGIBLE and self.problem.body_mass is None:
            notes.append(self._undetected_note())
        if self.no_contact_probability > NEGLIGIBLE:
            share = percent(self.no_contact_probability, integrated=self.kind == "exact")
            notes.append(f"In {share} of cases the motion ends before contact.")
        return notes

    def _undetected_note(self) -> str:
        share = percent(self.undetected_probability, integrated=self.kind == "exact")
        share = share[0].upper() + share[1:]
        limit = self.pressing_limit
        if limit is not None:
            return (
                f"{share} of collisions are not detected within {self.scenario.motion.duration_s:g} s "
                f"(motion.duration_s). They count with the most that the drives press with: {limit.static_force:.4g} N "
                f"at the torque limit of joint {limit.joint}, {limit.peak_force:.4g} N with the blow."
            )
        if self.unbounded_because is None:
            return (
                f"{share} of collisions are not detected before the motion ends. They count with the greatest force "
                "until the arm stands."
            )
        return (
            f"{share} of collisions are not detected {self.unbounded_because}. They count as over every limit: their "
            "force is unbounded and the mean is not given."
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
        if self.problem.gives_way:
            return use.over(use.force, 0.0), None if use.pressure is None else use.over(use.pressure, 0.0)
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
        if self.pressing_limit is not None:
            return self.undetected_probability if self.pressing_limit.peak_force > force else 0.0
        if self.runs is not None:
            missed = (self.runs["tick"] < 0) & (self.runs["offset"] < self.curve.distance.max())
            return float((missed & (self.runs["peak_force"] > force)).mean())
        return float(self.integral.tail("end_force", np.array([force]))[0, 0])

    def phase_shares(self, first: float, later: float) -> tuple[Distribution, float]:
        """How far clamped collisions use the limits of two phases, and the probability of the collisions this is of.

        It is of those detected. Where arm or body give way it is of all, those never detected among them.

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

    def __str__(self) -> str:
        from bumpstop.collision.summary import summary_text

        return summary_text(self)

    def to_frame(self) -> pl.DataFrame:
        """Data frame of quantiles of an integrated distribution, or of the runs of a sampled one: ``law.parquet``."""
        from bumpstop.collision.tables import result_table

        return result_table(self)

    def _draw(self, axes: Axes) -> None:
        """Draw the probability of a larger peak force, with the force that the limits allow."""
        from bumpstop.collision.distribution.distribution import NEGLIGIBLE

        levels = 1 - np.logspace(-0.001, -9, 73)
        quantiles = {float(self.peak_force.quantile(float(p))) for p in levels}
        force = np.array(sorted(value for value in quantiles if np.isfinite(value)))
        shown = [max(self.peak_force.exceedance(float(value)), NEGLIGIBLE) for value in force]
        axes.semilogy(force, shown, color=CURVE)
        axes.axhline(self.verdict.accepted_probability, color=FAINT, linewidth=1, linestyle="--")
        if self.verdict.limits is not None:
            contact = self.scenario.contact
            allowed = self.verdict.limits.allowed_force_N(contact.area_cm2, contact.peak_factor)
            axes.axvline(allowed, color=LIMIT, label="allowed force")
            axes.legend()
        axes.set(xlabel="peak force, N", ylabel="probability of a larger one", ylim=(1e-9, 2), xlim=(0, None))

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
            "trigger_joint_probability": [finite_or_none(p) for p in self.trigger_joint_probability],
            "multi_joint_probability": finite_or_none(self.multi_joint_probability),
            "false_alarm_probability": self.false_alarm_probability,
            "undetected_probability": self.undetected_probability,
            "no_contact_probability": self.no_contact_probability,
            "law": self.kind,
        }
        result["arm"] = arm_to_json(self)
        if self.impact_bounds is not None:
            result["impact_bounds"] = self.impact_bounds.to_json()
        if self.kind == "sampled":
            result |= {"samples": self.samples, "seed": self.seed}
        verdict = self.verdict.to_json() | {"warnings": list(self.warnings)}
        return result | {"verdict": verdict, "notes": list(self.notes)}


def _end_time(result: CollisionResult) -> float:
    return float(result.curve.line.cut_step * result.scenario.simulation.step_s)
