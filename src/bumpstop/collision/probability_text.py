"""Probabilities as a person reads them: the same on terminal and page, and never 0 for what is only improbable."""

from __future__ import annotations

import math
from collections.abc import Callable

from bumpstop.rounding import on_its_side, rounded

# The quadrature leaves out what is less probable: an integrated probability below is no more than this.
MIN_PRINTED_PROBABILITY = 1e-12
MIN_PERCENT = 1e-6  # a probability that is not spelt out in percent


def percent(p: float, *, integrated: bool = False, up: bool = False) -> str:
    """A probability in percent that never rounds to certainty, nor to impossibility.

    Args:
        p: probability; NaN: there is none.
        integrated: it comes from a quadrature, whose 0 and 1 may be what it no longer follows. Those of counts and
            shares are exact.
        up: round upward, as what is "at most" so much.
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
        return f"{_rounded(p, 2, up):.7g} %"
    # Beyond 99.9 % it is the distance from certainty that tells.
    if p <= 0.999:
        return f"{_rounded(p, 3, up):.3g} %"
    return f"{(math.ceil(1e6 * p - 1e-6) if up else math.floor(1e6 * p)) / 1e4:.6g} %"


def small_percent(p: float, *, integrated: bool = False, up: bool = False) -> str:
    """As :func:`percent`, with figures for what is next to nothing, where that is compared with what is accepted."""
    if not p < MIN_PERCENT or (p <= 0 and not integrated):
        return percent(p, integrated=integrated, up=up)
    return f"{_rounded(p, 2, up):.2g} %" if p > 0 else f"less than {100 * MIN_PRINTED_PROBABILITY:.0e} %"


def none_of(runs: int, text: Callable[..., str] = percent) -> str:
    """What drawn runs say of a probability where none of them had it: nothing above this, at 95 % confidence."""
    most = text(_none_at_most(runs), up=True)
    less, plural = "" if most.startswith("less") else "less than ", "" if runs == 1 else "s"
    return f"{less}{most} (none of {runs} run{plural})"


def within(p: float, accepted: float, runs: int | None) -> str:
    """How a probability that is not above what is accepted lies beside it; ``runs``: that were drawn, None: none."""
    shown = p > 0 or runs is None or _none_at_most(runs) <= accepted
    return f"{'within the accepted' if shown else 'accepted:'} {accepted_percent(accepted)}"


def _none_at_most(runs: int) -> float:
    """Some 3 over the runs: a probability above would have shown itself in 95 % of draws."""
    return -math.expm1(math.log(0.05) / runs)


def accepted_percent(p: float) -> str:
    """What is accepted, in percent with all of its digits: others are compared with it."""
    return f"{100 * p:.10g} %"


def apart(p: float, accepted: float, text: Callable[[float], str], *, up: bool = False) -> str:
    """A probability as ``text`` tells it, on its side of what is accepted as :func:`accepted_percent` tells that.

    Args:
        p: probability.
        accepted: what it is compared with.
        text: of a probability.
        up: whether that rounds upward.
    """
    told = text(p)
    if not told[0].isdigit():
        return told
    if p == accepted:
        return accepted_percent(accepted)
    beside = float(accepted_percent(accepted).split()[0])

    more = (f"{_rounded(p, digits, up):.{digits}g} %" for digits in range(3, 18))
    return on_its_side((told, *more), p, (accepted, beside))


def use_percent(use: float) -> str:
    """A finite share of a limit in percent: three digits or whole, and as many more as tell it from all of it."""
    told = f"{100 * use:.3g}" if use < 9.99 else f"{100 * use:.0f}"
    more = (f"{100 * use:.{digits}g}" for digits in range(4, 18))
    return f"{on_its_side((told, *more), use, (1, 100))} %"


def _rounded(p: float, digits: int, up: bool) -> float:
    """Percent of so many digits."""
    return rounded(100 * p, digits, up=True) if up else float(f"{100 * p:.{digits}g}")


def decimal(p: float, *, integrated: bool = False) -> str:
    """A probability in a column: four decimals, powers of ten below a thousandth."""
    if p >= 0.001 or (p <= 0 and not integrated):
        return f"{p:.4f}"
    return f"{p:.1e}" if p > MIN_PRINTED_PROBABILITY else f"< {MIN_PRINTED_PROBABILITY:.0e}"
