"""Laws fitted to a sweep: what Schroeder (2013) fitted, and one better."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from bumpstop.arrays import FloatArray

# Less than this share of the largest value is rounding.
_ROUNDING = 1e-12
# What a fit must explain of the variance to stand without a better one named beside it.
R2_WANTED = 0.99


@dataclass(frozen=True, eq=False)
class Fit:
    """One model fitted by least squares.

    Attributes:
        name: ``"linear"``, ``"quadratic"``, ``"power"`` or ``"constant plus power"``.
        formula: in words, with figures.
        parameters: A, B, C in the order of the formula.
        r2: share of the variance that it explains.
        fitted: its values at the points (N,).
    """

    name: str
    formula: str
    parameters: tuple[float, ...]
    r2: float
    fitted: FloatArray

    def to_json(self) -> dict[str, Any]:
        """All but the values."""
        return {"name": self.name, "formula": self.formula, "parameters": list(self.parameters), "r2": self.r2}


def fit_models(x: FloatArray, y: FloatArray) -> list[Fit]:
    """Fit every model that the points allow: more points than parameters, and powers of positive x only.

    None where y does not vary.

    Args:
        x: values (N,), ascending.
        y: what depends on them (N,), finite.
    """
    if np.ptp(y) <= _ROUNDING * np.abs(y).max():
        return []
    models: list[tuple[str, int, Callable[[FloatArray, FloatArray], _Found]]] = [
        ("linear", 2, _linear),
        ("quadratic", 3, _quadratic),
    ]
    if x[0] > 0:
        models += [("power", 2, _power), ("constant plus power", 3, _constant_plus_power)]
    found = []
    for name, parameters, model in models:
        if x.size > parameters:
            figures, fitted, formula = model(x, y)
            found.append(Fit(name, formula, figures, r_squared(y, fitted), fitted))
    return found


def r_squared(y: FloatArray, fitted: FloatArray) -> float:
    """Share of the variance of y, which varies, that a fit explains."""
    return float(1 - np.sum((y - fitted) ** 2) / np.sum((y - y.mean()) ** 2))


_Found = tuple[tuple[float, ...], FloatArray, str]


def _plus(value: float) -> str:
    """A figure behind another one, with its sign between them."""
    return f"{'-' if value < 0 else '+'} {abs(value):.4g}"


def _linear(x: FloatArray, y: FloatArray) -> _Found:
    """A + B x."""
    B, A = (float(c) for c in np.polyfit(x, y, 1))
    return (A, B), A + B * x, f"{A:.4g} {_plus(B)} x"


def _quadratic(x: FloatArray, y: FloatArray) -> _Found:
    """A + B x + C x^2, in x over its largest for the arithmetic."""
    size = float(np.abs(x).max())
    C, B, A = np.polyfit(x / size, y, 2)
    A, B, C = float(A), float(B / size), float(C / size**2)
    return (A, B, C), A + B * x + C * x**2, f"{A:.4g} {_plus(B)} x {_plus(C)} x^2"


def _power(x: FloatArray, y: FloatArray) -> _Found:
    """A x^B without a constant, as in Schroeder (2013). For a given B the rest is linear, so only B is searched for."""
    z = x / x[-1]

    def scale(B: float) -> float:
        return float(y @ z**B / (z**B @ z**B))

    B = _search(lambda B: float(np.sum((y - scale(B) * z**B) ** 2)), _exponents(x))
    A = scale(B) / float(x[-1]) ** B
    return (A, B), scale(B) * z**B, f"{A:.4g} x^{B:.4g}"


def _constant_plus_power(x: FloatArray, y: FloatArray) -> _Found:
    """A + B x^C."""
    z = x / x[-1]

    def line(C: float) -> tuple[float, float]:
        B, A = np.polyfit(z**C, y, 1)
        return float(A), float(B)

    def misfit(C: float) -> float:
        # At C = 0 there is no power, only a constant.
        if abs(C) < 1e-3:
            return float(np.sum((y - y.mean()) ** 2))
        A, B = line(C)
        return float(np.sum((y - A - B * z**C) ** 2))

    C = _search(misfit, _exponents(x))
    A, B = line(C)
    fitted = A + B * z**C
    B /= float(x[-1]) ** C
    return (A, B, C), fitted, f"{A:.4g} {_plus(B)} x^{C:.4g}"


# Close together where usual curves lie, then in even ratios.
_EXPONENTS = np.linspace(-4.0, 4.0, 81)
_STEEP, _STEEPEST = 1.05, 40.0
# Powers of ten within which all powers of x stay, so that their squares are still numbers.
_MAX_DECADES = 140.0


def _exponents(x: FloatArray) -> FloatArray:
    """Exponents to look at, ascending."""
    decades = float(np.abs(np.log10([x[0], x[-1], x[-1] / x[0]])).max())
    most = min(_STEEPEST, _MAX_DECADES / max(decades, 1e-9))
    count = max(0, math.floor(math.log(most / _EXPONENTS[-1]) / math.log(_STEEP)))
    steep = _EXPONENTS[-1] * _STEEP ** np.arange(1, count + 1)
    return np.concatenate([-steep[::-1], _EXPONENTS, steep])


def _search(misfit: Callable[[float], float], exponents: FloatArray) -> float:
    """The best exponent: the best of a grid, refined between its neighbours."""
    from scipy import optimize

    values = [misfit(float(exponent)) for exponent in exponents]
    best = int(np.argmin(values))
    low, high = exponents[max(0, best - 1)], exponents[min(exponents.size - 1, best + 1)]
    return float(optimize.minimize_scalar(misfit, bounds=(low, high), method="bounded", options={"xatol": 1e-9}).x)
