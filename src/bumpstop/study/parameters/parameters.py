"""Parameters: mean and spread of the peak force against one key of a scenario after the other, and against two."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.collision.verdict.finer_steps import fails_with_finer_steps
from bumpstop.errors import InputError
from bumpstop.study.answer_warnings import FAILS_WITH_FINER_STEPS, AnswerWarnings, warnings_of
from bumpstop.study.parameters.equal_risk import RISKS, equal_risk_curves
from bumpstop.study.parameters.fits import R2_WANTED, fit_models
from bumpstop.study.range import Range
from bumpstop.study.requirement.design_guide import check_whole_steps, min_cost
from bumpstop.study.requirement.design_search import CostRate
from bumpstop.study.study import Study, check_risk
from bumpstop.study.variable import Variable, per

if TYPE_CHECKING:
    from collections.abc import Mapping

    import polars as pl

    from bumpstop.collision import CollisionResult, Scenario

# What Schroeder (2013) found: the model it fitted (table 5.3), and its derivative at its control group (table 5.4).
SOURCE: dict[str, tuple[str, float]] = {
    "contact.stiffness": ("linear", 0.0048),
    "motion.speed": ("quadratic", 0.779),
    "detector.thresholds_and_noise": ("linear", 7.3526),
    "detector.feedback_period_s": ("power", 2774.5),
    "reaction.joint_acceleration_rad_s2": ("power", -2.648),
}
# Schroeder's charts are lost; of its ranges the text keeps that of the feedback period, 1 to 16 ms.
DEFAULT_RANGES = (
    "contact.stiffness=1400:21000:15",
    "motion.speed=10:200:20",
    "detector.thresholds_and_noise=2:30:15",
    "detector.feedback_period_s=[0.001, 0.002, 0.003, 0.004, 0.005, 0.006, 0.008, 0.01, 0.012, 0.014, 0.016]",
    "reaction.joint_acceleration_rad_s2=[1, 1.5, 2, 3, 4.5, 6, 8, 10, 14, 20]",
)
# Half-width of the differences, as a share of the value. The arm stops at the end of a step, so that against its speed
# or its acceleration the force is a line with corners, some per cent apart: differences reach across a few of them.
# What is smooth on this width keeps four digits and more.
_DIFFERENCE = 0.04
# The same about 0, as a share of the range.
_OF_RANGE = 0.01
_PAIR_VALUES = 9


@dataclass(frozen=True)
class ParameterStudy(Study):
    """One integrated distribution for each value of each range, and for each pair of values of two.

    Attributes:
        ranges: one shard each.
        pairs: varied together, one shard for each value of the first.
        cost_rates: of changes, for the cheapest way to meet the limits.
    """

    name: ClassVar[str] = "parameters"
    title: ClassVar[str] = "parameters"

    ranges: tuple[Range, ...] = ()
    pairs: tuple[tuple[Range, Range], ...] = ()
    cost_rates: tuple[CostRate, ...] = ()

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        vary: list[str] | None = None,
        pairs: list[str] | None = None,
        cost_rates: list[str] | None = None,
    ) -> ParameterStudy:
        """Read ranges, pairs and costs as a person writes them.

        Args:
            scenario: the control group.
            vary: ``KEY=LOW:HIGH`` and the like, see :meth:`Range.parse`; None: Schroeder's five.
            pairs: ``KEY,KEY`` of two varied keys.
            cost_rates: ``KEY=PRICE`` of varied keys, per unit of the key.

        Raises:
            InputError: something in them cannot be used.
        """
        from bumpstop.collision import CollisionProblem

        # What is wrong without any change is no fault of a varied value.
        CollisionProblem.from_scenario(scenario)
        ranges = tuple(Range.parse(text, scenario) for text in (DEFAULT_RANGES if vary is None else vary))
        by_name: dict[str, Range] = {}
        for each in ranges:
            name = each.variable.name
            if name in by_name:
                raise InputError("--vary", f"names {name!r} twice", "name each key once")
            if not math.isfinite(each.variable.value(scenario)):
                raise InputError("--vary", f"{name!r} has no value in the scenario", "give it one with --set first")
            by_name[name] = each

        def varied(field: str, name: str) -> Range:
            if name not in by_name:
                raise InputError(field, f"{name!r} is not varied", "valid: " + ", ".join(by_name))
            return by_name[name]

        found: list[tuple[Range, Range]] = []
        for text in pairs or []:
            names = [part.strip() for part in text.split(",")]
            if len(names) != 2 or names[0] == names[1]:
                raise InputError("--pair", f"{text!r} is not KEY,KEY", "wanted two different varied keys")
            first, second = (varied("--pair", name) for name in names)
            pair = _thinned(first), _thinned(second)
            if pair in found:
                raise InputError("--pair", f"names {text!r} twice", "name each pair once")
            found.append(pair)
        rates: list[CostRate] = []
        if cost_rates:
            check_risk(scenario)
        for text in cost_rates or []:
            name, _, written = (part.strip() for part in text.partition("="))
            cost_rate = CostRate.of(varied("--cost", name), written)
            if any(cost_rate.swept is each.swept for each in rates):
                raise InputError("--cost", f"names {name!r} twice", "name each key once")
            rates.append(cost_rate)
        if found or rates:
            _check_limits(scenario)
            check_whole_steps(scenario, rates)
        return cls(scenario, ranges, tuple(found), tuple(rates))

    @property
    def shards(self) -> int:  # noqa: D102
        return len(self.ranges) + sum(len(first.values) for first, _ in self.pairs)

    def shard(self, number: int) -> pl.DataFrame:  # noqa: D102
        import polars as pl

        if number < len(self.ranges):
            rows = self._sweep(self.ranges[number])
        else:
            number -= len(self.ranges)
            pair = 0
            while number >= len(self.pairs[pair][0].values):
                number -= len(self.pairs[pair][0].values)
                pair += 1
            first, second = self.pairs[pair]
            value = first.values[number]
            scenario = first.variable.apply(self.scenario, value)
            rows = [
                _row("pair", first.variable, value, second.variable.apply(scenario, other), second.variable, other)
                for other in second.values
            ]
        return pl.DataFrame(rows, schema=_SCHEMA)

    def _sweep(self, swept: Range) -> list[dict[str, Any]]:
        variable = swept.variable
        rows = [_row("sweep", variable, value, variable.apply(self.scenario, value)) for value in swept.values]
        for value in _difference_points(self.scenario, swept):
            rows.append(_row("derivative", variable, value, variable.apply(self.scenario, value)))
        return rows

    def summary(self, rows: pl.DataFrame) -> dict[str, Any]:  # noqa: D102
        result: dict[str, Any] = {
            "study": self.name,
            "control": _figures(_evaluate(self.scenario)),
            "parameters": [self._about(swept, rows) for swept in self.ranges],
        }
        if self.pairs:
            result["equal_risk"] = [
                equal_risk_curves(self.scenario, first, second, rows) for first, second in self.pairs
            ]
        if self.cost_rates:
            result["guide"] = min_cost(self.scenario, self.cost_rates).to_json()
        return result

    def answer_warnings(self, rows: pl.DataFrame, summary: Mapping[str, Any]) -> list[AnswerWarnings]:  # noqa: D102
        guide = summary.get("guide") or {"single_change": {}, "combined": None}
        plans = {"the cheapest way to meet the limits": guide["combined"]}
        plans |= {f"{name} alone": plan for name, plan in guide["single_change"].items()}
        return [
            AnswerWarnings("the scenario as given", warnings_of(lambda: self.scenario)),
            *(AnswerWarnings(which, plan["warnings"]) for which, plan in plans.items() if plan),
        ]

    def lines(self, summary: Mapping[str, Any]) -> list[str]:  # noqa: D102
        control = summary["control"]
        lines = [f"peak force of the scenario: mean {control['mean_N']:.4g} N, sd {control['sd_N']:.3g} N"]
        for each in summary["parameters"]:
            name = each.get("better_law") or each.get("source_law")
            fit = next((fit for fit in each["fits"] if fit["name"] == name), None)
            shape = f"{name}, R2 {fit['r2']:.4f}: {fit['formula']}" if fit else "no fit"
            span = f"{each['low']:g} to {each['high']:g} {each['unit']}"
            lines.append(f"{each['key']} {span}: {each['direction']}; {shape}")
            if outside := outside_words(each):
                lines.append(f"  {outside}")
            unit = per("N", each["unit"])
            lines.append(f"  dF/dx at {each['control']:g}: {each['derivative']['mean']:.4g} {unit}")
        guide = summary.get("guide")
        if guide:
            plan = guide["combined"]
            if plan is None or not guide["single_change"]:
                lines.append(guide["reason"])
            if plan is not None and guide["single_change"]:
                values = ", ".join(f"{key} = {value:.10g}" for key, value in plan["values"].items())
                but = f", but {FAILS_WITH_FINER_STEPS}" if fails_with_finer_steps(plan["warnings"]) else ""
                lines.append(f"cheapest way to meet the limits, at a cost of {plan['cost']:.4g}: {values}{but}")
        return lines

    def _about(self, swept: Range, rows: pl.DataFrame) -> dict[str, Any]:
        variable = swept.variable
        own = rows.filter((rows["key"] == variable.name) & rows["key_2"].is_null())
        sweep = own.filter(own["kind"] == "sweep")
        x, y = sweep["value"].to_numpy(), sweep["mean_N"].to_numpy()
        bounded = np.isfinite(y)
        fits = fit_models(x[bounded], y[bounded]) if bounded.sum() >= 3 else []
        named = SOURCE.get(variable.name)
        result: dict[str, Any] = {
            "key": variable.name,
            "unit": variable.unit(self.scenario),
            "control": variable.value(self.scenario),
            "low": swept.low,
            "high": swept.high,
            "direction": _direction(y[bounded]),
            "without_mean": int((~bounded).sum()),
            "fits": [fit.to_json() for fit in fits],
            "derivative": _derivative(self.scenario, swept, own.filter(own["kind"] == "derivative")),
        }
        if fits:
            best = max(fits, key=lambda fit: fit.r2)
            wanted = next((fit for fit in fits if named and fit.name == named[0]), None)
            result["source_law"] = wanted.name if wanted else None
            result["better_law"] = best.name if wanted is None or not wanted.r2 >= R2_WANTED else None
        if named:
            result["source_derivative"] = named[1]
        return result


def outside_words(parameter: Mapping[str, Any]) -> str:
    """That the scenario's own value is none of a varied range; empty: it is. An item of ``parameters`` of a summary."""
    if parameter["low"] <= parameter["control"] <= parameter["high"]:
        return ""
    key, value = parameter["key"], f"{parameter['control']:g} {parameter['unit']}".rstrip()
    return (
        f"the scenario's own {key}, {value}, lies outside {parameter['low']:g} to {parameter['high']:g}: vary it about "
        f"its value with --vary {key}=LOW:HIGH"
    )


