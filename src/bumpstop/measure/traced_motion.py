"""The motion of one shot about its contact, with a reaction that may begin in any simulation step."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.curve import AT_REST, StoppingCurve, stopping_curve
from bumpstop.collision.problem import CollisionProblem
from bumpstop.collision.trajectory.onset import trajectory_of
from bumpstop.collision.trajectory.trajectory_curve import trajectory_curve, trajectory_kernel
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario import Scenario

# Steps before contact: the arm is at full speed from the start.
_LEAD = 4
# An arm that lags while its motion speeds up is followed from so many time constants of its servo before contact.
_FORGOTTEN = 8


@dataclass(frozen=True, eq=False)
class TracedMotion:
    """A motion that meets a gauge, with a control cycle in every simulation step.

    Attributes:
        problem: the collision, without latency: it would only shift the begin of the reaction, which is free here.
        period_steps: simulation steps in a control cycle of the scenario.
        curve: of the motion.
        contact_step: simulation steps until contact.
        ended: whether the motion ends by itself, so that a longer time would show no more of it.
        rests: whether it ends at rest, its force known: it presses no further.
    """

    problem: CollisionProblem
    period_steps: int
    curve: StoppingCurve
    contact_step: int
    ended: bool
    rests: bool

    @property
    def offset(self) -> float:
        """Where the gauge stands along the normal [m]."""
        return float(self.curve.distance[self.contact_step])

    @classmethod
    def of(cls, scenario: Scenario, window: float, speed: float = 1.0) -> TracedMotion:
        """Trace a motion.

        Args:
            scenario: of a line, which begins at the gauge, or of a trajectory with the time of contact.
            window: how long it is followed from contact on [s].
            speed: of a trajectory, as a share of its own.

        Raises:
            InputError: a trajectory has no time of contact.
        """
        if scenario.motion.kind == "trajectory":
            return cls._of_trajectory(scenario, window, speed)
        step = scenario.simulation.step_s
        steps = _LEAD + math.ceil(window / step)
        motion = scenario.motion.model_copy(update={"start": "moving", "duration_s": steps * step})
        checked = CollisionProblem.from_scenario(scenario.model_copy(update={"motion": motion}))
        problem = replace(checked, period_steps=1, latency_steps=0)
        curve = stopping_curve(problem, whole=True)
        contact = min(_LEAD, curve.distance.size - 1)
        return cls(problem, checked.period_steps, curve, contact, ended=curve.end in AT_REST, rests=False)

    @classmethod
    def _of_trajectory(cls, scenario: Scenario, window: float, speed: float) -> TracedMotion:
        onset = scenario.motion.contact_onset_s
        if onset == "uniform":
            found = "'uniform' is not available: a gauge is hit at one place of the trajectory"
            raise InputError("motion.contact_onset_s", found, "give the time at which the motion meets the gauge")
        checked = CollisionProblem.from_scenario(scenario)
        whole, step = trajectory_of(checked), scenario.simulation.step_s
        lead = min(_lead_steps(checked), int(onset / (speed * step)))
        end = onset + speed * window
        ended = end >= whole.duration
        # Arms brake along what is left of the path: twice as far as from the greatest rates is more than enough.
        rates = speed * np.abs(whole.at(whole.time, 1)).max(axis=0)
        stop = float(checked.deceleration.even_time((rates / checked.joint_acceleration).max()))
        part = whole.part(onset - speed * lead * step, min(end + speed * stop, whole.duration), speed)
        traced = replace(checked, period_steps=1, latency_steps=0, trajectory=part, q=whole.at(onset))
        curve = trajectory_curve(traced, trajectory_kernel(traced), lead * step)
        return cls(traced, checked.period_steps, curve, lead, ended, rests=ended and not whole.stops_short)


def _lead_steps(problem: CollisionProblem) -> int:
    drives = problem.drive_train if problem.elastic else None
    if drives is None or np.all(drives.acceleration_feedforward == 1):
        return _LEAD
    slowest = float(drives.servo_position_gain.min())
    return max(_LEAD, math.ceil(_FORGOTTEN / slowest / problem.scenario.simulation.step_s))
