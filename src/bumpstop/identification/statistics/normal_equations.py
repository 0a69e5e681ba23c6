"""Least squares by sums of products: of all rows, or without some parts of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.identification.statistics.independent_columns import DEPENDENT

_ROUNDS = 4  # of the joints' weights


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Sums of products of columns, and of what they should add up to, part of the rows by part and joint by joint.

    All weights and fifths share them. Of columns that the motion cannot tell apart the shortest values are taken, which
    predict the same.

    Attributes:
        products: (parts, n, p + 1, p + 1), the wanted sum last.
        counts: (n,) rows that each joint is fitted to.
        apart: every joint has parameters of its own; else all have the same.
    """

    products: FloatArray
    counts: FloatArray
    apart: bool

    @classmethod
    def of(
        cls,
        columns: FloatArray,
        wanted: FloatArray,
        parts: Sequence[slice],
        counts: FloatArray,
        *,
        apart: bool,
        known: FloatArray | None = None,
    ) -> NormalEquations:
        """The sums of all products.

        Args:
            columns: (N, n, p), zero at rows that a joint is not fitted to.
            wanted: (N, n) what they should add up to, zero there, too.
            parts: of the rows.
            counts: (n,) rows that each joint is fitted to.
            apart: every joint has parameters of its own.
            known: products (parts, n, k, k) of the first k columns, where others have found them.
        """
        first = 0 if known is None else known.shape[-1]
        products = np.empty((len(parts), columns.shape[1], columns.shape[2] + 1, columns.shape[2] + 1))
        for number, part in enumerate(parts):
            # Side by side in memory: products of strided columns take ten times as long.
            both = np.concatenate([columns[part], wanted[part][:, :, None]], axis=2)
            rows = np.ascontiguousarray(both.transpose(1, 0, 2))
            own = products[number]
            np.matmul(rows[:, :, first:].transpose(0, 2, 1), rows, out=own[:, first:])
            own[:, :first, first:] = own[:, first:, :first].transpose(0, 2, 1)
            if known is not None:
                own[:, :first, :first] = known[number]
        return cls(products, counts, apart)

    def values(self, left_out: Sequence[int] = ()) -> FloatArray:
        """Parameters (n, p) by weighted least squares, of all parts of the rows but those that are left out."""
        return self._solution(self._whole - self.products[list(left_out)].sum(axis=0), self._spread) / self._length

    def _solution(self, products: FloatArray, spread: FloatArray) -> FloatArray:
        """Values (n, p) of columns of length one, of joints that weigh by one over their spread (n,)."""
        square, moment = self._scaled(products)
        if self.apart:
            return np.array([_shortest(own, sums) for own, sums in zip(square, moment, strict=True)])
        weight = 1 / spread**2
        return np.tile(_shortest(np.tensordot(weight, square, 1), weight @ moment), (moment.shape[0], 1))

    def _scaled(self, products: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Squares (n, p, p) and moments (n, p) of columns of length one."""
        length = self._length
        return products[:, :-1, :-1] / np.outer(length, length), products[:, :-1, -1] / length

    @cached_property
    def _whole(self) -> FloatArray:
        return np.asarray(self.products.sum(axis=0))

    @cached_property
    def _length(self) -> FloatArray:
        """Lengths (p,) of the columns, infinite where one is not seen and has no value."""
        length: FloatArray = np.sqrt(np.diagonal(self._whole, axis1=1, axis2=2)[:, :-1].sum(axis=0))
        length[length <= 1e-9 * length.max()] = np.inf
        return length

    @cached_property
    def _spread(self) -> FloatArray:
        """Root mean square (n,) of what is left of every joint, which the weights go by."""
        square, moment = self._scaled(self._whole)
        power = self._whole[:, -1, -1]
        spread: FloatArray = np.maximum(np.sqrt(power / self.counts), 1e-9)
        for _ in range(_ROUNDS):
            values = self._solution(self._whole, spread)
            left = power - 2 * (moment * values).sum(axis=1) + np.einsum("ji,jik,jk->j", values, square, values)
            spread = np.sqrt(np.maximum(left / self.counts, 1e-16 * power + 1e-24))
        return spread


def _shortest(square: FloatArray, moment: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq(square, moment, rcond=DEPENDENT**2)[0], dtype=np.float64)
