"""When a growing contact force is noticed: ticks, thresholds and noise, without a path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray

# Forces at which the hazard is known: 9 standard deviations in 64 parts.
_POINTS = 65
# A joint that far below its threshold does not alarm (5e-7 a tick).
_BELOW = 5.0
_DIRECT_TICKS = 8
_LEAST = 1e-300
_ROUNDING = 1e-9
# How often the force that reaches a threshold is put right for a torque per newton that changes on the way.
_CORRECTIONS = 6


@dataclass(frozen=True, eq=False)
class Noticing:
    """How probably a force that grows by ``per_tick`` newtons a tick is still unnoticed.

    ``S(F)`` is the probability that no tick up to the one at force F has alarmed, where the tick at F is the last of
    those at F, F - D, F - 2 D ... With ticks that fall evenly, ``P(F_detect > F)`` is the mean of S over [F - D, F],
    and ``E[F_detect] = D / 2 + integral of S``. Both are exact for ticks of that kind.

    Attributes:
        per_tick: D, (N,) [N].
        force: (N, points), ascending evenly [N].
        silence: S at those forces.
    """

    per_tick: FloatArray
    force: FloatArray
    silence: FloatArray

    @classmethod
    def of(
        cls,
        residual: Callable[[FloatArray], FloatArray],
        torque: FloatArray,
        per_tick: FloatArray,
        thresholds: FloatArray,
        sd: FloatArray,
        mean: FloatArray,
        *,
        remembers: bool,
        rarest: float,
        cautious: bool = False,
    ) -> Noticing:
        """Work out S.

        Args:
            residual: forces (N, G) [N] to noiseless residuals (N, G, joints) [Nm].
            torque: a at the start (N, joints), to know which forces matter [Nm/N].
            per_tick: D (N,) [N].
            thresholds: of the watched joints [Nm].
            sd: of their noise [Nm].
            mean: of it [Nm].
            remembers: noise is correlated from tick to tick: earlier silence then says nothing, and S is that of the
                last tick alone, which is an upper bound.
            rarest: the smallest S wanted.
            cautious: no rounding and no mean of the noise may make S smaller than it is. For :meth:`worst`; the
                residuals given are then taken for positive.
        """
        from scipy.special import ndtr, ndtri

        above = max(4.0, float(-ndtri(rarest)) + 0.5)
        low = _reaches(residual, torque, np.maximum(0.0, thresholds - np.abs(mean) - _BELOW * sd))
        high = _reaches(residual, torque, thresholds + np.abs(mean) + above * sd)
        high = np.where(np.isfinite(high), high, np.nan)
        force = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, _POINTS)
        felt = np.maximum(residual(force) - np.abs(mean), 0.0) if cautious else residual(force) + mean
        room_up, room_down = _room(thresholds - felt, thresholds, sd), _room(thresholds + felt, thresholds, sd)
        alarm = np.minimum(ndtr(-room_up) + ndtr(-room_down), 1.0)
        with np.errstate(divide="ignore"):
            hazard = -np.log1p(-alarm).sum(axis=2)
        hazard = np.minimum(hazard, 700.0)
        if cautious:
            # Where it falls with the force the least still to come counts.
            hazard = np.minimum.accumulate(hazard[:, ::-1], axis=1)[:, ::-1]
        if remembers:
            return cls(per_tick, force, np.exp(-hazard))
        total = _summed_at_least(force, hazard, per_tick) if cautious else _summed(force, hazard, per_tick)
        return cls(per_tick, force, np.exp(-total))

    @property
    def mean(self) -> FloatArray:
        """Expected force at detection (N,) [N]."""
        width = self.force[:, 1] - self.force[:, 0]
        inside = width * (self.silence.sum(axis=1) - 0.5 * (self.silence[:, 0] + self.silence[:, -1]))
        return np.asarray(self.force[:, 0] + inside + self.per_tick / 2)

    def worst(self, rare: float) -> FloatArray:
        """Force (N,) [N] that a detection passes with probability at most ``rare`` however the ticks fall.

        The first point of ``force`` from which on S is no more than ``rare``, and one tick. Infinite where even the
        largest force looked at is missed more often.
        """
        over = self.silence > rare
        count = over.shape[1]
        first = np.where(over.any(axis=1), count - over[:, ::-1].argmax(axis=1), 0)
        found = self.force[np.arange(len(first)), np.minimum(first, count - 1)]
        return np.asarray(np.where(first < count, found + self.per_tick, np.inf))


def _reaches(residual: Callable[[FloatArray], FloatArray], torque: FloatArray, level: FloatArray) -> FloatArray:
    """The least force (N,) [N] at which some joint's noiseless residual reaches its level (joints,) [Nm]."""
    with np.errstate(divide="ignore", invalid="ignore"):
        force = level / np.abs(torque)
        for _ in range(_CORRECTIONS):
            finite = np.where(np.isfinite(force), force, 0.0)
            size = np.abs(np.diagonal(residual(finite), axis1=1, axis2=2))
            force = np.where(finite > 0, level * np.where(finite > 0, finite, 1.0) / size, force)
        return np.asarray(np.nanmin(np.where(np.isnan(force), np.inf, force), axis=1))