def _thinned(swept: Range) -> Range:
    """At most nine of the values, both ends among them: the curves between are smooth."""
    if len(swept.values) <= _PAIR_VALUES:
        return swept
    chosen = np.unique(np.linspace(0, len(swept.values) - 1, _PAIR_VALUES).round().astype(int))
    return Range(swept.variable, tuple(swept.values[i] for i in chosen))


def _check_limits(scenario: Scenario) -> None:
    from bumpstop.collision import CollisionProblem

    problem = CollisionProblem.from_scenario(scenario)
    if problem.limits is None:
        raise InputError("contact.body", "is missing", "curves of equal risk and the guide need a body with limits")
    if not problem.limits.permitted:
        raise InputError("contact.kind", problem.limits.reason, "no change of the scenario can make it acceptable")
    if scenario.verdict.clamped_limit == "two_phase":
        problem_words = "'two_phase' has two limits at once"
        raise InputError("verdict.clamped_limit", problem_words, "wanted 'quasi_static' for equal risk and the guide")


_FIGURES = ("mean_N", "sd_N", "p50_N", "p90_N", "p99_N", "p999_N", "p9999_N", "p_over_force", "p_over_pressure",
            "false_alarm", "undetected", "no_contact")  # fmt: skip
_SCHEMA: dict[str, Any] = {"kind": str, "key": str, "value": float, "key_2": str, "value_2": float} | dict.fromkeys(
    _FIGURES, float
)


