"""The motion that a fit saw, and how much of another motion lies outside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.terminal import in_percent

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.identification.segments.motion import UniformMotion

# Outside is what lies beyond the range by more than this share of its width, or faster by this share.
_MARGIN = 0.05
# Rows outside, as a share of all, that are worth a word.
_TOLD = 0.01


@dataclass(frozen=True, eq=False)
class SeenMotion:
    """Ranges of the joints' positions, speeds and accelerations in the rows of a fit.

    Attributes:
        low, high: (n,) positions [rad or m].
        speed: (n,) largest absolute rate [rad/s or m/s].
        acceleration: (n,) largest absolute acceleration [rad/s2 or m/s2].
    """

    low: FloatArray
    high: FloatArray
    speed: FloatArray
    acceleration: FloatArray

    @classmethod
    def of(cls, motion: UniformMotion) -> SeenMotion:
        """The ranges of a filtered motion."""
        q, qd, qdd = motion.q, np.abs(motion.qd), np.abs(motion.qdd)
        return cls(q.min(axis=0), q.max(axis=0), qd.max(axis=0), qdd.max(axis=0))

    def random(self, rows: int, seed: int = 0) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions, rates and accelerations (rows, n) spread evenly and independently over the ranges.

        Rates and accelerations reach half of the largest: joints are rarely all at their fastest at once.
        """
        rng = np.random.default_rng(seed)
        shape = (rows, self.low.size)
        q = rng.uniform(self.low, self.high, shape)
        return q, rng.uniform(-0.5, 0.5, shape) * self.speed, rng.uniform(-0.5, 0.5, shape) * self.acceleration

    def outside(self, motion: UniformMotion, names: Sequence[str]) -> list[str]:
        """What of a motion lies outside, a sentence for each joint and quantity.

        Args:
            motion: of the same joints, filtered as that of the fit.
            names: of the joints.
        """
        width = self.high - self.low
        beyond = np.maximum(motion.q - self.high, self.low - motion.q)
        faster = np.abs(motion.qd) - self.speed
        found = []
        for j, name in enumerate(names):
            for what, own, unit_share in (
                ("the positions", beyond[:, j], max(float(width[j]), 1e-2)),
                ("the speeds", faster[:, j], max(float(self.speed[j]), 1e-2)),
            ):
                rows = own > _MARGIN * unit_share
                if rows.mean() > _TOLD:
                    found.append(
                        f"{name}: {in_percent(rows.mean())} of the rows lie outside {what} of the fit, by up to "
                        f"{in_percent(own.max() / unit_share)} of their range"
                    )
        return found


def outside_fit(seen: SeenMotion | None, motion: UniformMotion, names: Sequence[str]) -> list[str]:
    """What of a motion lies outside that of a fit, or that nobody can tell: its file may be of an older version."""
    if seen is None:
        return ["the model's file does not say what motion it was fitted to: fit it again to know"]
    return seen.outside(motion, names)
