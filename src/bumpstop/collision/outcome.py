"""What is known of a collision before it is judged: distributions of its forces and times, and probabilities."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from bumpstop import _native
from bumpstop.arrays import FloatArray
from bumpstop.collision.arm.pressing_limit import PressingLimit, pressing_limit
from bumpstop.collision.curve import AT_REST, StoppingCurve
from bumpstop.collision.distribution.contact_duration import (
    integrated_contact_duration,
    may_be_left_in_contact,
    monte_carlo_contact_duration,
    monte_carlo_left_in_contact,
)
from bumpstop.collision.distribution.distribution import NEGLIGIBLE, Distribution, SampledDistribution
from bumpstop.collision.distribution.transient_contact import ImpactBounds, impact_bounds
from bumpstop.collision.probability_text import percent
from bumpstop.collision.problem import CollisionProblem
from bumpstop.collision.verdict.two_phase import phase_shares

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario import Scenario


@dataclass(frozen=True, eq=False, repr=False)
class CollisionOutcome:
    """The fields of a :class:`CollisionResult`, which says what each is, and what follows from them alone."""

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
                f"(motion.duration_s). They count with the most that the drives press with: "
                f"{limit.words(self.scenario)}."
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
        collisions = self.integral if self.runs is None else self.runs
        return phase_shares(self.problem, self.curve, collisions, (first, later))

    @cached_property
    def impact_bounds(self) -> ImpactBounds | None:
        """Peak force of an undetected free impact by formula; None for clamped contact."""
        return impact_bounds(self.problem)


def _end_time(result: CollisionOutcome) -> float:
    return float(result.curve.line.cut_step * result.scenario.simulation.step_s)
