"""Quantities of collisions in which something gives way."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

from bumpstop import _native
from bumpstop.collision.distribution.distribution import Distribution, as_factor, check_probability, check_value

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True, eq=False)
class ContactCells:
    """Small cells over which a quantity is spread evenly, in N or s, and the quantiles that were looked for in them.

    Attributes:
        make: puts the cells together. It is called once, and only where something is asked: it takes a millisecond.
    """

    make: Callable[[], _native.CellMixture]
    _quantiles: dict[float, float] = field(default_factory=dict)

    @cached_property
    def mixture(self) -> _native.CellMixture:
        """The cells."""
        return self.make()

    def upper_quantile(self, allowed: float) -> float:
        """The smallest value with no more than this probability above it."""
        if allowed not in self._quantiles:
            self._quantiles[allowed] = self.mixture.upper_quantile(allowed)
        return self._quantiles[allowed]


@dataclass(frozen=True, eq=False, repr=False)
class ContactDistribution(Distribution):
    """Of forces and times that bend with the place of the body.

    Attributes:
        cells: that it is spread over; the same for every unit of the quantity.
        scale: factor from N or s to this quantity's unit.
    """

    cells: ContactCells
    scale: float = 1.0

    @classmethod
    def of(
        cls,
        collisions: _native.CollisionDistribution,
        quantity: _native.ContactQuantity,
        never: Callable[[], float | None] = lambda: None,
        phases: _native.PhaseShares | None = None,
    ) -> ContactDistribution:
        """A quantity of integrated collisions.

        Args:
            collisions: in which something gives way.
            quantity: of them.
            never: gives its value where a collision is never detected; None: it is the one at the motion's end. It is
                called where something is asked and some are never detected: it takes a good part of a millisecond.
            phases: of the peak force, what a newton counts for in the transient phase and after it.
        """

        def make() -> _native.CellMixture:
            missed = never() if collisions.undetected > 0 else None
            return _native.contact_mixture(collisions, quantity, missed, phases)

        return cls(ContactCells(make))

    @cached_property
    def mean(self) -> float:  # noqa: D102
        mixture = self.cells.mixture
        return self.scale * mixture.mean if mixture.total > 0 else math.nan

    @cached_property
    def sd(self) -> float:  # noqa: D102
        return self.scale * self.cells.mixture.sd if math.isfinite(self.mean) else math.nan

    def exceedance(self, x: float) -> float:  # noqa: D102
        check_value(x)
        mixture = self.cells.mixture
        return min(1.0, mixture.above(x / self.scale) / mixture.total) if mixture.total > 0 else math.nan

    def quantile(self, p: float) -> float:  # noqa: D102
        check_probability(p)
        total = self.cells.mixture.total
        return self.scale * self.cells.upper_quantile((1 - p) * total) if total > 0 else math.nan

    def scaled(self, factor: float) -> ContactDistribution:  # noqa: D102
        return replace(self, scale=self.scale * as_factor(factor))
