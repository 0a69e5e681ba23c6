"""The panel of the result: the verdict, always in sight, the figures and the plots."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bumpstop.collision.probability_text import percent
from bumpstop.report.colours import EVENT, FAINT, INK, LIMIT
from bumpstop.report.markup import Html, element
from bumpstop.terminal import number
from bumpstop.view.plots.distribution import distribution_plot, exceedance_plot
from bumpstop.view.plots.force_over_time import force_over_time_plot
from bumpstop.view.plots.risk import body_parts_plot, risk_plot, tornado_plot

if TYPE_CHECKING:
    from collections.abc import Callable

    from bumpstop.view.answer import Answer

# Colour, sign and word say the same: one of them is enough to read the verdict.
_LOOKS = {"good": (EVENT, "✔"), "bad": (LIMIT, "✖"), "open": (FAINT, "?")}
_SHOWN = (("mean", "mean"), ("sd", "sd"), ("p50", "p50"), ("p95", "p95"), ("p99", "p99"), ("p999", "p99.9"))


def verdict_box(answer: Answer, *, before: Answer | None = None) -> Html:
    """The verdict as a word with its sign and colour, and as a sentence with its probability."""
    colour, sign = _LOOKS[answer.tone]
    head = element(
        "div",
        f"{sign} {answer.word}",
        style=f"background:{colour};color:white;font-weight:700;padding:3px 8px;font-size:15px",
        data_verdict=answer.conclusion,
    )
    rows = [head, element("div", answer.sentence, style="padding:4px 8px", data_sentence="")]
    if before is not None:
        was, now = (each.result.peak_force.quantile(0.99) for each in (before, answer))
        text = f"Kept for comparison: {before.word}, p99 {number(was)} N; now {number(now)} N."
        rows.append(element("div", text, style=f"padding:2px 8px;color:{FAINT}", data_before=""))
    # A verdict is never better by what is not known yet: until the warnings are computed, it says so.
    warnings = answer.result.warnings if answer.checked else ("Warnings are being computed.",)
    look = f"padding:2px 8px;color:{LIMIT if answer.checked else FAINT}"
    rows += [element("div", f"⚠ {text}", style=look) for text in warnings]
    return element(
        "div",
        *rows,
        style=f"position:sticky;top:0;z-index:5;background:white;border:2px solid {colour};margin-bottom:4px",
    )


def figures_table(answer: Answer) -> Html:
    """The figures, each marked with its key of ``bumpstop evaluate --json``."""
    columns = [name for name, _ in _SHOWN]
    head = element("tr", element("th", ""), *(element("th", label) for _, label in _SHOWN), element("th", "P(over)"))
    rows = []
    for label, key, over in (
        ("force, N", "peak_force_N", "p_over_force"),
        ("pressure, N/cm²", "pressure_N_cm2", "p_over_pressure"),
    ):
        cells = [_figure(answer, f"{key}.{column}") for column in columns]
        rows.append(element("tr", element("th", label), *cells, _figure(answer, f"verdict.{over}", share=True)))
    line = element(
        "div",
        "never detected ",
        _figure(answer, "undetected_probability", share=True, tag="span"),
        ", false alarm before contact ",
        _figure(answer, "false_alarm_probability", share=True, tag="span"),
        ", no contact ",
        _figure(answer, "no_contact_probability", share=True, tag="span"),
        style="padding:2px 2px",
    )
    table = element("table", head, *rows, style="width:100%;font-size:11px;text-align:right;border-spacing:2px 0")
    return element("div", table, line, style=f"font-size:11px;color:{INK}")


def _figure(answer: Answer, key: str, *, share: bool = False, tag: str = "td") -> Html:
    value = answer.figures[key]
    if value is None:
        text = "none"
    else:
        text = percent(value, integrated=answer.result.kind == "exact") if share else number(value)
    exact = "" if value is None or not math.isfinite(value) else repr(float(value))
    return element(tag, text.replace("less than ", "< "), data_figure=key, data_value=exact)


def details_html(answer: Answer, superseded: Callable[[], bool]) -> Html:
    """Plots that need more than one evaluation.

    Args:
        answer: of the scenario on screen.
        superseded: asked between two evaluations.

    Raises:
        SupersededError: another scenario is on screen.
    """
    plots = [
        tornado_plot(answer),
        force_over_time_plot(answer),
        risk_plot(answer, superseded),
        body_parts_plot(answer, superseded),
    ]
    return element("div", *plots, data_details=answer.scenario.contact.body or "")


def result_html(answer: Answer, details: Html, *, serial: int, before: Answer | None = None) -> Html:
    """The whole panel.

    Args:
        answer: of the scenario on screen.
        details: further plots, which may be those of a moment ago.
        serial: number of the answer, by which tests see that it is drawn.
        before: an answer kept for comparison.
    """
    return element(
        "div",
        verdict_box(answer, before=before),
        figures_table(answer),
        distribution_plot(answer, before),
        exceedance_plot(answer),
        details,
        data_serial=str(serial),
        style=f"font:12px/1.35 system-ui, sans-serif;color:{INK};background:white;padding:2px 6px 12px",
    )
