"""The search for the highest speeds at which a force stays within a limit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray

MIN_SPEED = 1e-3  # m/s; slower arms are not looked at
CLOSE = 0.01  # between a speed that is met and one that is not
# The search ends by itself, mostly after five; late ones look at the middle too, so that none can go on for long.
_ROUNDS = 48

Tried = tuple[npt.NDArray[np.bool_], "FloatArray"]


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchRange:
    """What is known before the search; every field (N,).

    Attributes:
        first: speeds to try first [m/s].
        undetected: force that even a slow arm reaches, about [N]; zero where it is not known.
        min_speed: no speed below it is looked at [m/s].
        max_speed: no speed above it is looked at [m/s].
    """

    first: FloatArray
    undetected: FloatArray
    min_speed: FloatArray
    max_speed: FloatArray


def highest_met(
    tried: Callable[[npt.NDArray[np.int64], FloatArray], Tried], limit: float, within: SearchRange, close: float = CLOSE
) -> tuple[FloatArray, int]:
    """Highest speeds that are met (N,) [m/s], 0 where none is; and how many were tried.

    Every speed returned has been tried and is met, and one at most ``close`` higher is not, unless it is the greatest.

    Args:
        tried: of rows and their speeds [m/s], all at once: whether each is met, and its force [N].
        limit: force that is met [N].
        within: what is known before.
        close: how near to each other, as a share, a speed that is met and one that is not are in the end.
    """
    max_speed, min_speed, undetected = within.max_speed, within.min_speed, within.undetected
    # Fastest speed known to be safe and slowest known not to be [m/s], and the forces there [N].
    met, low = np.zeros_like(max_speed), np.zeros_like(max_speed)
    fails, high = np.full_like(max_speed, np.inf), np.full_like(max_speed, np.inf)

    def following(number: int) -> FloatArray:
        """Where a straight line through the logarithms reaches the limit, or steps where there is none yet."""
        # Where even what is missed passes the limit, nothing tells how far it is up: steps of 1 % would never arrive.
        least = min(2.0, (1 + CLOSE) ** (2 ** min(number, 7)))
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.log(limit / low) / np.log(high / low)
            between = met * (fails / met) ** np.clip(share, 0.1, 0.9) * (1 - 0.2 * close)
            if number > 8 and number % 3 == 2:
                between = np.sqrt(met * fails)
            between = np.where(np.isfinite(between) & (between > met), between, np.sqrt(met * fails))
            left = (limit - undetected) / (low - undetected)
            up = met * np.clip(np.where(left > 0, left**0.8, 3.0), least, 3.0)
            down = fails * np.clip(limit / np.where(np.isfinite(high), high, 4 * limit), 0.2, 0.6)
        trial = np.where(met > 0, np.where(np.isfinite(fails), between, up), np.maximum(down, min_speed))
        return np.asarray(np.minimum(trial, max_speed))

    trial, open_, evaluations = within.first, np.flatnonzero(max_speed >= min_speed), 0
    for number in range(_ROUNDS):
        if not open_.size:
            break
        v = trial[open_]
        good, force = tried(open_, v)
        evaluations += open_.size
        for speeds, forces, chosen in ((met, low, good), (fails, high, ~good)):
            rows = open_[chosen]
            speeds[rows], forces[rows] = v[chosen], np.nan_to_num(force[chosen], nan=np.inf, posinf=np.inf)
        done = (met >= max_speed * (1 - 1e-12)) | (fails <= met * (1 + close)) | (fails <= min_speed * (1 + 1e-9))
        open_ = open_[~done[open_]]
        trial = following(number)
    return met, evaluations
