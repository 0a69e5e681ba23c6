"""The risk of one scenario while one thing about it is varied: one integrated distribution a value."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision import CollisionProblem, integrate, stopping_curve
from bumpstop.errors import InputError
from bumpstop.study.pose_batch import PoseBatch
from bumpstop.study.speed.motion_duration import duration_s

if TYPE_CHECKING:
    from bumpstop.collision import CollisionResult, Scenario, StoppingCurve
    from bumpstop.study.variable import Variable

# Travel in a control cycle that differs by more than this share is not that of a line at constant speed.
_OFF_LINE = 1e-3
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
        over: probability of exceeding the force or the pressure limit, whichever is greater; never detected counts as
            over, in clamped contact of an arm that does not come to rest. Where a singularity binds, the probability
            that a collision is not detected before the arm passes it.
        undetected: the part of it that is never detected.
        false_alarm: probability of an alarm before contact.
        binding: ``"force"`` or ``"pressure"``, the limit exceeded more often; ``"singularity"`` where the limits are
            met only because the arm gets across one.
        force: exceeded with the accepted probability [N]; infinite where more than that are unbounded.
        met: the risk is accepted. An arm that passes a singularity on its way may as well stop there, as the last
            digits of its path will have it, so collisions it would detect beyond count as exceeding the limit too.
        follows: the contact point travels equally far in every control cycle.
        untouched: why most cases hit nothing, so that the value has not been put to the test; empty where they do.
    """

    over: float
    undetected: float
    false_alarm: float
    binding: str
    force: float
    met: bool
    follows: bool = True
    untouched: str = ""

    @property
    def height(self) -> tuple[float, float]:
        """By what risks are compared: where no collision is over the limit, by the force that comes next to it."""
        return self.over, self.force


class VariedRisk:
    """Risk as a function of one variable.

    Attributes:
        problem: of the scenario as given.
        evaluations: distributions computed so far.
    """

    def __init__(self, scenario: Scenario, variable: Variable) -> None:
        """Prepare a scenario.

        Args:
            scenario: a straight line against a body with limits, with Gaussian noise.
            variable: what is varied.

        Raises:
            InputError: there is no limit for such a contact, or no integrated distribution.
        """
        self.scenario, self.variable = scenario, variable
        self.problem = CollisionProblem.from_scenario(scenario)
        self._check()
        self.evaluations = 0
        self._given = variable.value(scenario)

    def _check(self) -> None:
        problem = self.problem
        if problem.trajectory is not None:
            refused = "'trajectory' has no requirements: they are found along straight lines"
            raise InputError("motion.kind", refused, "wanted 'line'; for speeds see bumpstop study speed-limits")
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
            raise InputError("detector.residuals", "have no integrated distribution", "give detector.noise_sd_Nm")

    @property
    def force_limit(self) -> float:
        """Peak force [N] at which the first limit is passed: that of the force, or of the pressure over the area."""
        return allowed_force(self.problem)

    @property
    def undetected(self) -> float:
        """The largest force along the normal that no threshold detects at the start, min_j theta_j / |a_j| [N]."""
        problem = self.problem
        contact = problem.scenario.contact
        normal = np.array(contact.normal or problem.start.point_velocity)
        torque = (normal / np.linalg.norm(normal)) @ problem.robot.jacobian(problem.q, contact.link, contact.point_m)[
            :3
        ]
        with np.errstate(divide="ignore"):
            return float((problem.thresholds / np.abs(torque)).min())

    def at(self, value: float) -> Risk:
        """The risk at one value of the variable."""
        self.evaluations += 1
        problem = self._varied(value)
        curve = stopping_curve(problem)
        result = integrate(problem, curve)
        verdict, accepted = result.verdict, self.scenario.verdict.accepted_probability
        over_force, over_pressure = verdict.p_over_force or 0.0, verdict.p_over_pressure or 0.0
        over, binding = max(over_force, over_pressure), "pressure" if over_pressure > over_force else "force"
        step = np.diff(curve.tick_distance)
        even = not step.size or bool(np.ptp(step) <= _OFF_LINE * abs(step[0]))
        met = over <= accepted
        if met and not even and self.variable.name in _NEW_PATH:
            before = _undetected_before_singularity(result)
            if before > accepted:
                over, met, binding = before, False, "singularity"
        undetected = 0.0 if problem.body_mass is not None else result.undetected_over(self.force_limit)
        follows = even or not self._straight()
        force = result.peak_force.quantile(1 - accepted)
        alarm = result.false_alarm_probability
        return Risk(over, undetected, alarm, binding, force, met, follows, verdict.nothing_hit)

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
            new = replace(problem, joint_acceleration=problem.joint_acceleration * (value / self._given))
            keep = (*keep, "start", "approach_speed", "detector")
        for attribute in keep:
            if attribute not in problem.__dict__:
                getattr(problem, attribute)
            new.__dict__[attribute] = problem.__dict__[attribute]
        return new


def _undetected_before_singularity(result: CollisionResult) -> float:
    """Probability that a collision is not detected before the first singularity that the arm passes or stands at.

    The path up to there is that of a motion which ends there; of one that passes none it is 0.
    """
    problem, curve = result.problem, result.curve
    cycle = _first_cycle_beyond_singularity(problem, curve)
    if cycle is None:
        return result.undetected_probability if curve.end == "singularity" else 0.0
    if cycle == 0:
        return 1 - result.no_contact_probability
    step = problem.scenario.simulation.step_s
    motion = problem.scenario.motion.model_copy(update={"duration_s": (problem.period_steps * (cycle - 1) + 1) * step})
    shorter = replace(problem, scenario=problem.scenario.model_copy(update={"motion": motion}))
    before = integrate(shorter, stopping_curve(shorter))
    # Neither an alarm nor a detection until then, minus what touches nothing and alarms of the later cycles.
    later = result.false_alarm_probability - before.false_alarm_probability
    open_ = before.undetected_probability + before.no_contact_probability
    return max(0.0, open_ - result.no_contact_probability - later)


def _first_cycle_beyond_singularity(problem: CollisionProblem, curve: StoppingCurve) -> int | None:
    """The first control cycle whose reaction would begin beyond a singularity; None where the arm passes none.

    Only an arm with as many joints as its task has rows crosses singularities: with more it goes round them.
    """
    states = curve.line.reaction_state[: curve.ticks, 0]
    free = [j for j in range(problem.robot.dof) if j not in problem.held]
    if not len(states) or len(free) != (6 if problem.scenario.motion.task == "pose" else 3):
        return None
    along = np.tile(problem.q, (len(states) + 1, 1))
    along[1:, free] = states
    passed = PoseBatch(problem, along, np.zeros((len(along), 3))).passes_singularity(along)
    return int(passed.argmax()) if passed.any() else None


def _clause(sentence: str) -> str:
    return sentence.rstrip(".")
