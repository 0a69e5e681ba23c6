"""Random polytopes of undetected forces: Jacobian columns as arms have them, and singular ones."""

from __future__ import annotations

import numpy as np

from bumpstop.arrays import FloatArray

Cases = tuple[FloatArray, FloatArray, FloatArray]


def random_cases(rng: np.random.Generator, dof: int, count: int) -> Cases:
    """Columns (B, 3, dof), low and high (B, dof): revolute and prismatic joints, some nearly singular.

    Thresholds spread over two decades and means up to nine tenths of them. Every fourth case is squeezed in one
    direction, down to a ten-thousandth: the answer itself moves by a rounding times the condition number.
    """
    axis = rng.normal(size=(count, 3, dof))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    lever = rng.normal(size=(count, 3, dof)) * rng.uniform(0.05, 1.2, (count, 1, dof))
    columns = np.where(rng.random((count, 1, dof)) < 0.15, axis, np.cross(axis, lever, axis=1))
    squeeze = np.where(rng.random(count) < 0.25, 10 ** rng.uniform(-4, 0, count), 1.0)
    n = rng.normal(size=(count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    along = np.einsum("bk,bkj->bj", n, columns)
    columns = columns - (1 - squeeze)[:, None, None] * n[:, :, None] * along[:, None, :]
    return np.ascontiguousarray(columns), *_bands(rng, dof, count)


def singular_cases(
    rng: np.random.Generator, dof: int, count: int, rank: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Columns of rank 1 or 2, low, high, half-width (B, 3 - rank) of a thin slab, and the lost directions (B, k, 3)."""
    columns, low, high = random_cases(rng, dof, count)
    frame = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    lost = np.ascontiguousarray(frame[:, :, rank:].transpose(0, 2, 1))
    # Twice, as the first leaves a rounding of what it takes.
    for _ in range(2):
        columns = columns - np.einsum("bkj,bki,bic->bjc", lost, lost, columns)
    # So thin that what it adds to the length, of second order, is below rounding.
    walls = np.full((count, 3 - rank), 1e-9)
    return np.ascontiguousarray(columns), low, high, walls, lost


def _bands(rng: np.random.Generator, dof: int, count: int) -> tuple[FloatArray, FloatArray]:
    theta = 10 ** rng.uniform(0, 2, (count, dof))
    mean = theta * rng.uniform(-0.9, 0.9, (count, dof)) * (rng.random((count, 1)) < 0.5)
    return -theta - mean, theta - mean
