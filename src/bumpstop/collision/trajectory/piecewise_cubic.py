"""Cubics through the rows of a trajectory.

They are the cubic splines of scipy.interpolate, whose import alone takes a quarter of the time of a short command.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bumpstop.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class PiecewiseCubic:
    """One cubic between every two rows.

    Attributes:
        x: of the rows (rows,), ascending.
        c: coefficients (4, rows - 1, columns), highest power of the distance from the row first.
    """

    x: FloatArray
    c: FloatArray

    @classmethod
    def hermite(cls, x: FloatArray, y: FloatArray, slope: FloatArray) -> PiecewiseCubic:
        """Values and slopes of every row are met.

        Args:
            x: (rows,), at least 2, ascending.
            y: (rows, columns).
            slope: dy/dx (rows, columns).
        """
        dx = np.diff(x)[:, None]
        chord = np.diff(y, axis=0) / dx
        bend = (slope[:-1] + slope[1:] - 2 * chord) / dx
        return cls(x, np.stack([bend / dx, (chord - slope[:-1]) / dx - bend, slope[:-1], y[:-1]]))

    @classmethod
    def spline(cls, x: FloatArray, y: FloatArray) -> PiecewiseCubic:
        """Values are met, and first and second derivatives are continuous; the ends are not-a-knot.

        Two rows are joined by a straight line, three by a parabola.

        Args:
            x: (rows,), at least 2, ascending.
            y: (rows, columns).
        """
        return cls.hermite(x, y, _smooth_slopes(np.diff(x), np.diff(y, axis=0) / np.diff(x)[:, None]))

    def __call__(self, x: float | FloatArray, derivative: int = 0) -> FloatArray:
        """Values (..., columns), or derivatives; beyond the ends the outermost cubics go on."""
        at = np.asarray(x, dtype=np.float64)
        i = np.clip(np.searchsorted(self.x, at, side="right") - 1, 0, len(self.x) - 2)
        left = (at - self.x[i])[..., None]
        value = np.zeros((*at.shape, self.c.shape[2]))
        for power in range(3, derivative - 1, -1):
            factor = np.prod(np.arange(power - derivative + 1, power + 1, dtype=np.float64))
            value = value * left + factor * self.c[3 - power][i]
        return value


def _smooth_slopes(dx: FloatArray, chord: FloatArray) -> FloatArray:
    """Slopes (rows, columns) with which the second derivative is continuous; not-a-knot ends.

    A cubic that goes on unchanged beyond the second row binds the first two slopes; that equation and its like at the
    other end close the tridiagonal system of the rows between.
    """
    rows = len(dx) + 1
    if rows == 2:
        return np.repeat(chord, 2, axis=0)
    if rows == 3:
        middle = (dx[1] * chord[0] + dx[0] * chord[1]) / (dx[0] + dx[1])
        return np.stack([2 * chord[0] - middle, middle, 2 * chord[1] - middle])
    first, last = dx[0] + dx[1], dx[-2] + dx[-1]
    lower = [*dx[1:].tolist(), float(last)]
    diagonal = [float(dx[1]), *(2 * (dx[:-1] + dx[1:])).tolist(), float(dx[-2])]
    upper = [float(first), *dx[:-1].tolist()]
    right = np.empty((rows, chord.shape[1]))
    right[0] = ((dx[0] + 2 * first) * dx[1] * chord[0] + dx[0] ** 2 * chord[1]) / first
    right[1:-1] = 3 * (dx[1:, None] * chord[:-1] + dx[:-1, None] * chord[1:])
    right[-1] = (dx[-1] ** 2 * chord[-2] + (2 * last + dx[-1]) * dx[-2] * chord[-1]) / last
    return _solved(lower, diagonal, upper, right)


def resting_slopes(x: FloatArray, y: FloatArray) -> FloatArray:
    """Slopes (rows, columns) of the cubic spline whose second derivative is continuous and whose ends have slope zero.

    Args:
        x: (rows,), at least 2, ascending.
        y: (rows, columns).
    """
    dx = np.diff(x)
    chord = np.diff(y, axis=0) / dx[:, None]
    right = np.zeros(y.shape)
    right[1:-1] = 3 * (dx[1:, None] * chord[:-1] + dx[:-1, None] * chord[1:])
    diagonal = [1.0, *(2 * (dx[:-1] + dx[1:])).tolist(), 1.0]
    return _solved([*dx[1:].tolist(), 0.0], diagonal, [0.0, *dx[:-1].tolist()], right)


def _solved(lower: list[float], diagonal: list[float], upper: list[float], right: FloatArray) -> FloatArray:
    """Of a tridiagonal system of equations, by elimination without exchange of rows: every pivot is positive."""
    rows = len(diagonal)
    for i in range(1, rows):
        share = lower[i - 1] / diagonal[i - 1]
        diagonal[i] -= share * upper[i - 1]
        right[i] -= share * right[i - 1]
    right[-1] /= diagonal[-1]
    for i in range(rows - 2, -1, -1):
        right[i] = (right[i] - upper[i] * right[i + 1]) / diagonal[i]
    return right
