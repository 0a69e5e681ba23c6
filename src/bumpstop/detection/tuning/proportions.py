"""The proportion of thresholds: of joints, channels, and what motion adds, before their common factor is known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.detection.tuning.joint_scales import joint_scales

# Of a joint's mean residual, what its threshold is made of at rest at least: motion explains no noise away.
_FLOOR = 0.1
_MAX_FITTED = 20_000  # rows from which the growth is found
_FOLDS = 5
_MIN_SHARE = 1e-3  # of a threshold, where a joint was still in all the other rows
_MIN_RUNS = 3  # from which on a fold is made of whole runs


@dataclass(frozen=True, eq=False)
class Segment:
    """Rows without a gap, of monitored joints.

    Attributes:
        run: number of the run they are of, from 0.
        t: (n,) times [s].
        residual: (n, dof) [Nm or N].
        fast: (n, dof) of the band-pass channel; None: it is not tuned.
        speed, acceleration: (n, dof) sizes of the joints' own; None: thresholds do not grow with them.
    """

    run: int
    t: FloatArray
    residual: FloatArray
    fast: FloatArray | None = None
    speed: FloatArray | None = None
    acceleration: FloatArray | None = None

    def only(self, rows: slice | np.ndarray) -> Segment:
        """Some of its rows."""
        columns = {
            name: value[rows]
            for name in ("t", "residual", "fast", "speed", "acceleration")
            if (value := getattr(self, name)) is not None
        }
        return replace(self, **columns)


@dataclass(frozen=True, eq=False)
class Proportions:
    """Thresholds at a common factor of 1, of monitored joints.

    Attributes:
        constant: (dof,) [Nm or N].
        speed: (dof,) [Nm s/rad or N s/m]; zero where thresholds do not grow with it.
        acceleration: (dof,) [Nm s2/rad or N s2/m], likewise.
        fast: (dof,) of the band-pass channel [Nm or N]; infinite where it is not tuned.
    """

    constant: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    fast: FloatArray

    def times(self, factor: float) -> Proportions:
        """All of them times a factor."""
        return Proportions(factor * self.constant, factor * self.speed, factor * self.acceleration, factor * self.fast)

    def grown(self, segment: Segment) -> FloatArray | float:
        """(n, dof) what motion adds to both channels."""
        added: FloatArray | float = 0.0
        if segment.speed is not None:
            added = added + self.speed * segment.speed
        if segment.acceleration is not None:
            added = added + self.acceleration * segment.acceleration
        return added

    def largest(self, segment: Segment) -> FloatArray:
        """(n,) largest residual of any joint and channel in units of its threshold."""
        added = self.grown(segment)
        found: FloatArray = (np.abs(segment.residual) / (self.constant + added)).max(axis=1)
        if segment.fast is not None:
            found = np.maximum(found, (np.abs(segment.fast) / (self.fast + added)).max(axis=1))
        return found


def proportions(segments: Sequence[Segment], passed: float | None, size: int) -> Proportions:
    """Thresholds that every joint, and every channel of it, passes equally often.

    What motion adds to a joint's threshold is found first: the constant, speed and acceleration whose sum is nearest
    the size of its residual in the mean of squares, none of them negative.

    Args:
        segments: of residuals.
        passed: how often each joint shall pass its thresholds in all the rows, both channels together; None: those of
            the largest residuals.
        size: rows in a block.
    """
    residual = [np.abs(part.residual) for part in segments]
    dof = residual[0].shape[1]
    two = segments[0].fast is not None
    each = passed if passed is None else passed / (2 if two else 1)
    growth = _growth(segments)
    alone = Proportions(growth[0], growth[1], growth[2], np.full(dof, math.inf))
    in_units = [
        size_of / (alone.constant + alone.grown(part)) for size_of, part in zip(residual, segments, strict=True)
    ]
    level = joint_scales(in_units, size, each)
    found = Proportions(level * alone.constant, level * alone.speed, level * alone.acceleration, alone.fast)
    if not two:
        return found
    beyond = [np.maximum(0.0, np.abs(part.fast) - found.grown(part)) for part in segments if part.fast is not None]
    fast = joint_scales(beyond, size, each)
    return replace(found, fast=np.maximum(fast, _FLOOR * found.constant))


def largest_held_out(
    segments: Sequence[Segment], whole: Proportions, passed: float | None, size: int
) -> list[FloatArray]:
    """The largest residual of any joint, in units that the row itself had no part in.

    A joint's largest residual is smaller in units that it has set than in any others. So the proportion for every fifth
    of the rows, or for every run, is found from the others, and brought to the size of that of all rows: only what
    stands between joints is found anew, not what all have in common.

    Args:
        segments: of residuals.
        whole: proportions of all of them.
        passed: as of :func:`proportions`.
        size: likewise.

    Returns:
        (n,) of each segment.
    """
    runs = max(part.run for part in segments) + 1
    rows = sum(len(part.t) for part in segments)
    if runs >= _MIN_RUNS:
        folds = [np.full(len(part.t), part.run * min(runs, 2 * _FOLDS) // runs) for part in segments]
    else:
        begins = np.cumsum([0, *(len(part.t) for part in segments)])
        every = np.arange(rows) * _FOLDS // rows
        folds = [every[begin : begin + len(part.t)] for begin, part in zip(begins, segments, strict=False)]
    found = [np.empty(len(part.t)) for part in segments]
    for fold in range(int(max(of.max() for of in folds)) + 1):
        others = [part.only(of != fold) for part, of in zip(segments, folds, strict=True) if (of != fold).any()]
        share = sum(len(part.t) for part in others) / rows
        theirs = proportions(others, passed if passed is None else passed * share, size)
        theirs = replace(
            theirs,
            constant=np.maximum(theirs.constant, _MIN_SHARE * whole.constant),
            fast=np.maximum(theirs.fast, np.where(np.isfinite(whole.fast), _MIN_SHARE * whole.fast, 0.0)),
        )
        # Of one size with the whole, in the mean of joints and channels.
        both = [np.log(whole.constant / theirs.constant)]
        if np.isfinite(whole.fast).all():
            both.append(np.log(whole.fast / theirs.fast))
        theirs = theirs.times(math.exp(float(np.mean(both))))
        for values, part, of in zip(found, segments, folds, strict=True):
            if (of == fold).any():
                values[of == fold] = theirs.largest(part.only(of == fold))
    return found


def _growth(segments: Sequence[Segment]) -> FloatArray:
    """(3, dof) constant, per speed and per acceleration, in proportion; ones and zeros where nothing grows."""
    dof = segments[0].residual.shape[1]
    found = np.zeros((3, dof))
    found[0] = 1.0
    grown = [(1, "speed"), (2, "acceleration")]
    grown = [(k, name) for k, name in grown if getattr(segments[0], name) is not None]
    if not grown:
        return found
    from scipy.optimize import nnls

    stride = max(1, sum(len(part.t) for part in segments) // _MAX_FITTED)
    residual = np.concatenate([np.abs(part.residual) for part in segments])[::stride]
    columns = [np.concatenate([getattr(part, name) for part in segments])[::stride] for _, name in grown]
    for j in range(dof):
        fit, _ = nnls(np.stack([np.ones(len(residual)), *(column[:, j] for column in columns)], axis=1), residual[:, j])
        found[0, j] = max(fit[0], _FLOOR * float(residual[:, j].mean()))
        for (k, _), slope in zip(grown, fit[1:], strict=True):
            found[k, j] = slope
    return found
