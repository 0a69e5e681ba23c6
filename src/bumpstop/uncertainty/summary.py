"""Tables of a verdict with an interval, as a person reads them on a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from bumpstop.collision.probability_text import decimal, use_percent
from bumpstop.terminal import table

if TYPE_CHECKING:
    from rich.table import Table

    from bumpstop.uncertainty.cases import TornadoBar, UncertainCase

# Bars of a printed tornado.
_PRINTED = 8


def case_table(cases: Mapping[str, UncertainCase], *, judged: bool, integrated: bool) -> Table:
    """A row for each case by its title; ``judged``: there are limits, ``integrated``: no runs were drawn."""
    rows = [
        (
            title,
            "" if math.isnan(case.p_over) else decimal(case.p_over, integrated=integrated),
            _utilisation(case.utilisation, judged=judged),
            decimal(case.false_alarm, integrated=integrated),
        )
        for title, case in cases.items()
    ]
    return table(("case", "P(over)", _heading(judged=judged), "false alarm"), rows, left=("case",))


def tornado_table(bars: Sequence[TornadoBar], *, judged: bool) -> Table:
    """The inputs that matter most, a row each; ``judged``: there are limits."""
    rows = []
    for bar in bars[:_PRINTED]:
        low, high = (_utilisation(x, judged=judged) for x in (bar.utilisation_low, bar.utilisation_high))
        rows.append((_bar_name(bar), f"{bar.low:.4g}", f"{bar.high:.4g}", f"{low} to {high}"))
    title = "what matters most"
    return table((title, "from", "to", _heading(judged=judged)), rows, left=(title,))


def _heading(*, judged: bool) -> str:
    return "of the limit" if judged else "force, N"


def _bar_name(bar: TornadoBar) -> str:
    """Key of an input, and whether its figures are factors or assumed."""
    about = [word for word, holds in (("factor", bar.relative), ("assumed", bar.assumed)) if holds]
    return f"{bar.key} ({', '.join(about)})" if about else bar.key


def _utilisation(value: float, *, judged: bool) -> str:
    """Share of the limit in percent, or a force without limits."""
    if math.isinf(value):
        return "unbounded"
    return use_percent(value) if judged else f"{value:.4g}"
