"""Regenerate the polynomials of ``include/bumpstop/math/sincos_coefficients.hpp``.

Run ``python tools/sincos_coefficients.py > include/bumpstop/math/sincos_coefficients.hpp`` with mpmath installed.

On [-pi/4, pi/4], and with t = x^2, what the first terms of the Taylor series leave is t^(3/2) S(t) of the sine and
t^2 C(t) of the cosine. S and C are expanded in Chebyshev polynomials in 60 digits, cut off, and turned into powers of
t, lowest first. The polynomials are then wrong by 2e-17 of the sine and 2e-18 of the cosine at most, where Taylor's
series would need two terms more.
"""

import mpmath as mp

mp.mp.dps = 60
DEGREE = 5
SAMPLES = 80
LARGEST = (mp.pi / 4) ** 2


def sine_rest(t):
    """(sin x - x) / x^3 at x^2 = t > 0."""
    x = mp.sqrt(t)
    return (mp.sin(x) - x) / x**3


def cosine_rest(t):
    """(cos x - 1 + x^2 / 2) / x^4 at x^2 = t > 0."""
    return (mp.cos(mp.sqrt(t)) - 1 + t / 2) / t**2


def powers(function):
    """The Chebyshev series of a function on [0, LARGEST], cut off after DEGREE, in powers of t."""
    nodes = [mp.cos(mp.pi * (k + mp.mpf(1) / 2) / SAMPLES) for k in range(SAMPLES)]
    series = mp.taylor(
        lambda t: mp.fsum(
            (1 if n else mp.mpf(1) / 2)
            * (2 * mp.fsum(function(LARGEST * (1 + y) / 2) * mp.chebyt(n, y) for y in nodes) / SAMPLES)
            * mp.chebyt(n, 2 * t / LARGEST - 1)
            for n in range(DEGREE + 1)
        ),
        0,
        DEGREE,
    )
    return [float(c) for c in series]


def main():
    """Print the header."""
    print("/// @file\n/// Made by tools/sincos_coefficients.py; do not edit.")
    print("#pragma once")
    print("\nnamespace bumpstop::sincos_polynomial {\n")
    for name, what, function in (
        ("sine", "(sin x - x) / x^3", sine_rest),
        ("cosine", "(cos x - 1 + x^2 / 2) / x^4", cosine_rest),
    ):
        print(f"/// {what} in powers of x^2 on [0, pi/4], lowest first.")
        print(f"inline constexpr double {name}[{DEGREE + 1}] = {{")
        for c in powers(function):
            print(f"    {c!r},")
        print("};")
    print("\n}  // namespace bumpstop::sincos_polynomial")


if __name__ == "__main__":
    main()
