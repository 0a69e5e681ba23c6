"""Fifths of the rows that are held out of a fit, and errors on them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bumpstop.arrays import FloatArray

Folds = Sequence[Sequence[int]]
# Held-out fifths are made of so many parts of the rows each, spread over the time: where one segment of a short
# recording is all that shows a parameter, the other four fifths would otherwise know nothing of it.
FOLDS, PARTS = 5, 20
# Parts of every fold: spread over the time, or one piece of it, which the other four may not have been near to.
SPREAD: tuple[tuple[int, ...], ...] = tuple(tuple(range(fold, PARTS, FOLDS)) for fold in range(FOLDS))
PIECES: tuple[tuple[int, ...], ...] = tuple(
    tuple(range(fold * PARTS // FOLDS, (fold + 1) * PARTS // FOLDS)) for fold in range(FOLDS)
)


def part_edges(rows: int) -> list[int]:
    """First row of each part, and the end of the last (PARTS + 1,)."""
    edges: list[int] = np.linspace(0, rows, PARTS + 1).astype(int).tolist()
    return edges


def by_fold(columns: FloatArray, values: Sequence[FloatArray], parts: Sequence[slice], folds: Folds) -> FloatArray:
    """Torque (rows, n) of columns (rows, n, parameters), each part by the values of its own fold."""
    predicted = np.empty(columns.shape[:2])
    for fold, own in zip(folds, values, strict=True):
        for k in fold:
            predicted[parts[k]] = np.einsum("tjp,jp->tj", columns[parts[k]], own)
    return predicted


def held_out_share(columns: FloatArray, wanted: FloatArray) -> float | None:
    """Share of the variance of ``wanted`` (N, n) left on fifths, each by columns (N, n, p) fitted to the other four."""
    edges = part_edges(wanted.shape[0])
    fold = np.repeat(np.arange(PARTS) % FOLDS, np.diff(edges))
    left = 0.0
    for number in range(FOLDS):
        own = fold == number
        matrix, target = columns[~own].reshape(-1, columns.shape[2]), wanted[~own].ravel()
        values = np.linalg.lstsq(matrix, target, rcond=1e-9)[0]
        left += float(((wanted[own] - columns[own] @ values) ** 2).sum())
    spread = float(((wanted - wanted.mean(axis=0)) ** 2).sum())
    return left / spread if spread > 0 else None
