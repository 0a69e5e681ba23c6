"""Where the risk has a sampling ripple: ticks of the detector fall on other forces as something is varied."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bumpstop.collision import CollisionProblem, Scenario

# Values looked at in each crest.
_PER_CREST = 6
# A crest reaches no farther than the force that grows in so many ticks, and never more than this share of the limit.
_TICKS, _MAX_SHARE = 3, 0.6


def has_ripple(scenario: Scenario) -> bool:
    """Whether a more conservative value may have the greater risk, because of where ticks fall.

    Contact that begins anywhere between two ticks alike, at an even speed, has no crests. Contact at a fixed distance,
    or spread over less than a feedback period, has; and so has an arm that starts from rest, whose ticks are nearer to
    each other at the begin than the distances it is spread over.
    """
    contact = scenario.contact
    narrow = contact.offset_law == "half_normal" and contact.offset_sd_s < scenario.detector.feedback_period_s
    return contact.offset_law == "fixed" or narrow or scenario.motion.start == "rest"


@dataclass(frozen=True)
class RippleScan:
    """Of the risk over what the force is in proportion to.

    Attributes:
        share: below a failure no crest farther away than this share of it passes the accepted risk.
        apart: between values looked at, in the logarithm.
    """

    share: float
    apart: float

    @classmethod
    def of(
        cls,
        problem: CollisionProblem,
        force_limit: float,
        *,
        speed: float,
        start_acceleration: float,
        stiffness: float | None = None,
        period: float | None = None,
    ) -> RippleScan:
        """RippleScan at the force limit.

        Args:
            problem: all that is not said otherwise.
            force_limit: [N].
            speed: of the contact point along the normal [m/s].
            start_acceleration: its acceleration where it starts from rest [m/s2].
            stiffness: of body and padding [N/m]; None: the problem's.
            period: of the feedback [s]; None: the problem's.
        """
        if stiffness is None:
            stiffness = problem.stiffness
        if period is None:
            period = problem.period_steps * problem.scenario.simulation.step_s
        fixed = problem.offset_kind == "fixed"
        max_offset = problem.offset_size * (1.0 if fixed else speed / problem.approach_speed)
        max_travel = max_offset + force_limit / stiffness
        share = min(_MAX_SHARE, _TICKS * stiffness * speed * period / force_limit)
        if problem.scenario.motion.start == "rest":
            speed = min(speed, math.sqrt(2 * start_acceleration * max_travel))
        return cls(share, speed * period / max_travel / _PER_CREST)


def initial_acceleration(problem: CollisionProblem) -> float:
    """Acceleration of the contact point from rest [m/s2]: joint rates grow in one proportion."""
    slowest = float((np.abs(problem.start.qd) / problem.joint_acceleration).max())
    return problem.approach_speed / slowest