def _room(left: FloatArray, thresholds: FloatArray, sd: FloatArray) -> FloatArray:
    """What is left to the threshold, in standard deviations; without noise all or nothing."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(sd > 0, left / sd, np.where(left > _ROUNDING * thresholds, np.inf, -np.inf))


def _summed(force: FloatArray, hazard: FloatArray, per_tick: FloatArray) -> FloatArray:
    """Sum of the hazard over the ticks at F, F - D, F - 2 D ..., for every F: (N, points).

    The last ticks one by one; those before as an integral (midpoint rule), which is good because they are many only
    where they lie close together.
    """
    width = (force[:, 1] - force[:, 0])[:, None]
    ticks = per_tick[:, None]
    logarithm = np.log(np.maximum(hazard, _LEAST))
    # Between two points the hazard is taken for an exponential, which never overstates it.
    rise = np.diff(logarithm, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.where(np.abs(rise) > 1e-6, np.diff(hazard, axis=1) / rise, hazard[:, 1:])
        shift = np.where(width > 0, ticks / width, np.inf)
    integral = np.full_like(hazard, _LEAST)
    integral[:, 1:] += np.cumsum(width * part, axis=1)
    integral = np.log(integral)
    index = np.arange(_POINTS, dtype=np.float64)[None, :]
    total = hazard.copy()
    for number in range(1, _DIRECT_TICKS):
        place = index - number * shift
        total += np.where(place >= 0, np.exp(_at(logarithm, place)), 0.0)
    place = index - (_DIRECT_TICKS - 0.5) * shift
    total += np.where(place > 0, np.exp(_at(integral, place)), 0.0) / ticks
    return np.asarray(total)


def _summed_at_least(force: FloatArray, hazard: FloatArray, per_tick: FloatArray) -> FloatArray:
    """The same (N, points) where the hazard does not fall with the force, and never more than it is.

    Every tick has the hazard of the next point below it. The ticks before those taken one by one have at least the
    integral over the ticks before each of them.
    """
    width = (force[:, 1] - force[:, 0])[:, None]
    ticks = per_tick[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = np.where(width > 0, ticks / width, np.inf)
    integral = np.zeros_like(hazard)
    integral[:, 1:] = np.cumsum(width * hazard[:, :-1], axis=1)
    index = np.arange(_POINTS, dtype=np.float64)[None, :]
    total = hazard.copy()

    def below(table: FloatArray, place: FloatArray) -> FloatArray:
        at = np.floor(np.where(place >= 0, place, 0.0)).astype(np.int64)
        return np.where(place >= 0, np.take_along_axis(table, at, 1), 0.0)

    for number in range(1, _DIRECT_TICKS):
        total += below(hazard, index - number * shift)
    return np.asarray(total + below(integral, index - _DIRECT_TICKS * shift) / ticks)


def _at(table: FloatArray, place: FloatArray) -> FloatArray:
    """Rows of a table at fractional columns (N, points), by straight lines."""
    x = np.clip(np.where(np.isfinite(place), place, 0.0), 0, table.shape[1] - 1.000001)
    low = x.astype(np.int64)
    y0, y1 = np.take_along_axis(table, low, 1), np.take_along_axis(table, low + 1, 1)
    return np.asarray(y0 + (x - low) * (y1 - y0))
