"""Which shot next: the one that is expected to narrow the peak forces of all situations most."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.measure.learning.posterior import ErrorModel

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.arrays import FloatArray
    from bumpstop.measure.learning.peak_force_ensemble import Surfaces


@dataclass(frozen=True, eq=False)
class ShotDesign:
    """Shots in the order of what they are worth.

    Attributes:
        condition: of each shot (shots,).
        spread: standard deviation of the logarithm of the peak force, root mean square over the situations, before the
            first shot and after each (shots + 1,) [1].
    """

    condition: npt.NDArray[np.int64]
    spread: FloatArray


class Belief:
    """Peak forces of the conditions as jointly normal logarithms, updated shot by shot.

    Args:
        log_force: draws of the mean logarithm (draws, conditions).
        surfaces: whose errors and scatter count.
        errors: of shots.
        weights: what the variance of each condition counts (conditions,); zero: no target.
        gauge_error: of one shot [1].
        with_own_errors: the draws have each condition's own error in them already.
    """

    def __init__(
        self,
        log_force: FloatArray,
        surfaces: Surfaces,
        errors: ErrorModel,
        weights: FloatArray,
        gauge_error: float | None = None,
        *,
        with_own_errors: bool = False,
    ) -> None:
        self.covariance = np.atleast_2d(np.cov(log_force, rowvar=False))
        if not with_own_errors:
            self.covariance = self.covariance + np.diag(errors.model**2 + surfaces.error**2)
        self.noise = surfaces.log_sd**2 + (errors.gauge if gauge_error is None else gauge_error) ** 2
        self.weights = weights / weights.sum()

    @property
    def spread(self) -> float:
        """Root mean square over the targets of the standard deviation [1]."""
        return float(np.sqrt(self.weights @ np.diag(self.covariance)))

    def gains(self) -> FloatArray:
        """By how much one shot of each condition reduces the mean variance (conditions,)."""
        total = np.diag(self.covariance) + self.noise
        return np.asarray(self.weights @ self.covariance**2 / total)

    def shoot(self, condition: int) -> None:
        """One shot of a condition has been measured."""
        column = self.covariance[:, condition].copy()
        self.covariance -= np.outer(column, column) / (column[condition] + self.noise[condition])


def greedy_design(belief: Belief, shots: int, *, repeats: int, own_speed: npt.NDArray[np.bool_]) -> ShotDesign:
    """Shots one after the other, each the best after those before it.

    Args:
        belief: before the first; it is updated.
        shots: how many.
        repeats: most shots of one condition.
        own_speed: conditions at the speed of their situation (conditions,): each of them is among the shots, as what is
            measured there decides, as long as there are enough shots.
    """
    taken = np.zeros(own_speed.size, dtype=np.int64)
    order, spread = [], [belief.spread]
    for number in range(min(shots, repeats * own_speed.size)):
        missing = own_speed & (taken == 0)
        open_ = taken < repeats
        if missing.sum() >= shots - number:
            open_ = missing
        best = int(np.argmax(np.where(open_, belief.gains(), -1.0)))
        belief.shoot(best)
        taken[best] += 1
        order.append(best)
        spread.append(belief.spread)
    return ShotDesign(np.array(order, dtype=np.int64), np.array(spread))
