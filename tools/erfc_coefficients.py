"""Regenerate the polynomial of ``include/bumpstop/math/erfc_coefficients.hpp``.

Run ``python tools/erfc_coefficients.py > include/bumpstop/math/erfc_coefficients.hpp`` with mpmath installed.

The scaled complementary error function erfcx(x) = exp(x^2) erfc(x) falls like 1/x. Multiplied by (1 + 2x) it stays
between 1 and 1.3 on the whole half line, and the map t = (x - 3.75) / (x + 3.75) brings that half line to
[-1, 1], where one polynomial serves. Its Chebyshev coefficients are found in 60 digits and turned into
powers of t, lowest first.
"""

import mpmath as mp

SHIFT = mp.mpf("3.75")
DEGREE = 24
SAMPLES = 200


def scaled(t):
    """(1 + 2x) erfcx(x) at the x that t stands for."""
    if t == 1:
        return 2 / mp.sqrt(mp.pi)
    x = SHIFT * (1 + t) / (1 - t)
    if x > 25:  # erfcx by its continued fraction, where exp(x^2) would be unwieldy
        fraction = mp.mpf(0)
        for k in range(200, 0, -1):
            fraction = (mp.mpf(k) / 2) / (x + fraction)
        return (1 + 2 * x) / (mp.sqrt(mp.pi) * (x + fraction))
    return (1 + 2 * x) * mp.exp(x * x) * mp.erfc(x)


def main():
    """Print the header."""
    mp.mp.dps = 60
    nodes = [mp.cos(mp.pi * (k + mp.mpf(1) / 2) / SAMPLES) for k in range(SAMPLES)]
    values = [scaled(t) for t in nodes]
    chebyshev = [
        2 * sum(v * mp.cos(mp.pi * n * (k + mp.mpf(1) / 2) / SAMPLES) for k, v in enumerate(values)) / SAMPLES
        for n in range(DEGREE + 1)
    ]
    chebyshev[0] /= 2
    previous, current = [mp.mpf(1)], [mp.mpf(0), mp.mpf(1)]
    powers = [mp.mpf(0)] * (DEGREE + 1)
    powers[0] += chebyshev[0]
    for n in range(1, DEGREE + 1):
        for i, c in enumerate(current):
            powers[i] += chebyshev[n] * c
        following = [mp.mpf(0)] + [2 * c for c in current]
        for i, c in enumerate(previous):
            following[i] -= c
        previous, current = current, following
    print("/// @file\n/// Made by tools/erfc_coefficients.py; do not edit.")
    print("#pragma once")
    print("\nnamespace bumpstop::erfc_polynomial {\n")
    print(f"inline constexpr double shift = {mp.nstr(SHIFT, 17)};")
    print("/// (1 + 2x) exp(x^2) erfc(x) in powers of t = (x - shift) / (x + shift), lowest first.")
    print(f"inline constexpr double coefficients[{DEGREE + 1}] = {{")
    for c in powers:
        print(f"    {float(c)!r},")
    print("};\n\n}  // namespace bumpstop::erfc_polynomial")


if __name__ == "__main__":
    main()