def _evaluate(scenario: Scenario) -> CollisionResult:
    from bumpstop.collision import evaluate

    return evaluate(scenario)


def _figures(distribution: CollisionResult) -> dict[str, float | None]:
    force, verdict = distribution.peak_force, distribution.verdict
    quantiles = [force.quantile(p) for p in (0.5, *(1 - risk for risk in RISKS))]
    over = (verdict.p_over_force, verdict.p_over_pressure)
    others = (
        distribution.false_alarm_probability,
        distribution.undetected_probability,
        distribution.no_contact_probability,
    )
    return dict(zip(_FIGURES, (force.mean, force.sd, *quantiles, *over, *others), strict=True))


def _row(
    kind: str,
    variable: Variable,
    value: float,
    scenario: Scenario,
    second: Variable | None = None,
    value_2: float | None = None,
) -> dict[str, Any]:
    start = {"kind": kind, "key": variable.name, "value": value, "key_2": second and second.name, "value_2": value_2}
    try:
        return start | _figures(_evaluate(scenario))
    except InputError as error:
        at = f"{variable.name} = {value:g}" + ("" if second is None else f" and {second.name} = {value_2:g}")
        raise InputError(error.field, f"with {at}: {error.problem}", error.valid) from None


def _difference_points(scenario: Scenario, swept: Range) -> list[float]:
    """Values about the control point that give the derivative, ascending; those a scenario rejects are left out.

    Two distances on either side, or one quantum.
    """
    variable = swept.variable
    control, step = variable.value(scenario), variable.quantum(scenario)
    size = _DIFFERENCE * abs(control) or _OF_RANGE * (swept.high - swept.low)
    distances = [-step, 0.0, step] if step else [-size, -size / 2, 0.0, size / 2, size]
    points = []
    for distance in distances:
        value = variable.quantised(scenario, control + distance)
        try:
            variable.apply(scenario, value)
        except InputError:
            continue
        points.append(value)
    return points


