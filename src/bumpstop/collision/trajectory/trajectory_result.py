"""The distribution of a collision that begins at any time of a joint trajectory: a mixture over the time of contact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from bumpstop import _native
from bumpstop.collision.arm.arm_mass import arm_mass_at
from bumpstop.collision.arm.pressing_limit import PressingLimit
from bumpstop.collision.curve import StoppingCurve
from bumpstop.collision.distribution.distribution import NEGLIGIBLE, Distribution
from bumpstop.collision.distribution.transient_contact import ImpactBounds, bounds_at
from bumpstop.collision.probability_text import percent
from bumpstop.collision.result import CollisionResult
from bumpstop.collision.trajectory.onset import (
    OnsetQuadrature,
    trajectory_of,
)
from bumpstop.collision.trajectory.onset_mixture import DetectedCollisions
from bumpstop.collision.trajectory.trajectory import point_motion
from bumpstop.collision.trajectory.trajectory_curve import trajectory_curve
from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S

# From what a newton counts for, in the first phase and after it, to the greater share of all collisions.
PhaseShares = Callable[[float, float], Distribution]


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
        undetected_force: force of such collisions, given one [N]; of the integrated distribution, where there are any
            and their forces have a bound.
        pressing: the most that the drives press a held body with; None where torque limits are not known.
        shares: where arm or body give way, what :meth:`phase_shares` tells.
    """

    kernel: _native.Trajectory = field(kw_only=True)
    times: OnsetQuadrature = field(kw_only=True)
    onset: float = field(kw_only=True)
    contact_durations: Distribution | None = field(kw_only=True)
    detections: DetectedCollisions = field(kw_only=True)
    max_undetected_force: float = field(kw_only=True)
    undetected_force: Distribution | None = field(kw_only=True, default=None)
    pressing: PressingLimit | None = field(kw_only=True, default=None)
    shares: PhaseShares | None = field(kw_only=True, default=None)

    @cached_property
    def contact_duration(self) -> Distribution | None:
        """From contact until arm and body separate [s], given that; None where the arm stops in clamped contact."""
        return self.contact_durations

    @cached_property
    def pressing_limit(self) -> PressingLimit | None:
        """Greatest force of the drives where collisions are never detected; None where torque limits are unknown."""
        return self.pressing

    @property
    def left_in_contact_probability(self) -> float:
        """Nothing: on a trajectory a reversing arm goes back the way that it came."""
        return 0.0

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
        if self.shares is not None:
            return self.shares(first, later), 1.0
        own = self.detections
        begin, normal = own.begin[own.onset], np.ascontiguousarray(own.normal[own.onset])
        max_compression = self.kernel.phases(own.tick.tolist(), begin, normal, FIRST_PHASE_S)
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
        if trajectory_of(self.problem).stops_short:
            notes.append(
                "The trajectory ends while the arm still moves. It is taken to stand still there at once, so contact "
                "near the end is harder than it says."
            )
        if self.no_contact_probability > NEGLIGIBLE:
            share = percent(self.no_contact_probability, integrated=self.kind == "exact")
            notes.append(f"In {share} of cases the point turns back within a simulation step, and nothing is touched.")
        if self.undetected_probability > NEGLIGIBLE and self.problem.body_mass is None:
            because, drives = self.unbounded_because, self.pressing
            count = "They count with their force"
            if drives is not None:
                count = (
                    "They count with the most that the drives press with"
                    + (", or with the force of the path, where it is less" if self._rests else "")
                    + f": {drives.words(self.scenario)}"
                )
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
        if self.problem.body_mass is not None or self._rests or self.pressing is not None:
            return None
        return "before the trajectory (motion.file) ends while the arm still moves"

    @property
    def _rests(self) -> bool:
        return not trajectory_of(self.problem).stops_short

    def undetected_over(self, force: float) -> float:
        """See :meth:`CollisionResult.undetected_over`."""
        if self.unbounded_because is not None:
            return self.undetected_probability
        if self.runs is not None:
            return float(((self.runs["tick"] < 0) & (self.runs["peak_force"] > force)).mean())
        if self.undetected_force is None:
            return 0.0
        return self.undetected_force.exceedance(force) * self.undetected_probability
