"""The risk of one scenario while one thing about it is varied, at the price of a law and no more."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision import Problem, StoppingCurve, exact_law, stopping_curve
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.collision import Scenario
    from bumpstop.study.variable import Variable

# Below this accepted risk a tail is worked out by itself, to keep its digits.
_FAR = 1e-5
# Travel in a tick that differs by more than this share is not that of a line at constant speed.
_OFF_LINE = 1e-3
# What does not change the path: a stopping curve serves all values but those for which it is too short.
SAME_CURVE = ("detector.thresholds", "contact.padding")
# A curve is traced for thresholds so many times the value asked for: most searches end far below the highest.
_AHEAD = 2.0


@dataclass(frozen=True)
class Risk:
    """What one value comes to.

    Attributes:
        over: probability of passing the force or the pressure limit, whichever is greater; never detected counts as
            over, in clamped contact.
        undetected: the part of it that is never detected.
        false_alarm: probability of an alarm before contact.
        binding: ``"force"`` or ``"pressure"``, the limit passed more often.
    """

    over: float
    undetected: float
    false_alarm: float
    binding: str


class VariedRisk:
    """Risk as a function of one variable.

    Attributes:
        problem: of the scenario as given.
        evaluations: laws worked out so far.
    """

    def __init__(self, scenario: Scenario, variable: Variable, longest: float) -> None:
        """Prepare a scenario.

        Args:
            scenario: a straight line against a body with limits, with Gaussian noise.
            variable: what is varied.
            longest: the value whose stopping curve is the longest: the highest thresholds, the softest padding.

        Raises:
            InputError: there is no limit for such a contact, or no exact law.
        """
        self.scenario, self.variable = scenario, variable
        self.problem = Problem.from_scenario(scenario)
        self._check()
        self.evaluations = 0
        self._given = variable.value(scenario) if variable.name != "contact.padding" else math.inf
        self._curve: StoppingCurve | None = None
        self._traced = -math.inf
        self._longest = longest
        self._whole_tail = scenario.verdict.risk < _FAR

    def _check(self) -> None:
        problem = self.problem
        if problem.trajectory is not None:
            raise InputError(
                "motion.kind", "'trajectory' has no single speed", "wanted 'line'; see bumpstop study atlas"
            )
        limits = problem.limits
        if limits is None:
            raise InputError("contact.body", "is missing", "a requirement needs limits: name a body region")
        if not limits.permitted:
            raise InputError("contact.body", f"no value can meet it: {limits.reason}", "name another body region")
        transient = problem.transient_limits
        if transient is not None and not transient.permitted:
            raise InputError("contact.body", f"no value can meet it: {transient.reason}", "wanted quasi_static limits")
        if problem.residuals is not None:
            raise InputError("detector.residuals", "have no exact law", "give detector.noise_sd_Nm")

    @property
    def force_limit(self) -> float:
        """Peak force [N] at which the first limit is passed: that of the force, or of the pressure over the area."""
        return min(self._force_limits())

    @property
    def unnoticed(self) -> float:
        """The largest force along the normal that no threshold notices, min_j theta_j / |a_j| [N]."""
        curve = stopping_curve(self.problem)
        with np.errstate(divide="ignore"):
            return float((self.problem.thresholds / np.abs(curve.torque_per_newton[0])).min())

    def _force_limits(self) -> tuple[float, float]:
        limits, contact = self.problem.limits, self.scenario.contact
        assert limits is not None
        pressure = math.inf
        if limits.pressure_N_cm2 is not None:
            pressure = limits.pressure_N_cm2 * contact.area_cm2 / contact.peak_factor
        return limits.force_N, pressure

    def leaves_its_line(self, value: float) -> bool:
        """Whether joints cannot follow the line at this value, as near a singularity: the risk is erratic then."""
        problem = self._varied(value)
        contact, motion = problem.scenario.contact, problem.scenario.motion
        if contact.normal is not None or contact.link is not None or any(contact.point_m) or motion.start == "rest":
            return False
        step = np.diff(stopping_curve(problem).tick_distance)
        return bool(step.size and np.ptp(step) > _OFF_LINE * abs(step[0]))

    def at(self, value: float) -> Risk:
        """The risk at one value of the variable."""
        self.evaluations += 1
        problem = self._varied(value)
        curve = self._curve_at(value, problem)
        if problem.body_mass is not None or problem.transient_limits is not None or self._whole_tail:
            verdict = exact_law(problem, curve).verdict
            force, pressure = verdict.p_over_force or 0.0, verdict.p_over_pressure or 0.0
            undetected = exact_law(problem, curve).undetected_probability if problem.body_mass is None else 0.0
            binding = "pressure" if pressure > force else "force"
            return Risk(max(force, pressure), undetected, verdict.false_alarm_probability, binding)
        question = (problem.detector, problem.stiffness, problem.offset_kind, problem.offset_size)
        law = curve.kernel.exact_law(*question, 1, 0.0)
        undetected = min(1.0, max(0.0, float(law.undetected)))
        by_force, by_pressure = self._force_limits()
        over = float(law.tail("peak_force", np.array([min(by_force, by_pressure)]))[0, 0])
        binding = "pressure" if by_pressure < by_force else "force"
        return Risk(min(1.0, over + undetected), undetected, float(law.false_alarm), binding)

    def _curve_at(self, value: float, problem: Problem) -> StoppingCurve:
        """The stopping curve at a value: its own, or one long enough for this value and others."""
        if self.variable.name not in SAME_CURVE or problem.body_mass is not None:
            return stopping_curve(problem)
        if self._curve is None or value > self._traced:
            # Softer padding needs a longer curve, and so do higher thresholds: these are followed as far as they go.
            thresholds = self.variable.name == "detector.thresholds"
            reach = min(self._longest, _AHEAD * value) if thresholds else self._longest
            self._curve, self._traced = stopping_curve(self._varied(reach)), reach if thresholds else math.inf
        return self._curve

    def _varied(self, value: float) -> Problem:
        """The problem at one value, with what has not changed taken over."""
        problem, name = self.problem, self.variable.name
        keep: tuple[str, ...] = ("held", "contact_point")
        if name == "motion.speed":
            factor = value / self._given
            # Slower arms have as far to go.
            motion = problem.scenario.motion.model_copy(
                update={
                    "velocity_mm_s": [factor * v for v in problem.scenario.motion.velocity_mm_s or ()],
                    "duration_s": problem.scenario.motion.duration_s / min(1.0, factor),
                }
            )
            scenario = problem.scenario.model_copy(update={"motion": motion})
            new = replace(problem, scenario=scenario, velocity=problem.velocity * factor)
            keep = (*keep, "detector")
        elif name == "detector.thresholds":
            new = replace(problem, thresholds=problem.thresholds * (value / self._given))
            keep = (*keep, "setup", "start", "approach_speed")
        elif name == "contact.padding":
            new = replace(problem, stiffness=1 / (1 / problem.body_stiffness + 1 / value))
            keep = (*keep, "setup", "start", "approach_speed", "detector")
        elif name == "detector.feedback_period_s":
            new = replace(problem, period_steps=round(value / problem.scenario.simulation.step_s))
            keep = (*keep, "start", "approach_speed")
        else:
            new = replace(problem, joint_acceleration=np.full_like(problem.joint_acceleration, value))
            keep = (*keep, "start", "approach_speed", "detector")
        for attribute in keep:
            if attribute not in problem.__dict__:
                getattr(problem, attribute)
            new.__dict__[attribute] = problem.__dict__[attribute]
        return new