def _derivative(scenario: Scenario, swept: Range, points: pl.DataFrame) -> dict[str, Any]:
    """dF/dx of mean and sd at the control point, by differences of integrated distributions.

    Over two distances the rest of the curvature is taken out (Richardson); then ``error`` is how much that changed, and
    what corners may do to it. At the end of what the scenario takes the points of one side do the same. Across one
    quantum on either side where the key is quantised.
    """
    variable = swept.variable
    control, quantum = variable.value(scenario), variable.quantum(scenario)
    x, mean, sd = (points[name].to_numpy() for name in ("value", "mean_N", "sd_N"))
    h = x - control
    size = float(np.abs(h).max()) if h.size else 0.0
    result: dict[str, Any] = {"step": size, "quantised": quantum is not None}
    for name, y in (("mean", mean), ("sd", sd)):
        result[name], error = _difference(h, y)
        if name == "mean":
            result["error"] = error
            here = float(y[np.argmin(np.abs(h))]) if h.size else math.nan
            result["elasticity"] = result[name] * control / here if here else math.nan
    return result


def _difference(h: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Slope at h = 0 and how far it is trusted, from points at both or one side."""
    if h.size < 2 or not np.isfinite(y).all():
        return math.nan, math.nan
    if h.size == 5:
        wide, narrow = (y[4] - y[0]) / (h[4] - h[0]), (y[3] - y[1]) / (h[3] - h[1])
        # Of a smooth line next to nothing; a corner anywhere between the points is seen here.
        corners = (y[0] - 4 * y[1] + 6 * y[2] - 4 * y[3] + y[4]) / h[4]
        return float((4 * narrow - wide) / 3), float(abs(narrow - wide) + abs(corners))
    slope = _polynomial_slope(h, y)
    if h.size == 2 or (h.size == 3 and h[0] < 0 < h[-1]):
        return slope, math.nan
    # Without the point that is farthest away.
    nearer = np.sort(np.argsort(np.abs(h), kind="stable")[:-1])
    return slope, abs(slope - _polynomial_slope(h[nearer], y[nearer]))


def _polynomial_slope(h: FloatArray, y: FloatArray) -> float:
    """Slope at 0 of the polynomial through all points."""
    size = np.abs(h).max()
    return float(np.linalg.solve(np.vander(h / size, increasing=True), y)[1] / size)


def _direction(y: FloatArray) -> str:
    steps = np.diff(y)
    if steps.size and (steps > 0).all():
        return "up"
    return "down" if steps.size and (steps < 0).all() else "neither"
