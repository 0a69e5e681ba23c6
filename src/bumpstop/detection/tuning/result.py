"""Tuned thresholds: the rate of false alarms they stand for, as values, as JSON and as text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from bumpstop.arrays import FloatArray, as_number, finite_or_none
from bumpstop.detection.durations import rates_in_words
from bumpstop.detection.thresholds import Thresholds
from bumpstop.detection.tuning.extreme_values import PeaksOverThreshold
from bumpstop.detection.tuning.run_spread import RunSpread
from bumpstop.errors import InputError
from bumpstop.model.units import one_unit
from bumpstop.terminal import table, text_of

if TYPE_CHECKING:
    from rich.console import Console

MAX_EXTRAPOLATION = 100
"""Rates below one in so many times the recorded hours are flagged as extrapolated."""
Term = Literal["fast", "speed", "acceleration"]
"""What may be tuned beside constant thresholds."""
_KEYS = {"fast": "fast_Nm", "per speed": "per_speed_Nm_s", "per acceleration": "per_acceleration_Nm_s2"}


@dataclass(frozen=True, eq=False)
class Tuning:
    """Thresholds, the rate of false alarms they stand for, and how well both are known.

    Attributes:
        shares: (dof,) constant thresholds at factor 1 [Nm or N]; infinite: that joint is not monitored.
        growth: (2, dof) what a joint's speed and acceleration add to them at factor 1 [Nm s/rad, Nm s2/rad].
        fast_shares: (dof,) thresholds of the band-pass channel at factor 1 [Nm or N]; infinite: not tuned.
        tail: of the largest residual of any joint in units of its threshold at factor 1.
        spread: of a new run's residuals against these runs'.
        target: wanted false alarms an hour.
        confidence: of the intervals.
        period_s: between rows [s].
        terms: what was tuned beside constant thresholds.
        notes: what a person should know.
        units: (dof,) of the thresholds; empty: Nm.
    """

    shares: FloatArray
    growth: FloatArray
    fast_shares: FloatArray
    tail: PeaksOverThreshold
    spread: RunSpread
    target: float
    confidence: float
    period_s: float
    terms: tuple[Term, ...] = ()
    notes: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    def __str__(self) -> str:
        return text_of(self.show)

    def show(self, console: Console, names: Sequence[str] = ()) -> None:
        """Print rate and thresholds as ``bumpstop tune`` does, with the joints' ``names`` where they are known."""
        percent = f"{100 * self.confidence:g} %"
        console.print(
            f"{self.target:.4g} false alarms an hour; {percent} interval {rates_in_words(*self.per_hour_interval())}"
        )
        more = self.columns()
        rows = []
        ends = self.thresholds_interval()
        for j, (value, below, above) in enumerate(zip(self.thresholds(), *ends, strict=True), start=1):
            cells = [f"{value:.4g}", f"{below:.4g} to {above:.4g}"] if math.isfinite(value) else ["not monitored", ""]
            cells += [f"{column[j - 1]:.4g}" if math.isfinite(value) else "" for column in more.values()]
            rows.append((" ".join((str(j), *names[j - 1 : j])), *cells))
        own = (f"{name}, {self.unit_of_term(name.removeprefix('per '))}" for name in more)
        headings = ("joint", f"threshold, {self.unit}", f"{percent} interval, {self.unit}", *own)
        console.print(table(headings, rows, left=("joint",) if names else ()))

    @property
    def unit(self) -> str:
        """Of the thresholds of all joints together."""
        return one_unit(self.units) if self.units else "Nm"

    def unit_of_term(self, term: str) -> str:
        """Of the thresholds that one of :attr:`terms` tunes."""
        if term == "fast":
            return self.unit
        power = "s2" if term == "acceleration" else "s"
        each = {"Nm": f"Nm {power}/rad", "N": f"N {power}/m"}
        return one_unit([each[unit] for unit in self.units or ("Nm",)])

    def thresholds(self, per_hour: float | None = None) -> FloatArray:
        """Constant thresholds (dof,) for a rate, default the target [Nm or N]; all keep their proportion."""
        return self.shares * self.tail.level_of(self._checked(per_hour))

    def all_thresholds(self, per_hour: float | None = None) -> Thresholds:
        """All thresholds for a rate, default the target, with what they were found at."""
        rate = self._checked(per_hour)
        factor = self.tail.level_of(rate)
        return Thresholds(
            factor * self.shares,
            speed=factor * self.growth[0],
            acceleration=factor * self.growth[1],
            fast=factor * self.fast_shares,
            period_s=float(f"{self.period_s:.12g}"),
            per_hour=rate,
        )

    def thresholds_interval(self, per_hour: float | None = None) -> tuple[FloatArray, FloatArray]:
        """Lower and upper ends (dof,) of the constant thresholds that give the rate in a new run [Nm or N]."""
        rate = self._checked(per_hour)
        level = self.tail.level_of(rate)
        low, high = self.tail.level_interval(rate, self.confidence)
        run = self.spread.half_width(self.confidence)
        below, above = math.hypot(math.log(level / low), run), math.hypot(math.log(high / level), run)
        return self.shares * level * math.exp(-below), self.shares * level * math.exp(above)

    def per_hour_interval(self, per_hour: float | None = None) -> tuple[float, float]:
        """Interval of the rate that ``thresholds(per_hour)`` have in a new run; of a single run, in more of it."""
        rate = self._checked(per_hour)
        level = self.tail.level_of(rate)
        low, high = self.tail.per_hour_interval(level, self.confidence)
        run = self.spread.half_width(self.confidence)
        if not run > 0:
            return low, high
        least, most = (self.tail.per_hour(level * math.exp(side * run)) for side in (1, -1))
        below = math.hypot(math.log(rate / low), math.log(rate / least)) if low > 0 and least > 0 else math.inf
        above = math.hypot(math.log(high / rate), math.log(most / rate))
        # More often than a cluster is long there is no alarm.
        return rate * math.exp(-below), min(rate * math.exp(above), 3600 / (self.cluster_rows * self.period_s))

    def extrapolation(self, per_hour: float | None = None) -> float:
        """Time between two alarms over time recorded: above 1 nothing like it was recorded even once."""
        return 1 / (self._checked(per_hour) * self.tail.hours)

    def columns(self, per_hour: float | None = None) -> dict[str, FloatArray]:
        """What was tuned beside constant thresholds, in words: each (dof,) [Nm or N; Nm s/rad; Nm s2/rad]."""
        law = self.all_thresholds(per_hour)
        found = {"fast": law.fast, "per speed": law.speed, "per acceleration": law.acceleration}
        return {
            name: values
            for name, values in found.items()
            if values is not None and name.removeprefix("per ") in self.terms
        }

    @property
    def cluster_rows(self) -> int:
        """Rows from one alarm to another that count as one."""
        return self.tail.cluster_rows

    def to_json(self) -> dict[str, Any]:
        """What ``bumpstop tune --json`` prints: no NaN, no infinity."""
        low, high = self.thresholds_interval()
        times = self.extrapolation()
        return {
            "thresholds_Nm": _finite(self.thresholds()),
            **{_KEYS[name]: _finite(values) for name, values in self.columns().items()},
            "thresholds_interval_Nm": [list(pair) for pair in zip(_finite(low), _finite(high), strict=True)],
            "per_hour": self.target,
            "per_hour_interval": list(self.per_hour_interval()),
            "confidence": self.confidence,
            "runs": self.spread.runs,
            "run_spread": self.spread.sd,
            "extrapolation": times,
            "extrapolated_too_far": times > MAX_EXTRAPOLATION,
            "hours": self.tail.hours,
            "peaks": int(self.tail.excess.size),
            "tail_shape": self.tail.shape,
            "notes": list(self.notes),
        }

    def _checked(self, per_hour: float | None) -> float:
        rate = self.target if per_hour is None else as_number(per_hour, "per_hour")
        if not 0 < rate < self.tail.rate:
            problem = f"{rate:g} false alarms an hour cannot be tuned for"
            raise InputError("per_hour", problem, f"wanted more than 0 and less than {self.tail.rate:.4g}")
        return rate


def _finite(values: FloatArray) -> list[float | None]:
    return [finite_or_none(value) for value in values]
