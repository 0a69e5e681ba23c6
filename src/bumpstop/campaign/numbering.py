"""Which distributions a shard computes: equal shares of the nominal cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate


@dataclass(frozen=True)
class Numbering:
    """Distributions in order, cut into shards of one nominal cost.

    Distributions are numbered setup by setup. Each has the nominal cost of its setup, and the shard that its cost
    begins in. Costs are whole numbers, so that every machine cuts alike.

    Attributes:
        motions: distributions of each setup.
        costs: nominal cost of a distribution of each setup [us].
        shard_cost: of a shard [us].
    """

    motions: int
    costs: Sequence[int]
    shard_cost: int

    @property
    def distributions(self) -> int:
        """How many there are."""
        return self.motions * len(self.costs)

    @property
    def shards(self) -> int:
        """How many there are."""
        last = self.motions * sum(self.costs) - self.costs[-1]  # where the cost of the last one begins
        return last // self.shard_cost + 1

    def slices(self, shard: int) -> list[tuple[int, range]]:
        """Setups of a shard, each with the numbers of its motions."""
        low, high = shard * self.shard_cost, (shard + 1) * self.shard_cost
        found = []
        for setup, (begin, cost) in enumerate(zip(self._begins, self.costs, strict=True)):
            if begin >= high:
                break
            first, last = (min(self.motions, max(0, -((begin - edge) // cost))) for edge in (low, high))
            if first < last:
                found.append((setup, range(first, last)))
        return found

    @property
    def _begins(self) -> list[int]:
        return list(accumulate((self.motions * cost for cost in self.costs[:-1]), initial=0))
