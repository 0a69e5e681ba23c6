"""Requirements: the least conservative value of a variable that is acceptable, with all more conservative ones."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bumpstop.collision.verdict.as_given import doubts_as_given
from bumpstop.collision.verdict.finer_steps import fails_with_finer_steps
from bumpstop.errors import InputError, near_matches
from bumpstop.study.answer_warnings import FAILS_WITH_FINER_STEPS, warnings_of
from bumpstop.study.range import Range
from bumpstop.study.requirement.risk_search import RiskSearch
from bumpstop.study.study import MIN_RISK
from bumpstop.study.variable import Variable

if TYPE_CHECKING:
    from bumpstop.collision import Scenario
    from bumpstop.study.requirement.risk import Risk

# Whether higher values are worse.
HIGHER_IS_WORSE = {
    "motion.speed": True,
    "detector.thresholds": True,
    "detector.feedback_period_s": True,
    "reaction.joint_acceleration_rad_s2": False,
    "contact.padding": True,
}
# Looked at where no range is given: so many times less and more than the scenario's own value.
_SPREAD = 10.0
_PADDING_N_M = (1e3, 1e8)
_MIN, _MAX = {"reaction.joint_acceleration_rad_s2": 0.1, "motion.speed": 1e-2}, {"motion.speed": 1e4}
_ILL_CONDITIONED = (
    " The arm cannot follow its line here, as near a singularity; values between those looked at may fail."
)
_SINGULARITY = (
    "a singularity before a collision is detected for certain: whether it gets across or ends there, with collisions "
    "undetected, hangs on the last digits"
)


@dataclass(frozen=True)
class Requirement:
    """The answer.

    Attributes:
        variable, unit: what was varied.
        value: the least conservative that is met, and with it every more conservative one looked at; None: none is, or
            none has been put to the test.
        worse: ``"higher"`` or ``"lower"`` values.
        binding: what the next less conservative values fail by, ``"force"``, ``"pressure"``, ``"undetected"`` or
            ``"singularity"``; ``"range"`` where even the least conservative looked at is met, ``"untouched"`` where
            most cases hit nothing there.
        risk: accepted.
        risk_at_value, false_alarm_at_value: at ``value``, or at the most conservative value looked at where none is
            met.
        false_alarm_ok: that is no more than verdict.max_false_alarm.
        low, high: range looked at.
        reason: one sentence or two.
        ill_conditioned: the arm cannot follow its line, as near a singularity: the risk jumps from value to
            value, and values between those looked at may fail.
        evaluations: distributions computed.
        notes: what makes the answer mean less than it says: the warnings of ``bumpstop evaluate`` at ``value``
            are among them.
        fails_with_finer_steps: by these warnings ``value`` is not acceptable with finer simulation steps.
    """

    variable: str
    unit: str
    value: float | None
    worse: str
    binding: str
    risk: float
    risk_at_value: float
    false_alarm_at_value: float
    false_alarm_ok: bool
    low: float
    high: float
    reason: str
    ill_conditioned: bool
    evaluations: int
    notes: tuple[str, ...] = ()
    fails_with_finer_steps: bool = False

    def __str__(self) -> str:
        """What ``bumpstop require`` prints."""
        bound = "at most" if self.worse == "higher" else "at least"
        notes = "".join(f"\nnote: {note}" for note in self.notes)
        but = f", but {FAILS_WITH_FINER_STEPS}" if self.fails_with_finer_steps else ""
        return (
            f"{self.variable}: {'no value' if self.value is None else f'{bound} {self.value:g} {self.unit}'}{but}\n"
            f"{self.reason}\n"
            f"risk there {self.risk_at_value:.3g}, accepted {self.risk:g}; integrated distribution{notes}"
        )

    def to_json(self) -> dict[str, Any]:
        """The object that ``bumpstop require --json`` prints."""
        return {**self.__dict__, "notes": list(self.notes), "law": "exact"}


def solve_requirement(
    scenario: Scenario, vary: str, *, risk: float | None = None, low: float | None = None, high: float | None = None
) -> Requirement:
    """Find the least conservative value at which the risk is accepted, and at every more conservative one too.

    Harsher is faster, less sensitive, slower to look, slower to brake, or harder. The risk need not grow with it: with
    a body at a fixed distance, or an arm that starts from rest, it has a sampling ripple, which is scanned finely where
    it may pass what is accepted; of an elastic arm, or a body with damping, the force itself may fall, and the whole
    range is scanned finely up to the first failure.

    Args:
        scenario: a straight line against a body with limits, with Gaussian noise.
        vary: one of :data:`HIGHER_IS_WORSE`.
        risk: accepted probability of passing a limit; default: verdict.accepted_probability.
        low: end of the range looked at; default: a tenth of the scenario's own value.
        high: the other end; default: ten times that value.

    Raises:
        InputError: it cannot be varied, the range is empty, or the body has no limit for such a contact.
    """
    try:
        return _solve(scenario, vary, risk, low, high)
    except InputError as error:  # an argument is called as it is here
        raise InputError(error.field.removeprefix("--"), error.problem, error.valid) from None


def _solve(
    scenario: Scenario, vary: str, risk: float | None = None, low: float | None = None, high: float | None = None
) -> Requirement:
    vary = Variable(vary).name
    check_name(vary)
    _check_braking(scenario, vary)
    accepted = scenario.verdict.accepted_probability if risk is None else risk
    if not 0 < accepted < 1:
        raise InputError("--risk", f"{accepted:g} is no probability", "wanted more than 0 and less than 1")
    if accepted < MIN_RISK:
        problem = f"{accepted:g} is too small: less probable collisions are not followed"
        raise InputError("--risk", problem, f"wanted at least {MIN_RISK:g}")
    scenario = scenario.with_values({"verdict.accepted_probability": accepted})
    variable = Variable(vary)
    ends = _range(scenario, variable, low, high)
    search = RiskSearch(scenario, variable, ends, accepted, upward=HIGHER_IS_WORSE[vary])
    return _Answer(search, ends).requirement()


def check_name(name: str) -> None:
    """Refuse what is not in :data:`HIGHER_IS_WORSE`."""
    if name not in HIGHER_IS_WORSE:
        raise InputError("--vary", f"{name!r} is nothing to require", near_matches(name, HIGHER_IS_WORSE))


def _check_braking(scenario: Scenario, name: str) -> None:
    """Refuse to look for an acceleration that no stop is made with."""
    law = scenario.reaction.deceleration
    if name == "reaction.joint_acceleration_rad_s2" and law in ("constant_time", "table"):
        problem = f'decides about no stop with reaction.deceleration = "{law}"'
        raise InputError(
            "--vary", f"{name!r} {problem}", 'wanted another variable, or deceleration = "constant" or "ramp"'
        )


def require_curve(
    scenario: Scenario,
    vary: str,
    against: Range,
    *,
    risk: float | None = None,
    low: float | None = None,
    high: float | None = None,
) -> list[dict[str, Any]]:
    """Requirements for one variable at every value of another: a curve of equal risk.

    Returns:
        For each value of ``against`` the object of :meth:`Requirement.to_json`, with ``against``: name and value.
    """
    if against.variable.name == vary:
        raise InputError("--vary", f"{vary!r} is given twice", "wanted two different variables")
    if against.variable.key == "verdict.accepted_probability" and risk is not None:
        raise InputError("--risk", "would replace the risk that is varied", "leave one of the two out")
    return [
        {"against": {"variable": against.variable.name, "value": value, "unit": against.variable.unit(scenario)}}
        | _solve(against.variable.apply(scenario, value), vary, risk, low, high).to_json()
        for value in against.values
    ]


def _range(scenario: Scenario, variable: Variable, low: float | None, high: float | None) -> tuple[float, float]:
    if variable.name == "contact.padding":
        ends = _PADDING_N_M
    else:
        own = variable.value(scenario)
        ends = (
            max(own / _SPREAD, _MIN.get(variable.name, 0.0)),
            min(own * _SPREAD, _MAX.get(variable.name, math.inf)),
        )
        step = variable.quantum(scenario)
        if step is not None:
            ends = step, min(max(ends[1], 50 * step), 1.0)
    found = ends[0] if low is None else low, ends[1] if high is None else high
    if not (math.isfinite(found[0]) and math.isfinite(found[1]) and 0 < found[0] < found[1]):
        raise InputError(
            "--vary", f"{found[0]:g} to {found[1]:g} is no range", "wanted a lower end above 0, and a higher one"
        )
    return Range.of(variable, list(found), scenario).values[:2]  # type: ignore[return-value]


def _binding(failing: Risk) -> str:
    """What a value fails by."""
    mostly_undetected = failing.undetected > 0.5 * failing.over
    return "undetected" if mostly_undetected and failing.binding != "singularity" else failing.binding


class _Answer:
    """A search's outcome in words."""

    def __init__(self, search: RiskSearch, ends: tuple[float, float]) -> None:
        self.search, self.ends = search, ends
        self.unit = search.variable.unit(search.scenario)

    def requirement(self) -> Requirement:
        crossing = self.search.crossing()
        if crossing.value is None:
            return self._none(crossing.ill_conditioned)
        fails = crossing.fails
        binding = "range" if fails is None else _binding(self.search.risk(fails))
        return self._found(crossing.value, binding, crossing.ill_conditioned)

    def _found(self, value: float, binding: str, ill_conditioned: bool) -> Requirement:
        at = self.search.risk(value)
        limits = self.search.risks.problem.limits
        assert limits is not None
        if binding == "range":
            low, high = self.ends
            reason = f"Every value from {low:g} to {high:g} {self.unit} meets a risk of {self.search.accepted:g}."
        else:
            beyond = "Above" if self.search.upward else "Below"
            reason = f"{beyond} {value:g} {self.unit} "
            if binding == "singularity":
                reason += f"the arm passes {_SINGULARITY}."
            else:
                what = {"undetected": "collisions stay undetected", "force": "the force exceeds its limit"}.get(
                    binding, "the pressure exceeds its limit"
                )
                reason += f"{what} for {limits.label} more often than {self.search.accepted:g}."
        allowed = self.search.scenario.verdict.max_false_alarm
        if at.untouched and at.false_alarm <= allowed:
            where = f"at {value:g} {self.unit} no limit is passed, but nothing is put to the test"
            reason = f"No answer: {where}. {at.untouched}"
            return self._result(None, "untouched", at, reason, ill_conditioned)
        if at.false_alarm > allowed:
            reason += f" Alarms before contact there have a probability of {at.false_alarm:.2g}, more than {allowed:g}."
        return self._result(value, binding, at, reason, ill_conditioned)

    def _none(self, ill_conditioned: bool) -> Requirement:
        at = self.search.risk(self.search.most_conservative)
        binding = _binding(at)
        low, high = self.ends
        most_conservative = f"even at {self.search.most_conservative:g} {self.unit}"
        none = f"No value from {low:g} to {high:g} {self.unit} meets it"
        if binding == "singularity":
            reason = f"{none}: {most_conservative} the arm passes {_SINGULARITY}."
            return self._result(None, binding, at, reason, ill_conditioned)
        why = f"{most_conservative} limits are exceeded with a probability of {at.over:.2g}"
        undetected_force = self.search.risks.undetected
        limit = self.search.risks.force_limit
        if at.undetected > 0.5 * at.over:
            why += ", mostly by collisions that are never detected"
        elif self.search.variable.name != "detector.thresholds" and undetected_force > limit:
            why += f": {undetected_force:.3g} N stay undetected here, and the limit is {limit:.3g} N"
        elif self.search.variable.name != "motion.speed":
            why += ": what the arm travels after detection is too much at this speed"
        return self._result(None, binding, at, f"{none}: {why}.", ill_conditioned)

    def _result(self, value: float | None, binding: str, at: Risk, reason: str, ill_conditioned: bool) -> Requirement:
        warnings: tuple[str, ...] = ()
        if value is not None:
            warnings = warnings_of(lambda: self.search.variable.apply(self.search.scenario, value))
        # What is looked for is not assumed.
        given = doubts_as_given(self.search.variable.apply(self.search.scenario, self.search.most_conservative))
        return Requirement(
            variable=self.search.variable.name,
            unit=self.unit,
            value=value,
            worse="higher" if self.search.upward else "lower",
            binding=binding,
            risk=self.search.accepted,
            risk_at_value=at.over,
            false_alarm_at_value=at.false_alarm,
            false_alarm_ok=at.false_alarm <= self.search.scenario.verdict.max_false_alarm,
            low=self.ends[0],
            high=self.ends[1],
            reason=reason + (_ILL_CONDITIONED if ill_conditioned and binding != "singularity" else ""),
            ill_conditioned=ill_conditioned,
            evaluations=self.search.risks.evaluations,
            notes=tuple(dict.fromkeys([*given, *warnings])),
            fails_with_finer_steps=fails_with_finer_steps(warnings),
        )
