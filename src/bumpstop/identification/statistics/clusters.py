"""Covariance of least squares whose residuals are correlated in time and between joints, by blocks of rows."""

from __future__ import annotations

import math

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.signal import correlation_time

_MEMORIES = 5  # correlation times of the residuals in a block that counts as independent
# Above this share of its length left beside the others before it, every column can be told apart by Cholesky's method.
_FIRM = 1e-5


def clustered_covariance(matrix: FloatArray, residual: FloatArray, joints: int) -> FloatArray:
    """Covariance of the solution that holds where residuals are correlated in time and between joints.

    Blocks of consecutive rows, long against the residuals' memory, count as independent. Each is left out in turn, and
    the spread of the solutions is the covariance (the jackknife of clusters, CR3 of A. C. Cameron and D. L. Miller, "A
    practitioner's guide to cluster-robust inference", 2015). A sandwich of the blocks' scores would be too narrow: with
    some sixty parameters and as many blocks, residuals are visibly smaller than errors.

    The jackknife errs to the wide side by about as much as few blocks would ask for by Student's quantile: 1.96
    standard errors either way make a 95 % interval as they are.

    Args:
        matrix: columns (N joints, p), joints side by side.
        residual: (N joints,) that least squares left.
        joints: number of them.
    """
    length = np.linalg.norm(matrix, axis=0)
    length[length == 0] = 1.0
    blocks = blocks_of(residual, joints)
    whole = matrix.T @ matrix / np.outer(length, length)
    moved = np.empty((len(blocks), length.size))
    for place, block in enumerate(blocks):
        own = matrix[block] / length
        moved[place] = _solution(whole - own.T @ own, own.T @ residual[block])
    # Blocks of so many memories of an exponential correlation lose half of one at their seams.
    lost = 1 - 0.5 / _MEMORIES
    covariance: FloatArray = moved.T @ moved * (1 - 1 / len(blocks)) / np.outer(length, length) / lost
    return covariance


def _solution(square: FloatArray, moment: FloatArray) -> FloatArray:
    """Of a symmetric system (p, p) of columns of length one; the shortest where columns can hardly be told apart."""
    from scipy.linalg import LinAlgError, cho_factor, cho_solve

    try:
        factor = cho_factor(square)
    except LinAlgError:
        factor = None
    if factor is not None and np.diag(factor[0]).min() > _FIRM:
        solution: FloatArray = cho_solve(factor, moment)
        return solution
    return np.asarray(np.linalg.lstsq(square, moment, rcond=1e-13)[0])


def blocks_of(residual: FloatArray, joints: int) -> list[slice]:
    """Runs of rows that are long against the memory of residuals (N * joints,), joints side by side."""
    rows = residual.size // joints
    memory = max(correlation_time(residual.reshape(rows, joints)[:, j]) for j in range(joints))
    number = max(8, min(rows // max(1, math.ceil(_MEMORIES * memory)), 400))
    return [slice(part[0] * joints, (part[-1] + 1) * joints) for part in np.array_split(np.arange(rows), number)]
