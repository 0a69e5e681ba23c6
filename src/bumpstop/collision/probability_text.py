"""Probabilities as a person reads them: the same on terminal and page, and never 0 for what is only improbable."""

from __future__ import annotations

import math
from collections.abc import Callable

# The quadrature leaves out what is less probable: an integrated probability below is no more than this.
MIN_PRINTED_PROBABILITY = 1e-12
MIN_PERCENT = 1e-6  # a probability that is not spelt out in percent


def percent(p: float, *, integrated: bool = False) -> str:
    """A probability in percent that never rounds to certainty, nor to impossibility.

    Args:
        p: probability; NaN: there is none.
        integrated: it comes from a quadrature, whose 0 and 1 may be what it no longer follows. Those of counts and
            shares are exact.
    """
    if math.isnan(p):
        return "none"
    if p >= 1 and not integrated:  # sums of many shares may pass one by a rounding
        return "100 %"
    if p <= 0 and not integrated:
        return "0 %"
    if p < MIN_PERCENT:
        return f"less than {100 * MIN_PERCENT:.4f} %"
    if p > 1 - MIN_PERCENT:
        return "over 99.9999 %"
    if p < 0.1:
        return f"{float(f'{100 * p:.2g}'):.7g} %"
    # Beyond 99.9 % it is the distance from certainty that tells.
    return f"{100 * p:.3g} %" if p <= 0.999 else f"{math.floor(1e6 * p) / 1e4:.6g} %"


def small_percent(p: float, *, integrated: bool = False) -> str:
    """As :func:`percent`, with figures for what is next to nothing, where that is compared with what is accepted."""
    if not p < MIN_PERCENT or (p <= 0 and not integrated):
        return percent(p, integrated=integrated)
    return f"{100 * p:.2g} %" if p > 0 else f"less than {100 * MIN_PRINTED_PROBABILITY:.0e} %"


def apart(p: float, other: float, text: Callable[[float], str]) -> str:
    """A probability as ``text`` tells it, with as many digits as tell it from another that it is compared with."""
    told = text(p)
    if told != text(other) or p == other or not MIN_PERCENT <= p <= 1 - MIN_PERCENT:
        return told
    return next(told for digits in range(3, 18) if (told := f"{100 * p:.{digits}g} %") != f"{100 * other:.{digits}g} %")


def decimal(p: float, *, integrated: bool = False) -> str:
    """A probability in a column: four decimals, powers of ten below a thousandth."""
    if p >= 0.001 or (p <= 0 and not integrated):
        return f"{p:.4f}"
    return f"{p:.1e}" if p > MIN_PRINTED_PROBABILITY else f"< {MIN_PRINTED_PROBABILITY:.0e}"
