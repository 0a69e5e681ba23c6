"""Which columns of a least-squares problem the rows tell apart, and how well."""

from __future__ import annotations

import math

import numpy as np

from bumpstop.arrays import FloatArray

# Columns that the others make up to this share of their length say nothing of their own.
DEPENDENT = 1e-4
_RATHER_FIRST = 1e-8  # share of its length that a column counts less than the one before it


def condition_of(matrix: FloatArray) -> float:
    """Condition number of columns (N, p), each brought to length one; infinite where one is zero."""
    triangle = np.linalg.qr(matrix, mode="r")
    length = np.linalg.norm(triangle, axis=0)
    return float(np.linalg.cond(triangle / length)) if length.size and length.min() > 0 else math.inf


def independent(matrix: FloatArray) -> tuple[np.ndarray, list[list[tuple[int, float]]]]:
    """Columns that the motion tells apart, and for each the others that move with it and by how much."""
    from scipy.linalg import qr, solve_triangular

    # Of columns that are as good as one another the first is taken, whatever the rounding of their rows.
    scale = np.linalg.norm(matrix, axis=0) * (1 + _RATHER_FIRST * np.arange(matrix.shape[1]))
    triangle, order = qr(matrix / scale, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    rank = int((diagonal > DEPENDENT * diagonal[0]).sum())
    chosen, rest = order[:rank], order[rank:]
    groups: list[list[tuple[int, float]]] = [[] for _ in range(rank)]
    if rest.size:
        mixed = solve_triangular(triangle[:rank, :rank], triangle[:rank, rank:])
        mixed = mixed * scale[rest][None, :] / scale[chosen][:, None]
        for i in range(rank):
            # By their numbers: which of two alike is pivoted first is a matter of rounding.
            groups[i] = sorted((int(c), float(k)) for c, k in zip(rest, mixed[i], strict=True) if abs(k) > 1e-3)
    return chosen, groups


def label_of(names: list[str], seen: np.ndarray, column: int, group: list[tuple[int, float]]) -> str:
    """Name of a base parameter: the column's own, with the others that move with it."""
    return names[int(seen[column])] + "".join(
        f" {'+' if k > 0 else '-'} {abs(k):.4g} {names[int(seen[c])]}" for c, k in group
    )


def triangle_of(rows: FloatArray) -> FloatArray:
    """Upper triangles (n, up to p, p) with the squares of rows (n, N, p)."""
    return np.asarray(np.linalg.qr(rows, mode="r"))
