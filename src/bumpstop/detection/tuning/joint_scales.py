"""What each joint's residual is worth beside another's: levels that all joints pass as often."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.signal import correlation_time

# Blocks are as long as the slowest residual's memory, and shorter where that would leave fewer than these.
_MIN_BLOCKS, _MAX_BLOCKS = 20, 4000
# Of the blocks, those whose largest residuals are a joint's tail, and how many of them there are.
_TAIL, _MIN_ROWS, _MAX_ROWS = 0.2, 5, 50
# With fewer blocks no tail can be told, and in less time [s] an arm makes too few motions.
_FEW_BLOCKS, _SHORT_S = 40, 60.0
# A level is not sought farther beyond a joint's own tail: the scale of a few peaks is known too badly.
_REACH = 20.0


def block_rows(segments: Sequence[FloatArray]) -> int:
    """Rows in a block: the longest correlation time of any joint, in the longest segment.

    Args:
        segments: parts without gaps, each (n, dof), zero or more.
    """
    longest = max(segments, key=len)
    rows = sum(len(part) for part in segments)
    memory = max(correlation_time(longest[:, j]) for j in range(longest.shape[1]))
    return max(1, rows // _MAX_BLOCKS, min(math.ceil(memory), rows // _MIN_BLOCKS))


def too_few(segments: Sequence[FloatArray], size: int, period: float) -> bool:
    """Whether no tails can be told: fewer than 40 blocks of ``size`` rows, or less than a minute.

    Args:
        segments: as of :func:`block_rows`.
        size: rows in a block.
        period: between rows [s].
    """
    blocks = sum(len(_edges(part, size)) for part in segments)
    return blocks < _FEW_BLOCKS or sum(len(part) for part in segments) * period < _SHORT_S


def joint_scales(segments: Sequence[FloatArray], size: int, passed: float | None) -> FloatArray:
    """(dof,) levels that the residuals of every joint pass equally often.

    The rows are cut into blocks, the same for all joints: joints whose errors change slowly have fewer clusters than
    others, but as many blocks, so that their tails can be compared. The squares of a joint's largest blocks are taken
    as an exponential tail over a level that as many blocks of every joint pass: that of Gaussian noise. All joints are
    asked for the same quantile of it.

    Args:
        segments: as of :func:`block_rows`.
        size: rows in a block.
        passed: how often in all the rows a level shall be passed; no less than once, or than a twentieth of the tail,
            is asked for. None: the largest residual.
    """
    maxima = np.concatenate([np.maximum.reduceat(part, _edges(part, size), axis=0) for part in segments])
    count = len(maxima)
    if passed is None:
        largest: FloatArray = maxima.max(axis=0)
        return largest
    squares = np.sort(maxima**2, axis=0)[::-1]
    tail = min(count - 1, max(_MIN_ROWS, min(_MAX_ROWS, int(_TAIL * count))))
    level = squares[tail]
    scale = (squares[:tail] - level).mean(axis=0)
    quantile = min(max(passed, 1.0, tail / _REACH), 0.9 * tail)
    found: FloatArray = np.sqrt(level + scale * math.log(tail / quantile))
    return found


def _edges(part: FloatArray, size: int) -> np.ndarray:
    return np.arange(0, max(1, len(part) - size // 2), size)
