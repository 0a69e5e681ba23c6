"""Monte Carlo of many runs in bounded memory: blocks of runs one after the other, of which counts are kept."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.collision.distribution.distribution import (
    Distribution,
    SampledDistribution,
    check_probability,
    check_value,
)

if TYPE_CHECKING:
    from bumpstop.collision.outcome import CollisionOutcome

# Runs that are held one by one: all of a smaller sample, of a larger one the first.
BLOCK = 1_000_000
# Bits of a double that a count does without. 14 of its mantissa are left: a bin is at most 6e-5 of its value wide.
_DROPPED = np.uint64(38)

Outcome = TypeVar("Outcome", bound="CollisionOutcome")
Progress = Callable[[float], None]
"""Told the share that is done, 0 to 1."""


@dataclass(frozen=True, eq=False, repr=False)
class CountedDistribution(Distribution):
    """Values of independent runs, counted in bins that are at most 6e-5 of themselves wide.

    A run counts as the upper end of its bin. Mean and standard deviation are those of the values themselves.

    Attributes:
        upper: upper ends of the bins that hold runs (bins,), ascending; infinite where runs have no bound, or count as
            beyond every value.
        count: runs in each (bins,).
        mean, sd: of the values as they enter the mean.
    """

    upper: FloatArray
    count: npt.NDArray[np.int64]
    mean: float = math.nan
    sd: float = math.nan

    @property
    def _runs(self) -> int:
        return int(self.count.sum())

    def exceedance(self, x: float) -> float:  # noqa: D102
        check_value(x)
        if not self.count.size:
            return math.nan
        return float(self.count[np.searchsorted(self.upper, x, side="right") :].sum() / self._runs)

    def quantile(self, p: float) -> float:  # noqa: D102
        check_probability(p)
        if not self.count.size:
            return math.nan
        rank = max(math.ceil(p * self._runs - 1e-9), 1)
        return float(self.upper[np.searchsorted(np.cumsum(self.count), rank)])

    def scaled(self, factor: float) -> CountedDistribution:  # noqa: D102
        return replace(self, upper=self.upper * factor, mean=self.mean * factor, sd=self.sd * factor)


class Counter:
    """Counts values block by block."""

    def __init__(self) -> None:
        self._key = np.zeros(0, dtype=np.uint64)
        self._count = np.zeros(0, dtype=np.int64)
        self._runs, self._sum, self._squares = 0, 0.0, 0.0

    def add(self, block: SampledDistribution) -> None:
        """Count the values of a block; what they enter the mean with, and as what they count."""
        values = np.asarray(block.values, dtype=np.float64)
        if not values.size:
            return
        # Sums of squares about the mean so far, added as two samples are.
        mean, size = float(values.mean()), values.size
        with np.errstate(invalid="ignore"):
            squares = float(((values - mean) ** 2).sum())
            shift = mean - self._sum / self._runs if self._runs else 0.0
            self._squares += squares + shift**2 * self._runs * size / (self._runs + size)
            self._sum += float(values.sum())
        self._runs += size
        ranked = values if block.undetected is None else np.where(block.undetected, math.inf, values)
        # Doubles that are not negative ascend as their bits do. Adding 0 turns -0 into 0.
        key, count = np.unique((ranked + 0.0).view(np.uint64) >> _DROPPED, return_counts=True)
        self._key, place = np.unique(np.concatenate([self._key, key]), return_inverse=True)
        self._count = np.bincount(place, np.concatenate([self._count, count])).astype(np.int64)

    def distribution(self) -> CountedDistribution:
        """Of all blocks."""
        upper = ((self._key + np.uint64(1)) << _DROPPED).view(np.float64).copy()
        upper[self._key == 0] = 0.0
        upper[~np.isfinite((self._key << _DROPPED).view(np.float64))] = math.inf
        mean = self._sum / self._runs if self._runs else math.nan
        sd = math.sqrt(self._squares / self._runs) if self._runs and math.isfinite(mean) else math.nan
        return CountedDistribution(upper, self._count, mean, sd)


_COUNTED = ("peak_force", "force_at_detection", "detection_delay", "transient_contact_duration", "contact_durations")
_SHARES = ("false_alarm_probability", "undetected_probability", "no_contact_probability")
_GIVEN_DETECTION = ("trigger_joint_probability", "multi_joint_probability")


def block_seed(seed: int, first: int) -> int:
    """A seed of a block's own, for samplers that count runs from 0: the seed itself of the first one."""
    if first == 0:
        return seed
    return int.from_bytes(hashlib.sha256(f"{seed} {first}".encode()).digest()[:8], "little")


def in_blocks(sample: Callable[[int, int], Outcome], samples: int, progress: Progress | None = None) -> Outcome:
    """The law of many runs, in the memory of some.

    Blocks are always the same runs in the same order, so that nothing depends on threads. ``runs``, and what is worked
    out of them, are those of the first block.

    Args:
        sample: the law of a block: number of its first run, and how many it has.
        samples: of all blocks.
        progress: told how far it is.
    """
    counters: dict[str, Counter] = {}
    shares: dict[str, Any] = dict.fromkeys((*_SHARES, *_GIVEN_DETECTION), 0.0)
    first: Outcome | None = None
    done, detected = 0, 0
    more: dict[str, Any] = {}
    while done < samples:
        size = min(BLOCK, samples - done)
        law = sample(done, size)
        found = 0 if law.runs is None else int((law.runs["tick"] >= 0).sum())
        for name in _COUNTED:
            block = getattr(law, name, None)
            if isinstance(block, SampledDistribution):
                counters.setdefault(name, Counter()).add(block)
        for name in _SHARES:
            shares[name] += getattr(law, name) * size
        for name in _GIVEN_DETECTION if found else ():
            shares[name] = shares[name] + getattr(law, name) * found
        if hasattr(law, "max_undetected_force"):
            more["max_undetected_force"] = max(more.get("max_undetected_force", 0.0), law.max_undetected_force)
        first = first or law
        done, detected = done + size, detected + found
        if progress is not None:
            progress(done / samples)
    assert first is not None
    if samples <= BLOCK:
        return first
    means: dict[str, Any] = {name: shares[name] / samples for name in _SHARES}
    means |= {name: shares[name] / detected if detected else getattr(first, name) for name in _GIVEN_DETECTION}
    counted: dict[str, Any] = {name: counter.distribution() for name, counter in counters.items()}
    return replace(first, samples=samples, **counted, **means, **more)
