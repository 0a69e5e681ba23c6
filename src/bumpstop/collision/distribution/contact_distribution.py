"""Quantities of collisions in which something gives way."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from bumpstop import _native
from bumpstop.collision.distribution.distribution import Distribution, as_factor, check_probability, check_value


@dataclass(frozen=True, eq=False, repr=False)
class ContactDistribution(Distribution):
    """Of forces and times that bend with the place of the body: spread evenly over many small cells.

    Attributes:
        mixture: the cells, in N or s.
        scale: factor from there to this quantity's unit.
    """

    mixture: _native.CellMixture
    scale: float = 1.0

    @property
    def mean(self) -> float:  # noqa: D102
        return self.scale * self.mixture.mean if self.mixture.total > 0 else math.nan

    @property
    def sd(self) -> float:  # noqa: D102
        return self.scale * self.mixture.sd if math.isfinite(self.mean) else math.nan

    def exceedance(self, x: float) -> float:  # noqa: D102
        check_value(x)
        total = self.mixture.total
        return min(1.0, self.mixture.above(x / self.scale) / total) if total > 0 else math.nan

    def quantile(self, p: float) -> float:  # noqa: D102
        check_probability(p)
        total = self.mixture.total
        return self.scale * self.mixture.upper_quantile((1 - p) * total) if total > 0 else math.nan

    def scaled(self, factor: float) -> ContactDistribution:  # noqa: D102
        return replace(self, scale=self.scale * as_factor(factor))
