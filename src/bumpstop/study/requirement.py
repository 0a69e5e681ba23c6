"""Requirements: the harshest value of a variable at which a scenario is still acceptable, and every milder one too."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError, near_matches
from bumpstop.study.risk import Risk, VariedRisk
from bumpstop.study.variable import Range, Variable

if TYPE_CHECKING:
    from bumpstop.collision import Scenario

# Whether higher values are harsher.
HIGHER_IS_HARSHER = {
    "motion.speed": True,
    "detector.thresholds": True,
    "detector.feedback_period_s": True,
    "reaction.joint_acceleration_rad_s2": False,
    "contact.padding": True,
}
# Looked at where no range is given: so many times less and more than the scenario's own value.
_SPREAD = 10.0
_PADDING_N_M = (1e3, 1e8)
_LEAST, _MOST = {"reaction.joint_acceleration_rad_s2": 0.1, "motion.speed": 1e-2}, {"motion.speed": 1e4}
_SCAN = 14
# Where the arm cannot follow its line the risk is less even; the coarse values are among these.
_FINE_SCAN = 2 * _SCAN - 1
_PRECISION, _ERRATIC_PRECISION = 1e-4, 1e-3
_LEAST_RISK = 1e-30
_ERRATIC = " The arm cannot follow its line here, as near a singularity; values between those looked at may fail."
_SINGULARITY = (
    "a singularity before a collision is noticed for certain: whether it gets across or ends there, with collisions "
    "unnoticed, hangs on the last digits"
)
# A fixed offset makes the risk a sawtooth: so many values in each tooth, and so many at most in all.
_IN_A_TOOTH, _MOST_TEETH_VALUES = 6, 600


@dataclass(frozen=True)
class Requirement:
    """The answer.

    Attributes:
        variable, unit: what was varied.
        value: the harshest that is met, and with it every milder one looked at; None: none is.
        harsher: ``"higher"`` or ``"lower"`` values.
        binding: what the next harsher values fail by, ``"force"``, ``"pressure"``, ``"undetected"`` or
            ``"singularity"``; ``"range"`` where even the harshest looked at is met.
        risk: accepted.
        risk_at_value, false_alarm_at_value: at ``value``, or at the mildest value looked at where none is met.
        false_alarm_ok: that is no more than verdict.max_false_alarm.
        low, high: range looked at.
        reason: one sentence or two.
        erratic: the arm cannot follow its line, as near a singularity: the risk jumps from value to value, and values
            between those looked at may fail.
        evaluations: laws worked out.
    """

    variable: str
    unit: str
    value: float | None
    harsher: str
    binding: str
    risk: float
    risk_at_value: float
    false_alarm_at_value: float
    false_alarm_ok: bool
    low: float
    high: float
    reason: str
    erratic: bool
    evaluations: int

    def to_json(self) -> dict[str, Any]:
        """The object that ``bumpstop require --json`` prints."""
        return {**self.__dict__, "law": "exact"}


def require(
    scenario: Scenario, vary: str, *, risk: float | None = None, low: float | None = None, high: float | None = None
) -> Requirement:
    """Find the harshest value of a variable at which the risk is accepted, and at every milder one too.

    Harsher is faster, less sensitive, slower to look, slower to brake, or harder. The risk need not grow with it: with
    a body at a fixed distance it is a sawtooth, which is scanned finely where it may pass what is accepted.

    Args:
        scenario: a straight line against a body with limits, with Gaussian noise.
        vary: one of :data:`HIGHER_IS_HARSHER`.
        risk: accepted probability of passing a limit; default: verdict.risk.
        low: end of the range looked at; default: a tenth of the scenario's own value.
        high: the other end; default: ten times that value.

    Raises:
        InputError: it cannot be varied, the range is empty, or the body has no limit for such a contact.
    """
    check_name(vary)
    accepted = scenario.verdict.risk if risk is None else risk
    if not 0 < accepted < 1:
        raise InputError("--risk", f"{accepted:g} is no probability", "wanted more than 0 and less than 1")
    scenario = scenario.with_values({"verdict.risk": accepted})
    variable = Variable(vary)
    ends = _range(scenario, variable, low, high)
    search = _Search(scenario, variable, ends, accepted)
    return search.answer()


def check_name(name: str) -> None:
    """Refuse what is not in :data:`HIGHER_IS_HARSHER`."""
    if name not in HIGHER_IS_HARSHER:
        raise InputError("--vary", f"{name!r} is nothing to require", near_matches(name, HIGHER_IS_HARSHER))


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
    return [
        {"against": {"variable": against.variable.name, "value": value, "unit": against.variable.unit}}
        | require(against.variable.apply(scenario, value), vary, risk=risk, low=low, high=high).to_json()
        for value in against.values
    ]


def _range(scenario: Scenario, variable: Variable, low: float | None, high: float | None) -> tuple[float, float]:
    if variable.name == "contact.padding":
        ends = _PADDING_N_M
    else:
        own = variable.value(scenario)
        ends = (
            max(own / _SPREAD, _LEAST.get(variable.name, 0.0)),
            min(own * _SPREAD, _MOST.get(variable.name, math.inf)),
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
    mostly_deaf = failing.undetected > 0.5 * failing.over
    return "undetected" if mostly_deaf and failing.binding != "singularity" else failing.binding


class _Search:
    def __init__(self, scenario: Scenario, variable: Variable, ends: tuple[float, float], accepted: float) -> None:
        self.scenario, self.variable, self.ends, self.accepted = scenario, variable, ends, accepted
        self.upward = HIGHER_IS_HARSHER[variable.name]
        self.mildest, self.harshest = ends if self.upward else ends[::-1]
        self.quantum = variable.quantum(scenario)
        self.risks = VariedRisk(scenario, variable)
        self.known: dict[float, Risk] = {}

    def answer(self) -> Requirement:
        value, fails = self._first_failure(self._scan(_SCAN))
        erratic = not self._risk(self.mildest if fails is None else fails).follows
        if erratic and fails != self.mildest:
            value, fails = self._first_failure(self._scan(_FINE_SCAN))
        if fails == self.mildest:
            return self._none(erratic)
        if fails is None:
            return self._found(value, "range", erratic)
        value, fails = self._refine_teeth(value, fails)
        value, fails = self._bisect(value, fails, _ERRATIC_PRECISION if erratic else _PRECISION)
        value = self._rounded(value)
        return self._found(value, _binding(self._risk(fails)), erratic)

    def _first_failure(self, values: list[float]) -> tuple[float, float | None]:
        """The last value before the first that fails, and that one; None: none does."""
        value = self.mildest
        for candidate in values:
            if not self._met(candidate):
                return value, candidate
            value = candidate
        return value, None

    def _risk(self, value: float) -> Risk:
        if value not in self.known:
            self.known[value] = self.risks.at(value)
        return self.known[value]

    def _met(self, value: float) -> bool:
        return self._risk(value).met

    def _scan(self, count: int) -> list[float]:
        """From the mildest value to the harshest, in even ratios."""
        first, last = self.mildest, self.harshest
        values = [first * (last / first) ** (i / (count - 1)) for i in range(count - 1)] + [last]
        if self.quantum is None:
            return values
        return list(dict.fromkeys(self._quantised(value) for value in values))

    def _quantised(self, value: float) -> float:
        return self.variable.quantised(self.scenario, value)

    def _refine_teeth(self, met: float, fails: float) -> tuple[float, float]:
        """Look below the first failure for earlier ones, where the body's distance is fixed."""
        if self.scenario.contact.offset_law != "fixed":
            return met, fails
        start, finest = self._teeth(fails)
        count = min(_MOST_TEETH_VALUES, max(2, math.ceil(abs(math.log(fails / start)) / finest)))
        value = start if self._met(start) else self.mildest
        for i in range(1, count + 1):
            candidate = start * (fails / start) ** (i / count)
            if self.quantum is not None:
                candidate = self._quantised(candidate)
            if not self._met(candidate):
                return value, candidate
            value = candidate
        return met, fails

    def _teeth(self, fails: float) -> tuple[float, float]:
        """Where a sawtooth may first pass the limit, and how far apart in the logarithm its points must be."""
        problem = self.risks.problem
        own = 1.0 if self.variable.name == "contact.padding" else self.variable.value(self.scenario)
        speed = problem.approach_speed * (fails / own if self.variable.name == "motion.speed" else 1.0)
        period = problem.period_steps * problem.scenario.simulation.step_s
        if self.variable.name == "detector.feedback_period_s":
            period = fails
        travel = speed * period
        deepest = problem.offset_size + self.risks.force_limit / problem.stiffness
        share = min(0.6, 3 * problem.stiffness * travel / self.risks.force_limit)
        start = fails * (1 - share) if self.upward else fails / (1 - share)
        start = max(start, self.mildest) if self.upward else min(start, self.mildest)
        return start, travel / deepest / _IN_A_TOOTH

    def _bisect(self, met: float, fails: float, precision: float) -> tuple[float, float]:
        """Narrow the last step down: by straight lines through the logarithms, and by halves where that is slow."""
        halve = False
        while True:
            if self.quantum is not None:
                middle = self._quantised((met + fails) / 2)
                if middle in (met, fails):
                    return met, fails
            else:
                width = math.log(fails / met)
                if abs(width) < precision:
                    return met, fails
                share = 0.5 if halve else self._crossing(met, fails)
                # Just beside the crossing, on the side that is farther away, so that the next one closes the bracket.
                share = min(max(share + math.copysign(0.4 * precision / abs(width), 0.5 - share), 0.02), 0.98)
                middle = met * math.exp(width * share)
            new = (middle, fails) if self._met(middle) else (met, middle)
            halve = not halve and abs(math.log(new[1] / new[0])) > 0.5 * abs(math.log(fails / met))
            met, fails = new

    def _crossing(self, met: float, fails: float) -> float:
        """Share of the way from the value that is met at which the risk is the accepted one.

        The line goes through the two values looked at whose risks are nearest to it; where that leads out of the
        bracket, through its ends.
        """
        if self._risk(fails).binding == "singularity":
            return 0.5
        accepted = math.log(self.accepted)
        points = [(math.log(value), math.log(max(risk.over, _LEAST_RISK))) for value, risk in self.known.items()]
        ends = [(math.log(value), math.log(max(self._risk(value).over, _LEAST_RISK))) for value in (met, fails)]
        points.sort(key=lambda point: abs(point[1] - accepted))
        for (x, y), (x2, y2) in (points[:2], ends):
            if y == y2:
                continue
            share = (x + (x2 - x) * (accepted - y) / (y2 - y) - ends[0][0]) / (ends[1][0] - ends[0][0])
            if 0 < share < 1:
                return share
        return 0.5

    def _rounded(self, value: float) -> float:
        """To four digits on the safe side, where that is met too."""
        if self.quantum is not None:
            return value
        unit = 10.0 ** (math.floor(math.log10(value)) - 3)
        steps = math.floor(value / unit) if self.upward else math.ceil(value / unit)
        short = float(f"{steps * unit:.4g}")
        inside = short >= self.mildest if self.upward else short <= self.mildest
        return short if inside and self._met(short) else value

    def _found(self, value: float, binding: str, erratic: bool) -> Requirement:
        at = self._risk(value)
        unit, limits = self.variable.unit, self.risks.problem.limits
        assert limits is not None
        if binding == "range":
            reason = f"Every value from {self.ends[0]:g} to {self.ends[1]:g} {unit} meets a risk of {self.accepted:g}."
        else:
            beyond = "Above" if self.upward else "Below"
            reason = f"{beyond} {value:g} {unit} "
            if binding == "singularity":
                reason += f"the arm passes {_SINGULARITY}."
            else:
                what = {"undetected": "collisions go unnoticed", "force": "the force passes its limit"}.get(
                    binding, "the pressure passes its limit"
                )
                reason += f"{what} for {limits.label} more often than {self.accepted:g}."
        allowed = self.scenario.verdict.max_false_alarm
        if at.false_alarm > allowed:
            reason += f" Alarms before contact there have a probability of {at.false_alarm:.2g}, more than {allowed:g}."
        return self._result(value, binding, at, reason, erratic)

    def _none(self, erratic: bool) -> Requirement:
        at = self._risk(self.mildest)
        binding = _binding(at)
        mildest = f"even at {self.mildest:g} {self.variable.unit}"
        if binding == "singularity":
            reason = f"No value meets it: {mildest} the arm passes {_SINGULARITY}."
            return self._result(None, binding, at, reason, erratic)
        at = self.risks.at(self.mildest, closely=True)
        why = f"{mildest} limits are passed with a probability of {at.over:.2g}"
        deaf = self.risks.unnoticed
        limit = self.risks.force_limit
        if at.undetected > 0.5 * at.over:
            why += ", mostly by collisions that are never noticed"
        elif self.variable.name != "detector.thresholds" and deaf > limit:
            why += f": {deaf:.3g} N go unnoticed here, and the limit is {limit:.3g} N"
        elif self.variable.name != "motion.speed":
            why += ": what the arm travels after detection is too much at this speed"
        return self._result(None, binding, at, f"No value meets it: {why}.", erratic)

    def _result(self, value: float | None, binding: str, at: Risk, reason: str, erratic: bool) -> Requirement:
        return Requirement(
            variable=self.variable.name,
            unit=self.variable.unit,
            value=value,
            harsher="higher" if self.upward else "lower",
            binding=binding,
            risk=self.accepted,
            risk_at_value=at.over,
            false_alarm_at_value=at.false_alarm,
            false_alarm_ok=at.false_alarm <= self.scenario.verdict.max_false_alarm,
            low=self.ends[0],
            high=self.ends[1],
            reason=reason + (_ERRATIC if erratic and binding != "singularity" else ""),
            erratic=erratic,
            evaluations=self.risks.evaluations,
        )
