"""Where the risk is a sawtooth: ticks of the detector fall on other forces as something is varied."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bumpstop.collision import CollisionProblem, Scenario

# Values looked at in each tooth.
_IN_A_TOOTH = 6
# A tooth reaches no farther than the force that grows in so many ticks, and never more than this share of the limit.
_TICKS, _MAX_SHARE = 3, 0.6


def has_ripple(scenario: Scenario) -> bool:
    """Whether a milder value may have the greater risk, because of where ticks fall.

    Contact that begins anywhere between two ticks alike, at an even speed, has no teeth. Contact at a fixed distance,
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
        share: below a failure no tooth farther away than this share of it passes the accepted risk.
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
        pick_up: float,
        stiffness: float | None = None,
        period: float | None = None,
    ) -> RippleScan:
        """RippleScan at the force limit.

        Args:
            problem: all that is not said otherwise.
            force_limit: [N].
            speed: of the contact point along the normal [m/s].
            pick_up: its acceleration where it starts from rest [m/s2].
            stiffness: of body and padding [N/m]; None: the problem's.
            period: of the feedback [s]; None: the problem's.
        """
        if stiffness is None:
            stiffness = problem.stiffness
        if period is None:
            period = problem.period_steps * problem.scenario.simulation.step_s
        fixed = problem.offset_kind == "fixed"
        farthest = problem.offset_size * (1.0 if fixed else speed / problem.approach_speed)
        deepest = farthest + force_limit / stiffness
        share = min(_MAX_SHARE, _TICKS * stiffness * speed * period / force_limit)
        if problem.scenario.motion.start == "rest":
            speed = min(speed, math.sqrt(2 * pick_up * deepest))
        return cls(share, speed * period / deepest / _IN_A_TOOTH)


def initial_acceleration(problem: CollisionProblem) -> float:
    """Acceleration of the contact point from rest [m/s2]: joint rates grow in one proportion."""
    slowest = float((np.abs(problem.start["qd"]) / problem.joint_acceleration).max())
    return problem.approach_speed / slowest
