"""Essential parameters: those that a recording tells from zero. What it does not, predicts better left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray

# Standard errors from zero below which a parameter is left out of predictions.
TELLING = 2.0
_MENDINGS = 4  # of the values by what they leave
_UNOBSERVABLE = 1e-9  # length of a column, of the longest one's, up to which it counts as zero
_DEPENDENT = 1e-12  # share of a column's square that others leave, up to which they make it up


def essential_values(
    matrix: FloatArray, target: FloatArray, blocks: Sequence[slice], telling: float = TELLING
) -> FloatArray:
    """Least squares without the parameters that cannot be told from zero, which get 0.

    The parameter that is fewest standard errors from zero leaves, the others are fitted anew, until all that are left
    are ``telling`` or more from zero. Standard errors are cluster-robust. (After the essential parameters of C. M. Pham
    and M. Gautier, "Essential parameters of robots", 1991.)

    A fold of the rows can lack what shows a parameter: columns that are zero in it, or that it cannot tell from others,
    get 0 too.

    Args:
        matrix: columns (N, p).
        target: what they should add up to (N,).
        blocks: two or more runs of rows that count as independent, all rows together.
        telling: standard errors from zero that a parameter needs.

    Returns:
        values (p,).
    """
    # Products of the blocks are all that a fit and its errors need: the rows are gone through once.
    products = np.stack([matrix[block].T @ matrix[block] for block in blocks])
    length = np.sqrt(np.diagonal(products, axis1=1, axis2=2).sum(axis=0))
    seen = length > _UNOBSERVABLE * length.max(initial=0.0)
    length[~seen] = np.inf
    products /= np.outer(length, length)
    moments = np.stack([matrix[block].T @ target[block] for block in blocks]) / length
    whole, wanted = products.sum(axis=0), moments.sum(axis=0)
    kept = _told_apart(whole, np.flatnonzero(seen))
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


def _told_apart(whole: FloatArray, seen: npt.NDArray[np.intp]) -> list[int]:
    """Numbers of the columns, of those seen, that the rows tell apart, by products (p, p) of columns of length one."""
    from scipy.linalg.lapack import dpstrf

    if seen.size == 0:
        return []
    _, pivots, rank, _ = dpstrf(whole[np.ix_(seen, seen)], tol=_DEPENDENT)
    return sorted(seen[pivots[:rank] - 1].tolist())
