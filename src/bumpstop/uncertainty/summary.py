"""A verdict with an interval as a person reads it on a terminal."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING

from bumpstop.collision.probability_text import decimal

if TYPE_CHECKING:
    from rich.console import Console

    from bumpstop.uncertainty.result import TornadoBar, UncertainResult

# Bars of a printed tornado.
_PRINTED = 8


def summary_text(result: UncertainResult) -> str:
    """What ``bumpstop evaluate`` prints, in lines of at most 80 letters."""
    from rich.console import Console

    text = io.StringIO()
    print_uncertain_summary(
        result, Console(file=text, force_jupyter=False, width=80, highlight=False, markup=False, color_system=None)
    )
    return "\n".join(line.rstrip() for line in text.getvalue().splitlines())


def print_uncertain_summary(result: UncertainResult, console: Console) -> None:
    """Print the verdict with its interval, then the central case."""
    from rich.table import Table
    from rich.text import Text

    word, style = {
        "acceptable": ("ACCEPTABLE", "bold black on bright_cyan"),
        "not_acceptable": ("NOT ACCEPTABLE", "bold white on red"),
        "inconclusive": ("INCONCLUSIVE", "bold black on yellow"),
        "no_limits": ("NO LIMITS TO JUDGE BY", "bold"),
    }[result.conclusion]
    console.print(Text(f" {word} ", style=style), result.reason)
    cases = Table(box=None, pad_edge=False)
    for heading in ("case", "P(over)", "of the limit" if _judged(result) else "force, N", "false alarm"):
        cases.add_column(heading, justify="left" if heading == "case" else "right")
    names = {
        "central": "central",
        "confident": f"{100 * result.confidence:g} % of the inputs",
        "worst": "worst admissible" if any(each.assumed for each in result.inputs) else "worst: nothing is assumed",
    }
    integrated = result.central.kind == "exact"
    for case in result.cases:
        over = "" if math.isnan(case.p_over) else decimal(case.p_over, integrated=integrated)
        share = utilisation_text(case.utilisation, judged=_judged(result))
        cases.add_row(names[case.name], over, share, decimal(case.false_alarm, integrated=integrated))
    console.print(cases)
    bars = Table(box=None, pad_edge=False)
    for heading in ("what matters most", "from", "to", "of the limit" if _judged(result) else "force, N"):
        bars.add_column(heading, justify="left" if heading == "what matters most" else "right")
    for bar in result.tornado[:_PRINTED]:
        at = [utilisation_text(x, judged=_judged(result)) for x in (bar.utilisation_low, bar.utilisation_high)]
        bars.add_row(bar_name(bar), f"{bar.low:.4g}", f"{bar.high:.4g}", f"{at[0]} to {at[1]}")
    console.print(bars)
    for note in result.notes:
        console.print(f"note: {note}")
    drawn = "" if integrated else f" of {result.central.samples} collisions each"
    console.print(
        f"{result.evaluations} distributions{drawn} at well-spread points, seed {result.seed}; probabilities are of "
        "exceeding a limit in one contact, not the risk of ISO 12100",
        style="dim",
    )
    console.print()
    result.central.print_to(console, case="central case")


def bar_name(bar: TornadoBar) -> str:
    """Key of an input, and whether its figures are factors or assumed."""
    about = [word for word, holds in (("factor", bar.relative), ("assumed", bar.assumed)) if holds]
    return f"{bar.key} ({', '.join(about)})" if about else bar.key


def utilisation_text(value: float, *, judged: bool) -> str:
    """Share of the limit in percent, or a force without limits."""
    if math.isinf(value):
        return "unbounded"
    return f"{100 * value:.3g} %" if judged else f"{value:.4g}"


def _judged(result: UncertainResult) -> bool:
    return result.conclusion != "no_limits"
