"""Peak forces over the parameters: exact at some points, a polynomial of the second degree between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray

# Weight of the coefficients against the points: without it few points would make wild polynomials.
_RIDGE = 1e-3


@dataclass(frozen=True, eq=False)
class ResponseSurface:
    """Polynomials of the second degree in z, one for each column of values.

    Attributes:
        coefficients: (terms, columns).
        error: root mean square of what the polynomials miss, left-one-out (columns,).
    """

    coefficients: FloatArray
    error: FloatArray

    @classmethod
    def fit(cls, z: FloatArray, values: FloatArray, weights: FloatArray | None = None) -> ResponseSurface:
        """By least squares with a small ridge.

        Args:
            z: points (points, parameters).
            values: (points, columns).
            weights: of the points (points,); None: all alike.
        """
        basis = quadratic_terms(z)
        root = np.ones(len(z)) if weights is None else np.sqrt(weights)
        weighted = basis * root[:, None]
        penalty = _RIDGE * np.eye(basis.shape[1])
        penalty[0, 0] = 0.0
        inverse = np.linalg.pinv(weighted.T @ weighted + penalty)
        coefficients = inverse @ weighted.T @ (values * root[:, None])
        leverage = np.clip(np.einsum("ij,jk,ik->i", weighted, inverse, weighted), 0.0, 0.95)
        left_out = (values - basis @ coefficients) / (1 - leverage)[:, None]
        error = np.sqrt(np.average(left_out**2, axis=0, weights=weights))
        return cls(coefficients, np.asarray(error))

    def __call__(self, z: FloatArray) -> FloatArray:
        """Values at points (points, parameters): (points, columns)."""
        return np.asarray(quadratic_terms(z) @ self.coefficients)


def quadratic_terms(z: FloatArray) -> FloatArray:
    """1, z and all products of two z (points, terms)."""
    n = z.shape[1]
    first, second = np.triu_indices(n)
    return np.concatenate([np.ones((len(z), 1)), z, z[:, first] * z[:, second]], axis=1)


def normal_points(count: int, parameters: int, seed: int) -> FloatArray:
    """Well-spread points of standard normal numbers (count, parameters), by a scrambled Sobol sequence."""
    from scipy.special import ndtri
    from scipy.stats import qmc

    power = max(1, int(np.ceil(np.log2(count))))
    uniform = qmc.Sobol(parameters, seed=seed).random_base2(power)[:count]
    return np.asarray(ndtri(np.clip(uniform, 1e-12, 1 - 1e-12)), dtype=np.float64)
