"""Distributions put together from many small pieces."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.collision.distribution.distribution import Distribution, as_factor, check_probability, check_value


def moments_of(node: FloatArray, node_mass: FloatArray) -> tuple[float, float]:
    """Mean and standard deviation of values at the nodes of a quadrature (nodes,), with their probabilities (nodes,).

    NaN where there is no probability; the standard deviation is NaN where the mean is infinite, too.
    """
    counts = node_mass > 0
    if not counts.any():
        return math.nan, math.nan
    node, weight = node[counts], node_mass[counts] / node_mass.sum()
    mean = float(weight @ node)
    if not math.isfinite(mean):
        return mean, math.nan
    return mean, math.sqrt(max(0.0, float(weight @ (node - mean) ** 2)))


@dataclass(frozen=True, eq=False, repr=False)
class MixtureDistribution(Distribution):
    """Probability spread evenly over cells, and in single values; some may lie at infinity.

    Attributes:
        low, high, mass: ends of the cells and their probabilities (cells,).
        atom, atom_mass: single values and their probabilities (atoms,).
        moments: mean and standard deviation of all there is, as :func:`moments_of` tells them.
        undetected: probability of never detecting; it counts as beyond every value.
    """

    low: FloatArray
    high: FloatArray
    mass: FloatArray
    atom: FloatArray
    atom_mass: FloatArray
    moments: tuple[float, float]
    undetected: float = 0.0

    @classmethod
    def of_cells(
        cls, low: FloatArray, high: FloatArray, mass: FloatArray, node: FloatArray, node_mass: FloatArray
    ) -> MixtureDistribution:
        """Of cells alone (cells,), some so narrow that their probability is at a point; nodes of the moments."""
        point = high - low <= 1e-9 * np.maximum(1e-9, np.abs(high))
        moments = moments_of(node, node_mass)
        return cls(low[~point], high[~point], mass[~point], low[point], mass[point], moments)

    @cached_property
    def total(self) -> float:
        """Probability of all there is; what is asked of the distribution is given that."""
        return float(self.mass.sum() + self.atom_mass.sum()) + self.undetected

    @property
    def mean(self) -> float:  # noqa: D102
        return self.moments[0]

    @property
    def sd(self) -> float:  # noqa: D102
        return self.moments[1]

    @cached_property
    def _tail(self) -> tuple[FloatArray, FloatArray]:
        """P(value in a cell > x) at every end of a cell, x descending; straight between them.

        Summed from the greatest value down, so that a small tail is a sum of small terms.
        """
        slope = self.mass / np.where(self.mass > 0, self.high - self.low, 1.0)
        ends = np.concatenate([self.high, self.low])
        order = np.argsort(-ends, kind="stable")
        x = ends[order]
        density = np.maximum(np.cumsum(np.concatenate([slope, -slope])[order])[:-1], 0.0)
        return x, np.concatenate([[0.0], np.cumsum(density * -np.diff(x))]) if x.size else x

    @cached_property
    def _atoms(self) -> tuple[FloatArray, FloatArray]:
        """Single values, descending, and P(one of them >= it)."""
        order = np.argsort(-self.atom, kind="stable")
        return self.atom[order], np.cumsum(self.atom_mass[order])

    def _above(self, x: FloatArray, *, at: bool) -> FloatArray:
        """P(value > x), or P(value >= x), for x of any order (N,)."""
        ends, tail = self._tail
        result: FloatArray = np.full(x.shape, self.undetected)
        if ends.size:
            result += np.interp(-x, -ends, tail)
        atoms, reached = self._atoms
        count = np.searchsorted(-atoms, -x, side="right" if at else "left")
        result += np.concatenate([[0.0], reached])[count]
        return result

    def exceedance(self, x: float) -> float:  # noqa: D102
        check_value(x)
        if not self.total > 0:
            return math.nan
        return min(1.0, float(self._above(np.array([x]), at=False)[0]) / self.total)

    def quantile(self, p: float) -> float:  # noqa: D102
        check_probability(p)
        if not self.total > 0:
            return math.nan
        allowed = (1 - p) * self.total
        if self.undetected > allowed:
            return math.inf
        x, above, reached = self._levels
        # The last place, from above, at which no more than allowed lies beyond.
        i = int(np.searchsorted(above, allowed, side="right")) - 1
        if i < 0 or i + 1 == x.size or reached[i] > allowed:
            return float(x[max(i, 0)])
        rise = above[i + 1] - reached[i]
        share = (allowed - reached[i]) / rise if rise > 0 else 1.0
        return float(x[i] + share * (x[i + 1] - x[i]))

    @cached_property
    def _levels(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """All places where the tail bends or jumps, descending, with P(> x) and P(>= x)."""
        # Not np.unique, which imports numpy.ma, a thirtieth of the time of a command.
        x = np.sort(np.concatenate([self._tail[0], self.atom]))[::-1]
        x = x[np.append(x[1:] != x[:-1], True)]
        return x, self._above(x, at=False), self._above(x, at=True)

    def scaled(self, factor: float) -> MixtureDistribution:  # noqa: D102
        factor = as_factor(factor)
        mean, sd = self.moments
        return replace(
            self,
            low=self.low * factor,
            high=self.high * factor,
            atom=self.atom * factor,
            moments=(mean * factor, sd * factor),
        )
