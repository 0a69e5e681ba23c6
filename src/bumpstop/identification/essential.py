"""Essential parameters: those that a recording tells from zero. What it does not, predicts better left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bumpstop.arrays import FloatArray

# Standard errors from zero below which a parameter is left out of predictions.
TELLING = 2.0
_MENDINGS = 4  # of the values by what they leave


def essential_values(
    matrix: FloatArray, target: FloatArray, blocks: Sequence[slice], telling: float = TELLING
) -> FloatArray:
    """Least squares without the parameters that cannot be told from zero, which get 0.

    The parameter that is fewest standard errors from zero leaves, the others are fitted anew, until all that are left
    are ``telling`` or more from zero. Standard errors are cluster-robust. (After the essential parameters of C. M. Pham
    and M. Gautier, "Essential parameters of robots", 1991.)

    Args:
        matrix: columns (N, p), independent.
        target: what they should add up to (N,).
        blocks: two or more runs of rows that count as independent, all rows together.
        telling: standard errors from zero that a parameter needs.

    Returns:
        values (p,).
    """
    # Products of the blocks are all that a fit and its errors need: the rows are gone through once.
    products = np.stack([matrix[block].T @ matrix[block] for block in blocks])
    length = np.sqrt(np.diagonal(products, axis1=1, axis2=2).sum(axis=0))
    products /= np.outer(length, length)
    moments = np.stack([matrix[block].T @ target[block] for block in blocks]) / length
    whole, wanted = products.sum(axis=0), moments.sum(axis=0)
    kept = list(range(length.size))
    while kept:
        inverse = np.linalg.inv(whole[np.ix_(kept, kept)])
        values = np.zeros(length.size)
        values[kept] = inverse @ wanted[kept]
        scores = (moments - products @ values)[:, kept]
        spread = inverse @ (scores.T @ scores) @ inverse * len(blocks) / (len(blocks) - 1)
        far = np.abs(values[kept]) / np.sqrt(np.maximum(np.diag(spread), 1e-300))
        weakest = int(np.argmin(far))
        if far[weakest] >= telling:
            break
        del kept[weakest]
    found = np.zeros(length.size)
    if kept:
        # Products square the condition of the columns. What is left at the rows mends that, every time by as much.
        inverse = np.linalg.inv(whole[np.ix_(kept, kept)])
        left = target
        for _ in range(_MENDINGS):
            found[kept] += inverse @ ((left @ matrix) / length)[kept] / length[kept]
            left = target - matrix @ found
    return found
