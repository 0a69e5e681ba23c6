"""Distributions fitted to curves: planted ones are found again, and no other exponent fits better."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.study.parameters.fits import fit_models
from collision.cases import control_group

# Of the control group over the lowest [1].
NOISE = [2.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0]


def mean_of(**changes: Any) -> float:
    return bs.evaluate(control_group(**changes)).peak_force.mean


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("linear", (3.0, -0.2)),
        ("quadratic", (17.0, 0.07, 0.0013)),
        ("power", (0.4, 1.3)),
        ("power", (44.0, 0.105)),
        ("constant plus power", (20.6, 17.0, -0.998)),
        ("constant plus power", (2.0, 0.3, 2.5)),
        ("constant plus power", (82.0, -3e-17, 12.5)),
        ("power", (3e10, -7.5)),
    ],
)
def test_a_planted_law_is_found_again(name: str, parameters: tuple[float, ...]) -> None:
    x = np.linspace(2.0, 30.0, 15)
    a, b, c = (*parameters, 0.0)[:3]
    y = {
        "linear": a + b * x,
        "quadratic": a + b * x + c * x**2,
        "power": a * x**b,
        "constant plus power": a + b * x**c,
    }[name]
    fit = next(fit for fit in fit_models(x, y) if fit.name == name)
    assert fit.parameters == pytest.approx(parameters, rel=1e-5)
    assert fit.r2 == pytest.approx(1.0, abs=1e-9)
    assert fit.fitted == pytest.approx(y, rel=1e-6)


def test_no_other_exponent_fits_better() -> None:
    # Flat, and then it falls: the force against the noise, of which a fit with an exponent up to 4 explains 0.8.
    x = np.linspace(0.2, 3.0, 12)
    y = np.array([mean_of(detector__noise_sd_Nm=[v * s for s in NOISE]) for v in x])
    fits = {fit.name: fit for fit in fit_models(x, y)}
    best = {"power": 0.0, "constant plus power": 0.0}
    for exponent in (*np.linspace(-30, 30, 600), *np.linspace(-0.2, 0.2, 400)):
        z = (x / x[-1]) ** exponent
        for name, columns in (("power", [z]), ("constant plus power", [np.ones_like(x), z])):
            matrix = np.column_stack(columns) / np.abs(z).max()
            fitted = matrix @ np.linalg.lstsq(matrix, y, rcond=None)[0]
            best[name] = max(best[name], 1 - np.sum((y - fitted) ** 2) / np.sum((y - y.mean()) ** 2))
    assert best["constant plus power"] > 0.99
    for name, r2 in best.items():
        assert r2 - 1e-9 <= fits[name].r2 <= r2 + 1e-3
        A, B, C = (*fits[name].parameters, 0.0)[:3]
        again = A * x**B if name == "power" else A + B * x**C
        assert fits[name].fitted == pytest.approx(again, rel=1e-9)


def test_too_few_points_and_negative_values_get_only_the_laws_they_allow() -> None:
    assert [fit.name for fit in fit_models(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 2.5]))] == ["linear", "power"]
    names = [fit.name for fit in fit_models(np.linspace(-2, 2, 9), np.linspace(1, 3, 9) ** 2)]
    assert names == ["linear", "quadratic"]
