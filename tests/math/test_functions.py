"""Elementary functions of the kernels against mpmath at 50 digits, for every instruction set that runs here.

``python -m pytest tests/math/test_functions.py -s -k table`` prints the error table of docs/reference/math.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import mpmath as mp
import numpy as np
import pytest
from scipy.special import ndtri

from bumpstop import _native

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

TARGETS = _native.available_targets()
EPSILON = 2.0**-52

# Largest x whose erfc is a normal number is 26.543; the exponential is cut off at exp(-708), x = 26.6083.
LAST_NORMAL_ERFC = 26.543
FIRST_ZERO_ERFC = 26.61

# What include/bumpstop/math/functions.hpp claims. It gives no figure for sine and cosine; two units in the last place
# of the result are at most 2 * 2^-52.
BOUND = {"sin": 2 * EPSILON, "cos": 2 * EPSILON, "erfc": 1e-15, "log": 1e-15, "normal_upper_quantile": 1e-15}


def trigonometric_points(rng: np.random.Generator) -> Floats:
    # Next to the multiples of pi/2 one of the two functions nearly vanishes, and the reduction must not lose digits.
    multiples = np.arange(-63_661, 63_662, 61) * (np.pi / 2)
    return np.concatenate(
        [
            np.linspace(-7.0, 7.0, 1401),
            rng.uniform(-1e5, 1e5, 2000),
            multiples,
            np.nextafter(multiples, np.inf),
            (np.arange(-40, 40) + 0.5) * (np.pi / 2),
            10.0 ** -np.arange(1.0, 300.0, 7.0),
            [-1e5, 1e5],
        ]
    )


def erfc_points(rng: np.random.Generator) -> Floats:
    return np.concatenate(
        [
            np.linspace(-6.0, LAST_NORMAL_ERFC, 2001),
            rng.uniform(-6.0, LAST_NORMAL_ERFC, 2000),
            rng.uniform(-1.0, 3.0, 1000),
            10.0 ** -np.arange(1.0, 300.0, 7.0),
        ]
    )


def log_points(rng: np.random.Generator) -> Floats:
    around = np.arange(-50, 51) * EPSILON
    return np.concatenate(
        [
            np.logspace(-307.6, 308.2, 1501),
            rng.uniform(0.5, 2.0, 2000),
            1.0 + rng.uniform(-1e-3, 1e-3, 500),
            1.0 + around,
            np.sqrt(0.5) + around,
            np.sqrt(2.0) + around,
            2.0 ** np.arange(-1022.0, 1024.0, 31.0),
        ]
    )


def quantile_points(rng: np.random.Generator) -> Floats:
    # 0.075 and exp(-25) are where one rational function hands over to the next.
    points = np.concatenate(
        [
            np.logspace(-17.0, np.log10(0.5), 1001),
            np.logspace(-300.0, -17.0, 301),
            rng.uniform(1e-17, 0.5, 1000),
            0.075 + np.linspace(-1e-3, 1e-3, 201),
            np.exp(-25.0) * (1.0 + np.linspace(-1e-3, 1e-3, 201)),
            0.5 - np.logspace(-16.0, -1.0, 101),
            [2.0**-54, 0.5],
        ]
    )
    return np.clip(points, 1e-300, 0.5)


def exact_quantile(p: mp.mpf) -> mp.mpf:
    # Two Newton steps double the digits of scipy's fifteen twice.
    z = mp.mpf(-float(ndtri(float(p))))
    for _ in range(2):
        z += (mp.erfc(z / mp.sqrt(2)) / 2 - p) * mp.sqrt(2 * mp.pi) * mp.exp(z * z / 2)
    return z if p != 0.5 else mp.mpf(0)


POINTS = {
    "sin": trigonometric_points,
    "cos": trigonometric_points,
    "erfc": erfc_points,
    "log": log_points,
    "normal_upper_quantile": quantile_points,
}
EXACT: dict[str, Callable[[mp.mpf], mp.mpf]] = {
    "sin": mp.sin,
    "cos": mp.cos,
    "erfc": mp.erfc,
    "log": mp.log,
    "normal_upper_quantile": exact_quantile,
}


@dataclass(frozen=True)
class Reference:
    """Exact values, each as the sum of two doubles, so that errors far below one rounding can be told."""

    x: Floats
    high: Floats
    low: Floats

    def relative_error(self, value: Floats) -> Floats:
        with np.errstate(invalid="ignore"):
            error = np.abs((value - self.high) - self.low) / np.abs(self.high)
        return np.where(self.high == 0, np.where(value == 0, 0.0, np.inf), error)


@cache
def reference(name: str) -> Reference:
    x = POINTS[name](np.random.default_rng(20))
    with mp.workdps(50):
        exact = [EXACT[name](mp.mpf(float(value))) for value in x]
        high = [float(value) for value in exact]
        low = [float(value - rounded) for value, rounded in zip(exact, high, strict=True)]
    return Reference(x, np.array(high), np.array(low))


def call(target: str, name: str, x: npt.ArrayLike) -> Floats:
    value: Floats = getattr(_native.load(target), name)(np.ascontiguousarray(x, dtype=np.float64))
    return value


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("name", BOUND)
def test_relative_error(name: str, target: str) -> None:
    exact = reference(name)
    error = exact.relative_error(call(target, name, exact.x))
    worst = int(np.argmax(error))
    assert np.isfinite(error).all()
    assert error[worst] < BOUND[name], f"{name}({exact.x[worst]!r}) is off by {error[worst]:.3g}"


def test_table_of_errors() -> None:
    print("\n| function | points | " + " | ".join(TARGETS) + " |")
    print("|---|---|" + "---|" * len(TARGETS))
    for name in BOUND:
        exact = reference(name)
        assert len(exact.x) > 2000
        worst = [f"{exact.relative_error(call(target, name, exact.x)).max():.2g}" for target in TARGETS]
        print(f"| `{name}` | {len(exact.x)} | " + " | ".join(worst) + " |")


@pytest.mark.parametrize("name", BOUND)
def test_targets_agree(name: str) -> None:
    exact = reference(name)
    first, *others = (call(target, name, exact.x) for target in TARGETS)
    for other in others:
        assert np.all(np.abs(other - first) <= 1e-14 * np.abs(first))


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("name", BOUND)
def test_value_depends_on_its_own_element_only(name: str, target: str) -> None:
    # A register holds 2, 4 or 8 elements; the last one is filled up.
    x = np.random.default_rng(3).uniform(0.01, 0.5, 19)
    alone = [call(target, name, x[i : i + 1])[0] for i in range(len(x))]
    assert call(target, name, []).shape == (0,)
    for first in range(3):
        for last in range(first + 1, len(x) + 1):
            assert call(target, name, x[first:last]).tolist() == alone[first:last]


@pytest.mark.parametrize("target", TARGETS)
def test_sine_is_odd_and_cosine_even(target: str) -> None:
    x = reference("sin").x
    sin, cos = call(target, "sin", x), call(target, "cos", x)
    assert np.array_equal(call(target, "sin", -x), -sin)
    assert np.array_equal(call(target, "cos", -x), cos)
    # Two squares, each with the error of its root twice and a rounding, and the sum's rounding.
    assert np.abs(sin * sin + cos * cos - 1).max() < 4 * BOUND["sin"] + 2 * EPSILON
    assert call(target, "sin", [0.0]) == 0
    assert call(target, "cos", [0.0]) == 1


@pytest.mark.parametrize("target", TARGETS)
def test_erfc_at_its_edges(target: str) -> None:
    # erfc 0 is one rounding short of 1, and so is that of any other number too small to matter.
    assert np.abs(call(target, "erfc", [0.0, -0.0, 1e-17, -1e-17, 1e-300, 5e-324]) - 1).max() < BOUND["erfc"]
    assert call(target, "erfc", [-6.0, -30.0, -1e300, -np.inf]).tolist() == [2.0] * 4
    assert call(target, "erfc", [FIRST_ZERO_ERFC, 27.0, 30.0, 31.0, 1e10, 1e300, np.inf]).tolist() == [0.0] * 7


@pytest.mark.parametrize("target", TARGETS)
def test_erfc_below_the_normal_numbers(target: str) -> None:
    # Subnormal results have few digits, so the error is counted in the smallest of them, 2^-1074.
    x = np.linspace(LAST_NORMAL_ERFC, 26.6, 50)
    exact = np.array([float(mp.erfc(mp.mpf(float(value)))) for value in x])
    assert np.abs(call(target, "erfc", x) - exact).max() <= 2.0**-1022 * 1e-15 + 2 * 2.0**-1074


@pytest.mark.parametrize("target", TARGETS)
def test_erfc_falls_and_is_symmetric(target: str) -> None:
    # Steps of 1/1024: over each the function changes by far more than its error, from -5.5 on, where 2 - 7e-15.
    x = np.arange(-5.5, 26.5, 1 / 1024)
    value = call(target, "erfc", x)
    assert (np.diff(value) <= 0).all()
    assert (np.diff(value[x > -5]) < 0).all()
    assert np.array_equal(call(target, "erfc", -x[x > 0]), 2.0 - value[x > 0])


@pytest.mark.parametrize("target", TARGETS)
def test_logarithm_of_powers_of_two_and_of_one(target: str) -> None:
    assert call(target, "log", [1.0]) == 0
    power = np.arange(-1022, 1024)
    # One rounding of the product and half of one of ln 2, beside the error of the function.
    np.testing.assert_allclose(
        call(target, "log", 2.0**power), power * float(np.log(2.0)), rtol=1e-15 + EPSILON, atol=0
    )
    assert (np.diff(call(target, "log", np.logspace(-307, 308, 20_001))) > 0).all()


@pytest.mark.parametrize("target", TARGETS)
def test_quantile_falls_and_undoes_the_tail_probability(target: str) -> None:
    p = np.concatenate([np.logspace(-300, -2, 4001), np.linspace(0.011, 0.5, 4001)])
    z = call(target, "normal_upper_quantile", p)
    assert (np.diff(z) < 0).all()
    assert z[-1] == 0
    # A relative error d of z changes the tail by less than (1 + z^2) d of itself. 1e-15 for z, a rounding each of
    # z / sqrt 2 and its factor, then the error of erfc.
    back = 0.5 * call(target, "erfc", z / np.sqrt(2.0))
    assert np.all(np.abs(back / p - 1) < (1 + z * z) * (1e-15 + 2 * EPSILON) + 1e-15)
