"""Requirements: the harshest value of a variable at which a scenario is still acceptable, and every milder one too."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError, near_matches
from bumpstop.study.risk import Risk, VariedRisk
from bumpstop.study.sawtooth import Teeth, is_sawtooth, pick_up_of
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
# Of a risk that is a sawtooth so many values are looked at, at most.
_MOST_TEETH_VALUES = 600
# How closely a tooth's summit is found, in the logarithm.
_SUMMIT = 3e-4
# Of the accepted risk: no tooth is so high that a value with less is beside one that fails.
_SOME_RISK = 1e-6
# What changes how an arm gets going from rest.
_CHANGES_START = ("motion.speed", "reaction.joint_acceleration_rad_s2")


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
    a body at a fixed distance, or an arm that starts from rest, it is a sawtooth, which is scanned finely where it may
    pass what is accepted.

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
        value, fails = self._refine_teeth(value, fails)
        if fails is None:
            return self._found(value, "range", erratic)
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

    def _refine_teeth(self, met: float, fails: float | None) -> tuple[float, float | None]:
        """Look below the first failure, or the harsh end, for earlier ones, where the risk is a sawtooth."""
        if not is_sawtooth(self.scenario):
            return met, fails
        last = self.harshest if fails is None else fails
        while True:
            candidates = self._with_summits(self._on_teeth(last))
            first = next((i for i, candidate in enumerate(candidates) if not self._met(candidate)), None)
            if first is None:
                return met, fails
            if first:
                return candidates[first - 1], candidates[first]
            # A failure so far down has teeth of its own below it.
            last = candidates[0]

    def _on_teeth(self, last: float) -> list[float]:
        """Values close enough together for the teeth below one, from the mildest to itself."""
        start, apart = self._teeth(last)
        first, end = self._hardness(start), self._hardness(last)
        count = min(_MOST_TEETH_VALUES, max(2, math.ceil(abs(math.log(end / first)) / apart)))
        values = [start, *(self._softened(first * (end / first) ** (i / count)) for i in range(1, count)), last]
        return values if self.quantum is None else list(dict.fromkeys(self._quantised(value) for value in values))

    def _with_summits(self, values: list[float]) -> list[float]:
        """The values up to the first that fails, with the summits between them: a tooth may fail at its point alone."""
        found: list[float] = []
        for i, value in enumerate(values):
            found.append(value)
            if not self._met(value):
                break
            beside = values[max(i - 1, 0)], values[min(i + 1, len(values) - 1)]
            highest = max(_LEAST_RISK, *(self._risk(each).over for each in beside))
            if self.quantum is None and self._risk(value).over >= highest:
                found.append(self._summit(*beside))
        return sorted(found, reverse=not self.upward)

    def _summit(self, low: float, high: float) -> float:
        """The value of the greatest risk between two, by golden sections, or the first that fails."""
        golden = (math.sqrt(5) - 1) / 2
        width = math.log(high / low)
        inner = [low * math.exp(width * (1 - golden)), low * math.exp(width * golden)]
        while all(self._met(value) for value in inner) and abs(math.log(high / low)) > _SUMMIT:
            first_is_higher = self._risk(inner[0]).over > self._risk(inner[1]).over
            if first_is_higher:
                high = inner[1]
                inner = [low * math.exp(math.log(high / low) * (1 - golden)), inner[0]]
            else:
                low = inner[0]
                inner = [inner[1], low * math.exp(math.log(high / low) * golden)]
        return max(inner, key=lambda value: self._risk(value).over)

    def _teeth(self, last: float) -> tuple[float, float]:
        """Where a sawtooth may first pass the limit, and how far apart in the logarithm its points must be."""
        problem, name = self.risks.problem, self.variable.name
        hardness = self._hardness(last)
        own = self._hardness(self.variable.value(self.scenario)) if name != "contact.padding" else problem.stiffness
        scale = hardness / own
        teeth = Teeth.of(
            problem,
            self.risks.force_limit,
            speed=problem.approach_speed * (scale if name == "motion.speed" else 1.0),
            stiffness=hardness if name == "contact.padding" else problem.stiffness,
            period=last if name == "detector.feedback_period_s" else None,
            pick_up=pick_up_of(problem) * (scale if name == "reaction.joint_acceleration_rad_s2" else 1.0),
        )
        start = self._softened(hardness * (1 - teeth.share) if self.upward else hardness / (1 - teeth.share))
        if self.scenario.motion.start == "rest" and name in _CHANGES_START:
            # What it changes may be the way before contact alone, and every tooth the same: from where there is a risk.
            known = sorted(self.known, reverse=not self.upward)
            some = [self._risk(value).over > _SOME_RISK * self.accepted for value in known]
            first = known[max(some.index(True) - 1, 0)] if any(some) else start
            start = min(start, first) if self.upward else max(start, first)
        return max(start, self.mildest) if self.upward else min(start, self.mildest), teeth.apart

    def _hardness(self, value: float) -> float:
        """What the force is in proportion to: the value itself, or the stiffness of padding and body in series."""
        if self.variable.name != "contact.padding":
            return value
        return 1 / (1 / self.risks.problem.body_stiffness + 1 / value)

    def _softened(self, hardness: float) -> float:
        """The value of a hardness."""
        if self.variable.name != "contact.padding":
            return hardness
        return 1 / (1 / hardness - 1 / self.risks.problem.body_stiffness)

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
