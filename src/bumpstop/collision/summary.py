"""A collision's result as a person reads it on a terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bumpstop.collision.distribution.distribution import finite_mean
from bumpstop.collision.probability_text import decimal
from bumpstop.collision.verdict.alarm_rate import alarm_rate
from bumpstop.terminal import MIN_PRINTED_NUMBER, as_written, beside_limits

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from bumpstop.collision.distribution.distribution import Distribution
    from bumpstop.collision.outcome import CollisionOutcome
    from bumpstop.collision.verdict.verdict import Conclusion, Verdict
    from bumpstop.contact import ContactLimits


def what_is_hit(result: CollisionOutcome) -> str:
    """The body region and its limit table, or the spring where none is named."""
    limits = result.problem.limits
    return f"{limits.label} ({limits.table})" if limits else f"a spring of {result.problem.stiffness:g} N/m"


def arm_title(result: CollisionOutcome) -> str:
    """What the arm is called, and whether it gives way."""
    robot = result.problem.robot
    return f"{robot.title or robot.name}{result.problem.arm_in_words}"


def sign(conclusion: Conclusion) -> Text:
    """The word of a verdict in its colour."""
    from rich.text import Text

    word, style = {
        "acceptable": ("ACCEPTABLE", "bold black on bright_cyan"),
        "not_acceptable": ("NOT ACCEPTABLE", "bold white on red"),
        "inconclusive": ("INCONCLUSIVE", "bold black on yellow"),
        "no_limits": ("NO LIMITS TO JUDGE BY", "bold"),
    }[conclusion]
    return Text(f" {word} ", style=style)


def print_verdict(result: CollisionOutcome, verdict: Verdict, console: Console, *, case: str = "") -> None:
    """Print what hits what, and the verdict: without its sign where it is that of one case of several."""
    console.print(f"{arm_title(result)} {result.problem.motion_in_words} against {what_is_hit(result)}", style="bold")
    if case:
        console.print(f"{case}: {verdict.reason}")
    else:
        console.print(sign(verdict.conclusion), verdict.reason)


def print_figures(result: CollisionOutcome, verdict: Verdict, console: Console) -> None:
    """Print the table of forces and times with their limits."""
    from rich.table import Table

    limits, integrated = result.problem.limits, result.kind == "exact"
    table = Table(box=None, pad_edge=False)
    table.add_column("")
    for heading in ("mean", "sd", "p50", "p95", "p99", "p99.9", "limit", "P(over)"):
        table.add_column(heading, justify="right")
    contact_duration = result.contact_duration
    first = verdict.transient
    rows: list[tuple[str, Distribution | None, float, list[float], float | None]] = [
        ("peak force, N", result.peak_force, 1, _limits(first, limits, "force_N"), verdict.p_over_force),
        ("pressure, N/cm²", result.pressure, 1, _limits(first, limits, "pressure_N_cm2"), verdict.p_over_pressure),
        ("deformation, mm", result.compression, 1, [], None),
        ("force at detection, N", result.force_at_detection, 1, [], None),
        ("detection delay, ms", result.detection_delay, 1e3, [], None),
        ("contact duration, ms", contact_duration, 1e3, [], None),
    ]
    for name, quantity, factor, allowed, over in rows:
        if quantity is None:
            continue
        figures = quantity.scaled(factor).to_json()
        # Short, or the table does not fit into 80 columns.
        nothing = "none" if math.isnan(quantity.mean) else "inf"
        cells = [
            nothing if value is None else _figure(value, *(allowed if key.startswith("p") else ()))
            for key, value in figures.items()
        ]
        limit = "/".join(as_written(one) for one in allowed)
        table.add_row(name, *cells, limit, "" if over is None else decimal(over, integrated=integrated))
    # Small figures are long: rather columns that are closer than names in two lines.
    table.collapse_padding = console.measure(table, options=console.options.update(width=1000)).maximum > console.width
    console.print(table)


def print_other_arm(other: CollisionOutcome, verdict: Verdict, console: Console) -> None:
    """Print what the same collision comes to with the other model of the arm."""
    force = other.peak_force
    quantiles = f"p50 {_figure(force.quantile(0.5))}, p99 {_figure(force.quantile(0.99))}"
    word = verdict.conclusion.replace("_", " ")
    judged = "" if verdict.conclusion == "no_limits" else f"; {word}"
    console.print(f"{other.scenario.arm.model} arm instead: peak force {quantiles} N{judged}")


def print_probabilities(result: CollisionOutcome, console: Console) -> None:
    """Print which joints detect, and how often an alarm is false or missing."""
    integrated = result.kind == "exact"
    if math.isinf(result.peak_force.mean):
        mean = finite_mean(result.peak_force)
        if not math.isnan(mean):
            console.print(f"mean peak force of the collisions that have a bound: {_figure(mean)} N")
    triggers = [
        f"{j} ({100 * p:.3g} %)"
        for j, p in sorted(enumerate(result.trigger_joint_probability, start=1), key=lambda item: -item[1])
        if p >= 0.0005
    ]
    console.print("triggered by joint " + ", ".join(triggers) if triggers else "triggered by no joint", end="")
    console.print(
        f"; false alarm before contact {decimal(result.false_alarm_probability, integrated=integrated)}; "
        f"never detected {decimal(result.undetected_probability, integrated=integrated)}"
    )
    console.print(alarm_rate(result.problem).words)


def _limits(first: ContactLimits | None, later: ContactLimits | None, name: str) -> list[float]:
    """A limit by the name of its field; of two phases both, that of the first before the other."""
    figures = [getattr(limits, name) for limits in (first, later) if limits is not None]
    return [figure for figure in figures if figure is not None]


def _figure(value: float, *limits: float) -> str:
    """Four significant digits and as many more as tell it from its limits.

    What is below a millionth in units of the table is rounding, and zero.
    """
    if abs(value) < MIN_PRINTED_NUMBER:
        return "0"
    return beside_limits((f"{value:.{digits}g}" for digits in range(4, 18)), value, limits)
