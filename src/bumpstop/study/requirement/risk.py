"""The risk of one scenario while one thing about it is varied, at the price of a law and no more."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.collision import CollisionProblem, integrate, stopping_curve
from bumpstop.errors import InputError
from bumpstop.kernels import core
from bumpstop.study.speed.motion_duration import duration_s

if TYPE_CHECKING:
    from bumpstop.collision import Scenario
    from bumpstop.study.variable import Variable

# Travel in a tick that differs by more than this share is not that of a line at constant speed.
_OFF_LINE = 1e-3
# Below this accepted risk a tail is worked out by itself, to keep its digits.
_FAR = 1e-5
# A bound from below that is as much as this says all there is to say.
_NEARLY_ALL = 0.9
# Asked whether it is accepted without doubt, a risk below this is not known closely.
_NEAR = 0.2
# What changes neither the path nor the ticks on it: path and reactions of one value serve all others.
_SAME_PATH = ("detector.thresholds", "contact.padding")
# What changes the path itself.
_NEW_PATH = ("motion.speed", "reaction.joint_acceleration_rad_s2")


def allowed_force(problem: CollisionProblem) -> float:
    """Largest peak force within both limits of the body [N]; the problem has limits."""
    assert problem.limits is not None
    contact = problem.scenario.contact
    return problem.limits.allowed_force_N(contact.area_cm2, contact.peak_factor)


@dataclass(frozen=True)
class Risk:
    """What one value comes to.

    Attributes:
        over: probability of passing the force or the pressure limit, whichever is greater; never detected counts as
            over, in clamped contact of an arm that does not come to rest. Where the arm cannot follow its line, a
            bound: from above where it is less than a tenth of the accepted risk, from below where it is more than ten
            times as much, and near it to a part in a thousand from above. Where a singularity binds, that of collisions
            unnoticed before it.
        undetected: the part of it that is never detected.
        false_alarm: probability of an alarm before contact.
        binding: ``"force"`` or ``"pressure"``, the limit passed more often; ``"singularity"`` where the arm passes one
            and the force alone is not known to be a reason.
        met: the risk is accepted. An arm that passes a singularity on its way may as well stop there, as the last
            digits of its path will have it, so collisions it would notice beyond count as passing the limit too.
        follows: the tool has the same travel from tick to tick.
    """

    over: float
    undetected: float
    false_alarm: float
    binding: str
    met: bool
    follows: bool = True


class VariedRisk:
    """Risk as a function of one variable.

    Attributes:
        problem: of the scenario as given.
        evaluations: laws worked out so far.
    """

    def __init__(self, scenario: Scenario, variable: Variable) -> None:
        """Prepare a scenario.

        Args:
            scenario: a straight line against a body with limits, with Gaussian noise.
            variable: what is varied.

        Raises:
            InputError: there is no limit for such a contact, or no exact law.
        """
        self.scenario, self.variable = scenario, variable
        self.problem = CollisionProblem.from_scenario(scenario)
        self._check()
        self.evaluations = 0
        self._given = variable.value(scenario)
        self._path = core.KnownPath() if variable.name in _SAME_PATH else None
        self._whole_tail = scenario.verdict.accepted_probability < _FAR

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
            raise InputError(
                "contact.body", f"no value can meet it: {_clause(limits.reason)}", "name another body region"
            )
        transient = problem.transient_limits
        if transient is not None and not transient.permitted:
            raise InputError(
                "contact.body", f"no value can meet it: {_clause(transient.reason)}", "wanted quasi_static limits"
            )
        if problem.residuals is not None:
            raise InputError("detector.residuals", "have no exact law", "give detector.noise_sd_Nm")

    @property
    def force_limit(self) -> float:
        """Peak force [N] at which the first limit is passed: that of the force, or of the pressure over the area."""
        return allowed_force(self.problem)

    @property
    def unnoticed(self) -> float:
        """The largest force along the normal that no threshold notices at the start, min_j theta_j / |a_j| [N]."""
        problem = self.problem
        contact = problem.scenario.contact
        normal = np.array(contact.normal or problem.start["point_velocity"])
        torque = (normal / np.linalg.norm(normal)) @ problem.robot.jacobian(problem.q, contact.link, contact.point_m)[
            :3
        ]
        with np.errstate(divide="ignore"):
            return float((problem.thresholds / np.abs(torque)).min())

    def _force_limits(self) -> tuple[float, float]:
        limits, contact = self.problem.limits, self.scenario.contact
        assert limits is not None
        return limits.force_N, limits.force_at_pressure_limit_N(contact.area_cm2, contact.peak_factor)

    def at(self, value: float, *, closely: bool = False) -> Risk:
        """The risk at one value of the variable; ``closely``: one that is passed is no bound, unless it is near 1."""
        self.evaluations += 1
        problem = self._varied(value)
        if problem.body_mass is not None or problem.transient_limits is not None or self._whole_tail:
            return self._at_by_law(problem)
        by_force, by_pressure = self._force_limits()
        accepted = self.scenario.verdict.accepted_probability
        new_path = self.variable.name in _NEW_PATH

        def ask(accepted: float) -> dict[str, Any]:
            return core.limit_risk(
                problem.setup,
                problem.q,
                problem.velocity,
                problem.detector,
                problem.stiffness,
                problem.offset_kind,
                problem.offset_size,
                min(by_force, by_pressure),
                accepted,
                self._path,
                new_path,
            )

        found = ask(accepted)
        if closely and accepted < found["low"] < _NEARLY_ALL:
            found = ask(1.0)
            # Far below what is asked about it is a bound all the same; near it, it is not.
            near = ask(found["low"]) if 0 < found["low"] < _NEAR else found
            found = near if near["low"] > found["low"] else found
        binding = "pressure" if by_pressure < by_force else "force"
        over = min(1.0, found["high"] if found["high"] <= accepted or found["low"] <= accepted else found["low"])
        met = over <= accepted
        if new_path and found["low"] <= accepted < found["at_crossing"]:
            over, met, binding = min(1.0, found["at_crossing"]), False, "singularity"
        return Risk(
            over,
            min(1.0, found["undetected"]),
            found["false_alarm"],
            binding,
            met,
            found["follows"] or not self._straight(),
        )

    def _at_by_law(self, problem: CollisionProblem) -> Risk:
        """The same by the whole law: for free contact, two phases, and tails too far out for interpolation."""
        curve = stopping_curve(problem)
        law = integrate(problem, curve)
        verdict = law.verdict
        force, pressure = verdict.p_over_force or 0.0, verdict.p_over_pressure or 0.0
        undetected = 0.0 if law.unbounded_because is None else law.undetected_probability
        over = max(force, pressure)
        step = np.diff(curve.tick_distance)
        follows = not step.size or bool(np.ptp(step) <= _OFF_LINE * abs(step[0]))
        return Risk(
            over,
            undetected,
            law.false_alarm_probability,
            "pressure" if pressure > force else "force",
            over <= self.scenario.verdict.accepted_probability,
            follows or not self._straight(),
        )

    def _straight(self) -> bool:
        """Whether the point that hits goes straight on at an even speed, where the arm can follow its line."""
        contact, motion = self.scenario.contact, self.scenario.motion
        return not (
            contact.normal is not None or contact.link is not None or any(contact.point_m) or (motion.start == "rest")
        )

    def _varied(self, value: float) -> CollisionProblem:
        """The problem at one value, with what has not changed taken over."""
        problem, name = self.problem, self.variable.name
        keep: tuple[str, ...] = ("held", "contact_point")
        if name == "motion.speed":
            factor = value / self._given
            motion = problem.scenario.motion.model_copy(
                update={
                    "velocity_mm_s": [factor * v for v in problem.scenario.motion.velocity_mm_s or ()],
                    "duration_s": duration_s(problem.scenario, factor),
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


def _clause(sentence: str) -> str:
    return sentence.rstrip(".")
