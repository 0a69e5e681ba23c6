"""Designs about a scenario: what a change costs, what it comes to, and the search for the cheapest that is enough."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.rounding import rounded
from bumpstop.study.answer_warnings import warnings_of
from bumpstop.study.range import Range
from bumpstop.study.requirement.risk import allowed_force
from bumpstop.study.variable import Variable

if TYPE_CHECKING:
    from bumpstop.collision import Scenario

# Below this a false alarm is so rare that no digit of it matters, and its logarithm stays finite.
_RAREST = 1e-30
# Combinations of whole steps, with a search over all other variables for each, or with a distribution where there are
# none.
_MAX_SEARCHES, _MAX_EVALUATIONS = 64, 4096
# Values of one variable looked at, as many on either side of the present one.
_TRIALS = 16
# Rounds through all variables on the way to the most conservative values: one may only matter where another has
# changed.
_ROUNDS = 3
# Margin of a force without bound: far over, and still a number that a search can improve on.
_UNBOUNDED = -20.0
# Margins closer than this are the same: false alarms know nothing of most variables, but to rounding.
_SAME = 1e-6
# So much more of the whole cost is no reason for one more change.
_SAME_COST = 1e-5


@dataclass(frozen=True)
class CostRate:
    """What it costs to change a variable.

    Attributes:
        swept: the variable and the range it may move in.
        per_unit: cost of one unit of change, up or down; above 0.
    """

    swept: Range
    per_unit: float

    @classmethod
    def of(cls, swept: Range, written: str) -> CostRate:
        """Read a cost.

        Raises:
            InputError: it is not a finite number above 0.
        """
        try:
            cost_rate = float(written)
        except ValueError:
            cost_rate = math.nan
        if not 0 < cost_rate < math.inf:
            raise InputError("--cost", f"{written!r} of {swept.variable.name} is no cost", "wanted a number above 0")
        return cls(swept, cost_rate)

    def to_json(self) -> str:
        """As a person writes it."""
        return f"{self.swept.variable.name}={self.per_unit:.12g}"


@dataclass(frozen=True)
class Design:
    """A way to meet the limits.

    Attributes:
        values: of every priced variable.
        cost: of the changes.
        margin: log of the allowed over the accepted quantile of the peak force; at least 0 where the limits are met.
        false_alarm_margin: log of the accepted over the probability of a false alarm.
        untouched: why most cases hit nothing, so that the design has not been put to the test; empty where they do.
        warnings: to be read beside the verdict, of a design that is told.
    """

    values: Mapping[str, float]
    cost: float
    margin: float
    false_alarm_margin: float
    untouched: str
    warnings: tuple[str, ...] = ()

    @property
    def meets(self) -> bool:
        """Force, pressure and false alarms are all within what is accepted, and most cases hit something."""
        return self.margin >= 0 and self.false_alarm_margin >= 0 and not self.untouched

    def to_json(self) -> dict[str, Any]:
        """Everything."""
        return {
            "values": dict(self.values),
            "cost": self.cost,
            "force_over_allowed": math.exp(-self.margin),
            "meets": self.meets,
            "warnings": list(self.warnings),
        }


class DesignSearch:
    """Distributions about one scenario, kept once computed."""

    def __init__(self, scenario: Scenario, cost_rates: Sequence[CostRate]) -> None:
        self.scenario, self.cost_rates = scenario, cost_rates
        self.variables: list[Variable] = [cost_rate.swept.variable for cost_rate in cost_rates]
        self.start = np.array([variable.value(scenario) for variable in self.variables])
        self.low = np.minimum(self.start, [cost_rate.swept.low for cost_rate in cost_rates])
        self.high = np.maximum(self.start, [cost_rate.swept.high for cost_rate in cost_rates])
        self.quantum = [variable.quantum(scenario) for variable in self.variables]
        self._known: dict[tuple[float, ...], tuple[float, float, str]] = {}
        self.conservative = self._most_conservative_values()

    def margins(self, x: FloatArray) -> tuple[float, float]:
        """Logarithms of allowed over accepted force, and of accepted over actual false alarms.

        What hits nothing in most cases is as far over as a force without bound: no plan is to rest on that.
        """
        margin, alarm, untouched = self._margins(x)
        return (_UNBOUNDED if untouched else margin), alarm

    def _margins(self, x: FloatArray) -> tuple[float, float, str]:
        from bumpstop.collision import CollisionProblem, evaluate

        key = tuple(float(value) for value in x)
        if key not in self._known:
            scenario = self._scenario_of(zip(self.variables, key, strict=True))
            result = evaluate(scenario)
            settings = scenario.verdict
            allowed = allowed_force(CollisionProblem.from_scenario(scenario))
            # Just inside: the verdict asks the tail, which the quantile inverts to rounding.
            force = result.peak_force.quantile(1 - settings.accepted_probability * (1 - 1e-6))
            alarm = max(result.false_alarm_probability, _RAREST)
            margin = math.log(allowed / max(force, 1e-9)) if math.isfinite(force) else _UNBOUNDED
            self._known[key] = (margin, math.log(settings.max_false_alarm / alarm), result.verdict.nothing_hit)
        return self._known[key]

    def cost(self, x: FloatArray) -> float:
        """Of the changes to the values ``x`` (variables,)."""
        return float(sum(p.per_unit * abs(a - b) for p, a, b in zip(self.cost_rates, x, self.start, strict=True)))

    def design(self, x: FloatArray) -> Design:
        """The values ``x`` (variables,) with what they cost and how far they are within what is accepted."""
        values = {variable.name: float(value) for variable, value in zip(self.variables, x, strict=True)}
        return Design(values, self.cost(x), *self._margins(x))

    def rounded(self, design: Design) -> Design:
        """A design with six digits for each changed value, as a person would type it, where that is enough, too."""
        x = np.array(list(design.values.values()))
        for away in (self.start, 2 * x - self.conservative):
            # Farther from the present values, or nearer to the most conservative ones.
            short = np.array([rounded(a, 6, up=a > b) for a, b in zip(x, away, strict=True)])
            keep = np.array([bool(quantum) for quantum in self.quantum]) | (x == self.start)
            found = self.design(np.where(keep | (short < self.low) | (short > self.high), x, short))
            if found.meets:
                return found
        return design

    def needed(self, design: Design) -> Design:
        """A design without the changes that it can do without at the same cost: a search leaves traces of them."""
        for k in range(self.start.size):
            x = np.array(list(design.values.values()))
            if x[k] == self.start[k]:
                continue
            x[k] = self.start[k]
            unchanged = {i: float(x[i]) for i, quantum in enumerate(self.quantum) if quantum or x[i] == self.start[i]}
            found = self._mended(x, unchanged)
            if found is not None and found.cost <= (1 + _SAME_COST) * design.cost:
                design = found
        return design

    def told(self, design: Design) -> Design:
        """A design with the warnings beside its verdict."""
        values = zip(self.variables, design.values.values(), strict=True)
        return replace(design, warnings=warnings_of(lambda: self._scenario_of(values)))

    def _scenario_of(self, values: Iterable[tuple[Variable, float]]) -> Scenario:
        scenario = self.scenario
        for variable, value in values:
            scenario = variable.apply(scenario, value)
        return scenario

    def _conservatism(self, x: FloatArray) -> tuple[float, float]:
        """What is to be as great as can be: the lesser margin, and where that is the same the other one."""
        lesser, other = sorted(self.margins(x))
        return round(lesser / _SAME) * _SAME, other

    def _trial_values(self, k: int) -> FloatArray:
        """Values of one variable over its range, with the present one, ascending."""
        low, here, high = float(self.low[k]), float(self.start[k]), float(self.high[k])
        quantum = self.quantum[k]
        if quantum:
            steps = max(1, round((high - low) / quantum / (2 * _TRIALS)))
            values = [here + i * steps * quantum for i in range(-2 * _TRIALS, 2 * _TRIALS + 1)]
            values = [self.variables[k].quantised(self.scenario, value) for value in values]
        else:
            values = [*np.linspace(low, here, _TRIALS + 1), *np.linspace(here, high, _TRIALS + 1)]
        return np.unique([low, here, high, *(value for value in values if low < value < high)])

    def _most_conservative(self, x: FloatArray, k: int) -> float:
        """The most conservative value of one variable, the others as given.

        Often an end of the range; a threshold, though, is to be low for the force and high for false alarms.
        """
        from scipy import optimize

        def at(value: float) -> FloatArray:
            y = x.copy()
            y[k] = value
            return y

        trials = [float(trial) for trial in self._trial_values(k)]
        best = max(range(len(trials)), key=lambda i: (self._conservatism(at(trials[i])), trials[i] == x[k]))
        value = trials[best]
        if self.quantum[k] or min(self.margins(at(value))) >= 0:
            return value
        found = optimize.minimize_scalar(
            lambda v: -min(self.margins(at(float(v)))),
            bounds=(trials[max(0, best - 1)], trials[min(len(trials) - 1, best + 1)]),
            method="bounded",
        )
        return max(value, float(found.x), key=lambda v: self._conservatism(at(v)))

    def _most_conservative_values(self) -> FloatArray:
        """The most conservative of all variables, one after the other until nothing is gained."""
        conservative = self.start.copy()
        for _ in range(_ROUNDS):
            before = conservative.copy()
            for k in range(conservative.size):
                conservative[k] = self._most_conservative(conservative, k)
            if np.array_equal(conservative, before):
                break
        return conservative

    def single_change(self, k: int) -> Design | None:
        """Look at one variable on either side of its present value, and bisect to where the limits begin to be met."""

        def at(value: float) -> FloatArray:
            x = self.start.copy()
            x[k] = self.variables[k].quantised(self.scenario, value)
            return x

        def meets(value: float) -> bool:
            return min(self.margins(at(value))) >= 0

        here = float(self.start[k])
        trials = np.unique([*self._trial_values(k), self._most_conservative(self.start, k)])
        designs = []
        for side in (trials[trials <= here][::-1], trials[trials >= here]):
            first = next((i for i, value in enumerate(side) if meets(float(value))), None)
            if first is not None:
                designs.append(self.design(at(self._edge(float(side[first - 1]), float(side[first]), k, meets))))
        return min(designs, key=lambda design: design.cost, default=None)

    def _edge(self, outside: float, inside: float, k: int, meets: Callable[[float], bool]) -> float:
        """The value that meets the limits and is nearest to one that does not, between the two."""
        finest = self.quantum[k] or 1e-6 * float(self.high[k] - self.low[k])
        while abs(inside - outside) > 1.001 * finest:
            middle = self.variables[k].quantised(self.scenario, 0.5 * (outside + inside))
            if middle in (outside, inside):
                break
            if meets(middle):
                inside = middle
            else:
                outside = middle
        return inside

    def combined(self, known: list[Design]) -> Design | None:
        """The best of the plans with one variable and of those with all."""
        best = min(known, key=lambda design: design.cost, default=None)
        conservative = self.design(self.conservative)
        if conservative.meets and (best is None or conservative.cost < best.cost):
            # Gradients mislead a search that begins far from any limit, beside a cliff.
            best = self._relaxed()
        combinations = self.combinations()
        if best is None:
            # Where not even the most conservative values are enough, those of quantised keys are the only ones worth a
            # search.
            combinations = [{k: float(self.conservative[k]) for k, quantum in enumerate(self.quantum) if quantum}]
        for fixed in combinations:
            so_far = [] if best is None else [np.array(list(best.values.values()))]
            for begin in (self.conservative, self.start, *so_far):
                found = self._smooth(fixed, begin)
                if found is not None and (best is None or found.cost < best.cost):
                    best = found
        return best

    def _relaxed(self) -> Design:
        """The most conservative values, which meet the limits, each change in turn undone as far as they allow."""
        x = self.conservative.copy()
        for k, here in enumerate(self.start):

            def meets(value: float, k: int = k) -> bool:
                return min(self.margins(np.where(np.arange(x.size) == k, value, x))) >= 0

            x[k] = here if meets(here) else self._edge(float(here), float(x[k]), k, meets)
        return self.design(x)

    def combinations(self) -> list[dict[int, float]]:
        """All combinations of whole steps on the way to the most conservative values; their number is checked."""
        choices: dict[int, list[float]] = {}
        for k, quantum in enumerate(self.quantum):
            if quantum:
                steps = round(abs(self.conservative[k] - self.start[k]) / quantum)
                sign = math.copysign(quantum, self.conservative[k] - self.start[k])
                choices[k] = [
                    self.variables[k].quantised(self.scenario, self.start[k] + sign * i) for i in range(steps + 1)
                ]
        count = math.prod(len(values) for values in choices.values())
        most = _MAX_EVALUATIONS if all(self.quantum) else _MAX_SEARCHES
        if count > most:
            problem = f"{count} combinations of whole steps of {', '.join(self.variables[k].name for k in choices)}"
            raise InputError("--cost", problem, f"wanted at most {most}: a narrower range, or fewer costs")
        return [dict(zip(choices, values, strict=True)) for values in itertools.product(*choices.values())]

    def _smooth(self, fixed: Mapping[int, float], begin: FloatArray) -> Design | None:
        """Least cost over the variables that are not fixed, or None where no step of the search was feasible."""
        from scipy import optimize

        free = [k for k, quantum in enumerate(self.quantum) if not quantum]
        base = self.start.copy()
        for k, value in fixed.items():
            base[k] = value
        if not free:
            design = self.design(base)
            return design if design.meets else None
        width = (self.high - self.low)[free]

        # Changes up and down are separate unknowns of either sign's cost, so that the cost is linear.
        n = len(free)

        def place(u: FloatArray) -> FloatArray:
            x = base.copy()
            x[free] = np.clip(self.start[free] + width * (u[:n] - u[n:]), self.low[free], self.high[free])
            return x

        def margins(u: FloatArray) -> FloatArray:
            return np.array(self.margins(place(u)))

        def slopes(u: FloatArray) -> FloatArray:
            at, step = u[:n] - u[n:], 1e-4
            columns = []
            for i in range(n):
                v = u.copy()
                # Toward the inside of the range.
                sign = -1.0 if self.start[free[i]] + width[i] * (at[i] + step) > self.high[free[i]] else 1.0
                v[i] += sign * step
                columns.append((margins(v) - margins(u)) / (sign * step))
            J = np.column_stack(columns)
            return np.hstack([J, -J])

        weight = np.array([self.cost_rates[k].per_unit for k in free]) * width
        scale = float(weight.max())
        cost = np.concatenate([weight, weight]) / scale
        move = (begin[free] - self.start[free]) / width
        bounds = [(0.0, float(max(0.0, (self.high[k] - self.start[k]) / w))) for k, w in zip(free, width, strict=True)]
        bounds += [(0.0, float(max(0.0, (self.start[k] - self.low[k]) / w))) for k, w in zip(free, width, strict=True)]
        found = optimize.minimize(
            lambda u: float(cost @ u),
            np.concatenate([np.maximum(move, 0), np.maximum(-move, 0)]),
            jac=lambda u: cost,
            bounds=bounds,
            constraints={"type": "ineq", "fun": margins, "jac": slopes},
            method="SLSQP",
            options={"maxiter": 40, "ftol": 1e-7},
        )
        return self._mended(place(found.x), fixed)

    def _mended(self, x: FloatArray, fixed: Mapping[int, float]) -> Design | None:
        """The design, or where it misses a limit by a little, the nearest toward the most conservative values."""
        conservative = self.conservative.copy()
        for k, value in fixed.items():
            conservative[k] = value
        share = 0.0
        for _ in range(12):
            design = self.design(x + share * (conservative - x))
            if design.meets:
                return design
            share = max(1e-6, 4 * share)
            if share > 1:
                break
        return None
