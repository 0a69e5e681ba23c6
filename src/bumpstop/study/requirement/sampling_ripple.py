"""Where the risk need not grow with what is varied: a sampling ripple, or a force that falls itself.

Ticks of the detector fall on other forces as something is varied: that is the ripple. An elastic arm swings against the
body, and contact that is detected in an earlier swing presses less.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionProblem, Scenario

# Values looked at in each crest.
_PER_CREST = 6
# A crest reaches no farther than the force that grows in so many ticks, and never more than this share of the limit.
_TICKS, _MAX_SHARE = 3, 0.6
# Of the accepted risk: no crest is so high that a value with less is beside one that fails.
SOME_RISK = 1e-6
# Between values looked at where the force may fall, in the logarithm of what it grows with otherwise. From one to the
# next it grows by little more than that.
FALL_APART = 0.03
# Along a map of speeds none so many times slower than one that is met is looked at for that.
_FALL_REACH = 5.0
# A peak between two values looked at is no higher than this many times the force there.
_PEAK_RISE = 1.2

# Beside a highest speed below which not all were looked at.
SLOWER_MAY_FAIL = (
    "Slower speeds may exceed what is accepted: in such contact the risk may fall at a higher speed, and not all slower"
    " ones were looked at. Evaluate the speeds that are used."
)


def risk_may_fall(scenario: Scenario) -> bool:
    """Whether a more conservative value may have the greater risk: :func:`has_ripple` or :func:`force_may_fall`."""
    return has_ripple(scenario) or force_may_fall(scenario)


def force_may_fall(scenario: Scenario) -> bool:
    """Whether a less conservative value may press less, wherever ticks fall.

    An elastic arm swings in contact: at a higher speed, or against a harder body, an earlier swing may be detected. A
    body with damping is detected at its first touch where the arm is fast enough.
    """
    return scenario.arm.model == "elastic" or scenario.contact.damping_Ns_m > 0


def nearly_fails(force: FloatArray | float, limit: float) -> npt.NDArray[np.bool_]:
    """Whether a peak may pass the limit [N] beside a force that is passed as often as is accepted [N]."""
    return np.asarray(_PEAK_RISE * np.asarray(force) >= limit)


def slower_speeds(speed: float, slowest: float | None = None, *, apart: float = FALL_APART) -> FloatArray:
    """Speeds to look at where the force may fall, from one down to the slowest, a fifth of it by default.

    They are in even ratios, at most so far apart in the logarithm.
    """
    slowest = speed / _FALL_REACH if slowest is None else slowest
    count = max(1, math.ceil(math.log(speed / slowest) / apart))
    return np.asarray(np.geomspace(speed, slowest, count + 1))


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
