"""The search for the value of a variable at which a risk passes what is accepted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.study.requirement.risk import Risk, VariedRisk
from bumpstop.study.requirement.sampling_ripple import (
    FALL_APART,
    SOME_RISK,
    RippleScan,
    force_may_fall,
    has_ripple,
    initial_acceleration,
    nearly_fails,
    risk_may_fall,
)

if TYPE_CHECKING:
    from bumpstop.collision import Scenario
    from bumpstop.study.variable import Variable

_SCAN = 14
# Where the arm cannot follow its line the risk is less even; the coarse values are among these.
_FINE_SCAN = 2 * _SCAN - 1
_PRECISION, _ILL_CONDITIONED_PRECISION = 1e-4, 1e-3
_MIN_RISK = 1e-30
# A root search must see no zero: a value is met, or it is not.
_SMALL = 1e-9
# So much more conservative than a crossing of a risk that jumps others are looked for, in the logarithm.
_BESIDE = (0.03, 0.024, 0.018, 0.012, 0.006)
# Of a risk that has a sampling ripple so many values are looked at, at most.
_MAX_RIPPLE_VALUES = 600
# Steps of the fourth digit that an answer is rounded by, at most.
_MAX_ROUNDINGS = 20
# How closely a crest's peak is found, in the logarithm.
_PEAK = 3e-4
# What changes how an arm gets going from rest.
_CHANGES_START = ("motion.speed", "reaction.joint_acceleration_rad_s2")


@dataclass(frozen=True)
class Crossing:
    """Where a risk passes what is accepted.

    Attributes:
        value: the least conservative that is met, with every more conservative one looked at; None: not even the most
            conservative is.
        fails: the next less conservative value looked at; None: even the least conservative of the range is met.
        ill_conditioned: the arm cannot follow its line, so the risk jumps from value to value.
    """

    value: float | None
    fails: float | None
    ill_conditioned: bool


class RiskSearch:
    """The search for the least conservative value of a variable at which a risk is accepted.

    Args:
        upward: higher values are worse.
        ends: of the range looked at.
        accepted: probability of passing a limit.
    """

    def __init__(
        self, scenario: Scenario, variable: Variable, ends: tuple[float, float], accepted: float, *, upward: bool
    ) -> None:
        self.scenario, self.variable, self.accepted, self.upward = scenario, variable, accepted, upward
        self.most_conservative, self.least_conservative = ends if self.upward else ends[::-1]
        self.quantum = variable.quantum(scenario)
        self.risks = VariedRisk(scenario, variable)
        self.known: dict[float, Risk] = {}
        self._force_may_fall = force_may_fall(scenario)

    def crossing(self) -> Crossing:
        """Scan, look at crests where the risk has any, and narrow the last step down."""
        value, fails = self._first_failure(self._scan(_SCAN))
        ill_conditioned = not self.risk(self.most_conservative if fails is None else fails).follows
        if ill_conditioned and fails != self.most_conservative and not self._force_may_fall:
            value, fails = self._first_failure(self._scan(_FINE_SCAN))
        if fails == self.most_conservative:
            return Crossing(None, fails, ill_conditioned)
        value, fails = self._refine_ripple(value, fails)
        if fails is None:
            return Crossing(value, None, ill_conditioned)
        value, fails = self._narrowed(value, fails, _ILL_CONDITIONED_PRECISION if ill_conditioned else _PRECISION)
        if ill_conditioned:
            value, fails = self._narrowed(*self._first_failure_beside(value, fails), _ILL_CONDITIONED_PRECISION)
        return Crossing(self._rounded(value), fails, ill_conditioned)

    def risk(self, value: float) -> Risk:
        """At a value, computed once."""
        if value not in self.known:
            self.known[value] = self.risks.at(value)
        return self.known[value]

    def _first_failure(self, values: list[float]) -> tuple[float, float | None]:
        """The last value before the first that fails, and that one; None: none does."""
        value = self.most_conservative
        for candidate in values:
            if not self._met(candidate):
                return value, candidate
            value = candidate
        return value, None

    def _met(self, value: float) -> bool:
        return self.risk(value).met

    def _first_failure_beside(self, met: float, fails: float) -> tuple[float, float]:
        """The same crossing, or one a little more conservative: a risk that jumps may exceed and come back."""
        if self.quantum is not None:
            return met, fails
        more_conservative = [met * math.exp(-step if self.upward else step) for step in _BESIDE]
        values = [value for value in more_conservative if (value > self.most_conservative) == self.upward]
        before, failing = self._first_failure(values)
        return (met, fails) if failing is None else (before, failing)

    def _scan(self, count: int) -> list[float]:
        """From the most conservative value to the least conservative, in even ratios, close where a force may fall."""
        if self._force_may_fall:
            return self._spaced(self.most_conservative, self.least_conservative, FALL_APART)
        first, last = self.most_conservative, self.least_conservative
        values = [first * (last / first) ** (i / (count - 1)) for i in range(count - 1)] + [last]
        if self.quantum is None:
            return values
        return list(dict.fromkeys(self._quantised(value) for value in values))

    def _quantised(self, value: float) -> float:
        return self.variable.quantised(self.scenario, value)

    def _refine_ripple(self, met: float, fails: float | None) -> tuple[float, float | None]:
        """Look below the first failure, or the last value, for earlier ones, where the risk may fall."""
        last = self.least_conservative if fails is None else fails
        # Whether a collision is detected before the motion ends hangs on where the last ticks fall.
        last_ticks_decide = self.quantum is not None and self.risk(last).undetected > SOME_RISK * self.accepted
        if not (last_ticks_decide or risk_may_fall(self.scenario)):
            return met, fails
        for _ in range(_MAX_RIPPLE_VALUES):
            candidates = self._with_peaks(self._on_crests(last))
            first = next((i for i, candidate in enumerate(candidates) if not self._met(candidate)), None)
            if first is None:
                break
            if first:
                met, fails = candidates[first - 1], candidates[first]
            if candidates[first] == last:
                break
            # A failure farther down has crests of its own below it.
            last = candidates[first]
        return met, fails

    def _on_crests(self, last: float) -> list[float]:
        """Values close enough together for the crests below one, from the most conservative to itself."""
        if self.quantum is not None and abs(last - self.most_conservative) <= _MAX_RIPPLE_VALUES * self.quantum:
            # No peaks are searched for between whole steps, so each is looked at.
            start = self.most_conservative
            steps = round((last - start) / self.quantum)
            return [self._quantised(start + i * self.quantum) for i in range(steps)] + [last]
        if not self._force_may_fall:
            return self._spaced(*self._ripple(last))
        ripple = self._spaced(*self._ripple(last)) if has_ripple(self.scenario) else [last]
        earlier = [value for value in self._scan(_SCAN) if (value < last) == self.upward and value != last]
        return sorted({*earlier, *ripple}, reverse=not self.upward)

    def _spaced(self, start: float, last: float, apart: float) -> list[float]:
        """From one value to another, both among them, so far apart in the logarithm of what the force grows with."""
        first, end = self._hardness(start), self._hardness(last)
        count = min(_MAX_RIPPLE_VALUES, max(2, math.ceil(abs(math.log(end / first)) / apart)))
        values = [start, *(self._softened(first * (end / first) ** (i / count)) for i in range(1, count)), last]
        return values if self.quantum is None else list(dict.fromkeys(self._quantised(value) for value in values))

    def _with_peaks(self, values: list[float]) -> list[float]:
        """The values up to the first that fails, with the peaks between them: a crest may fail at its point alone."""
        found: list[float] = []
        for i, value in enumerate(values):
            found.append(value)
            if not self._met(value):
                break
            beside = values[max(i - 1, 0)], values[min(i + 1, len(values) - 1)]
            highest = max(self.risk(each).height for each in beside)
            if self.quantum is None and self.risk(value).height >= highest and self._may_peak(value):
                found.append(self._peak(*beside))
        return sorted(found, reverse=not self.upward)

    def _may_peak(self, value: float) -> bool:
        """Whether a crest about a value may fail: ripples are looked at where they may alone."""
        risk = self.risk(value)
        some = risk.over > SOME_RISK * self.accepted
        return not self._force_may_fall or some or bool(nearly_fails(risk.force, self.risks.force_limit))

    def _peak(self, low: float, high: float) -> float:
        """The value of the greatest risk between two, by golden sections, or the first that fails."""
        golden = (math.sqrt(5) - 1) / 2
        width = math.log(high / low)
        inner = [low * math.exp(width * (1 - golden)), low * math.exp(width * golden)]
        while all(self._met(value) for value in inner) and abs(math.log(high / low)) > _PEAK:
            first_is_higher = self.risk(inner[0]).height > self.risk(inner[1]).height
            if first_is_higher:
                high = inner[1]
                inner = [low * math.exp(math.log(high / low) * (1 - golden)), inner[0]]
            else:
                low = inner[0]
                inner = [inner[1], low * math.exp(math.log(high / low) * golden)]
        return max(inner, key=lambda value: self.risk(value).height)

    def _ripple(self, last: float) -> tuple[float, float, float]:
        """Where a sampling ripple may first pass the limit below ``last``, that, and how far apart its points must be.

        The distance is one in the logarithm.
        """
        problem, name = self.risks.problem, self.variable.name
        hardness = self._hardness(last)
        own = self._hardness(self.variable.value(self.scenario)) if name != "contact.padding" else problem.stiffness
        scale = hardness / own
        ripple = RippleScan.of(
            problem,
            self.risks.force_limit,
            speed=problem.approach_speed * (scale if name == "motion.speed" else 1.0),
            stiffness=hardness if name == "contact.padding" else problem.stiffness,
            period=last if name == "detector.feedback_period_s" else None,
            start_acceleration=initial_acceleration(problem)
            * (scale if name == "reaction.joint_acceleration_rad_s2" else 1.0),
        )
        start = self._softened(hardness * (1 - ripple.share) if self.upward else hardness / (1 - ripple.share))
        if self.scenario.motion.start == "rest" and name in _CHANGES_START:
            # What it changes may be the way before contact alone, and every crest the same: from where there is a risk.
            known = sorted(self.known, reverse=not self.upward)
            some = [self.risk(value).over > SOME_RISK * self.accepted for value in known]
            first = known[max(some.index(True) - 1, 0)] if any(some) else start
            start = min(start, first) if self.upward else max(start, first)
        start = max(start, self.most_conservative) if self.upward else min(start, self.most_conservative)
        return start, last, ripple.apart

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

    def _narrowed(self, met: float, fails: float, precision: float) -> tuple[float, float]:
        """The last step narrowed down to ``precision`` in the logarithm, or to whole steps."""
        if self.quantum is not None:
            while (middle := self._quantised((met + fails) / 2)) not in (met, fails):
                met, fails = (middle, fails) if self._met(middle) else (met, middle)
            return met, fails
        width = math.log(fails / met)
        if abs(width) < precision:
            return met, fails
        from scipy.optimize import brentq

        bracket = {0.0: met, 1.0: fails}

        def excess(share: float) -> float:
            """Logarithm of risk over accepted risk; its sign says whether the value is met."""
            value = bracket.setdefault(share, met * math.exp(width * share))
            over = math.log(max(self.risk(value).over, _MIN_RISK) / self.accepted)
            return min(over, -_SMALL) if self._met(value) else max(over, _SMALL)

        brentq(excess, 0.0, 1.0, xtol=precision / abs(width), rtol=4 * np.finfo(float).eps)
        # Brent's method keeps a root between two values that it has looked at, and ends when they are that close.
        failing = min(share for share, value in bracket.items() if not self._met(value))
        return bracket[max(share for share in bracket if share < failing)], bracket[failing]

    def _rounded(self, value: float) -> float:
        """To four digits on the safe side, where that is met too."""
        if self.quantum is not None:
            return value
        unit = 10.0 ** (math.floor(math.log10(value)) - 3)
        steps = math.floor(value / unit) if self.upward else math.ceil(value / unit)
        # A risk that dips may exceed what is accepted once more at the first of them.
        for away in range(_MAX_ROUNDINGS):
            short = float(f"{(steps - away if self.upward else steps + away) * unit:.4g}")
            if (short < self.most_conservative) == self.upward and short != self.most_conservative:
                break
            if self._met(short):
                return short
        return value
