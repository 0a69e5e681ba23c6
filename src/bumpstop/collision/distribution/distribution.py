"""Distributions: what is known of one random quantity of a collision."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop import _native
from bumpstop.arrays import FloatArray, as_float_array, as_number
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

# The quantiles every output gives, by the name it gives them.
QUANTILES = {"p50": 0.5, "p95": 0.95, "p99": 0.99, "p999": 0.999}

# Probability below which a tail is computed by itself.
FAR = 1e-6
# Probability below which a share of undetected collisions is rounding, not a statement.
NEGLIGIBLE = 1e-12


class Distribution(ABC):
    """A quantity that is zero or positive, in the unit its owner states.

    Some probability may lie at infinity: a collision never detected has no bound on its force.
    """

    @property
    @abstractmethod
    def mean(self) -> float:
        """Expected value; infinite where some probability lies at infinity, NaN where the quantity never exists."""

    @property
    @abstractmethod
    def sd(self) -> float:
        """Standard deviation; NaN where the mean is not finite."""

    def __repr__(self) -> str:
        """Its figures, as in JSON, in the unit its owner states."""
        figures = {"mean": self.mean, "sd": self.sd} | {name: self.quantile(p) for name, p in QUANTILES.items()}
        return f"{type(self).__name__}({', '.join(f'{name}={value:.5g}' for name, value in figures.items())})"

    @abstractmethod
    def exceedance(self, x: float) -> float:
        """P(quantity > x), of one number x."""

    @abstractmethod
    def quantile(self, p: float) -> float:
        """The smallest x with P(quantity > x) <= 1 - p, 0 < p < 1; infinite in the share at infinity."""

    def density(self, x: Sequence[float] | FloatArray) -> FloatArray:
        """Probability per unit in the bins between consecutive ``x``, shape (len(x) - 1,)."""
        edges = as_float_array(x, "x", (None,))
        tail = np.array([self.exceedance(float(edge)) for edge in edges])
        return -np.diff(tail) / np.diff(edges)

    @abstractmethod
    def scaled(self, factor: float) -> Distribution:
        """The same quantity in another unit: every value times ``factor`` > 0."""

    def to_json(self) -> dict[str, float | None]:
        """Mean, sd and the quantiles of :data:`QUANTILES`; None where a figure is not finite."""
        figures = {"mean": self.mean, "sd": self.sd} | {name: self.quantile(p) for name, p in QUANTILES.items()}
        return {name: value if math.isfinite(value) else None for name, value in figures.items()}


def as_factor(factor: float) -> float:
    """Refuse what no quantity can be multiplied with."""
    number = as_number(factor, "factor")
    if not number > 0:
        raise InputError("factor", f"{number:g} is no unit's", "wanted a number above 0")
    return number


def check_value(x: float) -> None:
    """Refuse what is not one number that a quantity may pass."""
    if math.isnan(as_number(x, "x", finite=False)):
        raise InputError("x", "is nan", "wanted a number")


def check_probability(p: float) -> None:
    """Refuse what is no probability of a quantile."""
    if not 0 < as_number(p, "p", finite=False) < 1:
        raise InputError("p", f"{p} is not a probability", "wanted 0 < p < 1")


@dataclass(frozen=True, eq=False, repr=False)
class ExactDistribution(Distribution):
    """A quantity of the integrated distribution.

    Attributes:
        law: the compiled distribution.
        name: ``"peak_force"``, ``"force_at_detection"`` or ``"detection_delay"``.
        scale: factor from its N or s to this quantity's unit.
        condition: probability of what the distribution is conditioned on.
        undetected: probability of never detecting, part of ``condition``; it counts as beyond every value.
        far_tail: the law's tail at a value in N, computed by itself; used where the tail is so small that
            interpolation would have spent its digits, and that collisions never detected do not outweigh it.
    """

    law: _native.CollisionDistribution
    name: str
    scale: float = 1.0
    condition: float = 1.0
    undetected: float = 0.0
    far_tail: Callable[[float], float] | None = None

    @cached_property
    def _moments(self) -> tuple[float, float]:
        if not self.condition > 0:
            return math.nan, math.nan
        mean, sd = self.law.moments(self.name)
        return float(mean) * self.scale, float(sd) * self.scale

    @property
    def mean(self) -> float:  # noqa: D102
        return self._moments[0]

    @property
    def sd(self) -> float:  # noqa: D102
        return self._moments[1]

    def exceedance(self, x: float) -> float:  # noqa: D102
        check_value(x)
        if not self.condition > 0:
            return math.nan
        if x < 0:
            return 1.0
        tail = self.law.tail(self.name, np.array([x / self.scale]))[0, 0]
        if tail < FAR and self.undetected < FAR and self.far_tail is not None:
            tail = self.far_tail(x / self.scale)
        return float(min(1.0, (tail + self.undetected) / self.condition))

    def quantile(self, p: float) -> float:  # noqa: D102
        check_probability(p)
        if not self.condition > 0:
            return math.nan
        return float(self.law.upper_quantile(self.name, (1 - p) * self.condition, self.undetected)) * self.scale

    def density(self, x: Sequence[float] | FloatArray) -> FloatArray:  # noqa: D102
        edges = as_float_array(x, "x", (None,))
        tail = self.law.tail(self.name, np.maximum(edges, 0.0) / self.scale)[:, 0]
        return np.asarray(-np.diff(tail) / np.diff(edges) / self.condition)

    def scaled(self, factor: float) -> ExactDistribution:  # noqa: D102
        return replace(self, scale=self.scale * as_factor(factor))


@dataclass(frozen=True, eq=False, repr=False)
class SampledDistribution(Distribution):
    """Values of independent runs.

    Attributes:
        values: (runs,), each as it enters the mean; infinite where a run has no bound.
        undetected: (runs,) runs that count as beyond every value in quantiles and exceedances; None: none do.
    """

    values: FloatArray
    undetected: npt.NDArray[np.bool_] | None = None

    @cached_property
    def _sorted(self) -> FloatArray:
        ranked = self.values if self.undetected is None else np.where(self.undetected, math.inf, self.values)
        return np.sort(ranked)

    @property
    def mean(self) -> float:  # noqa: D102
        return float(self.values.mean()) if self.values.size else math.nan

    @property
    def sd(self) -> float:  # noqa: D102
        return float(self.values.std()) if math.isfinite(self.mean) else math.nan

    def exceedance(self, x: float) -> float:  # noqa: D102
        check_value(x)
        above = self.values.size - np.searchsorted(self._sorted, x, side="right")
        return float(above / self.values.size) if self.values.size else math.nan

    def quantile(self, p: float) -> float:  # noqa: D102
        check_probability(p)
        if not self.values.size:
            return math.nan
        # The value with at most a share 1 - p above it. Rounding must not turn 0.95 x 100 into 96.
        rank = math.ceil(p * self.values.size - 1e-9) - 1
        return float(self._sorted[max(rank, 0)])

    def scaled(self, factor: float) -> SampledDistribution:  # noqa: D102
        return replace(self, values=self.values * as_factor(factor))


_BEYOND_ALL = 1e12  # no finite value of a collision is as large
_NODES = 200


def finite_mean(distribution: Distribution) -> float:
    """Mean of the values that have a bound, as of the collisions that are detected; NaN where none has.

    Of a quantity that is never negative: the integral of the probability of exceeding, less that of having no bound.
    """
    unbounded = distribution.exceedance(_BEYOND_ALL)
    if not unbounded < 1:
        return math.nan
    greatest = distribution.quantile((1 - unbounded) * (1 - 1e-9))
    node, weight = np.polynomial.legendre.leggauss(_NODES)
    tail = np.array([distribution.exceedance(0.5 * (1 + x) * greatest) for x in node]) - unbounded
    return float(0.5 * greatest * (weight @ tail) / (1 - unbounded))
