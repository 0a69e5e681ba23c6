"""The page of a parameter study."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.collision.probability_text import percent
from bumpstop.collision.verdict.finer_steps import fails_with_finer_steps
from bumpstop.report.markup import Html, element, paragraph, table
from bumpstop.report.picture import AREA, EVENT, FAINT, INK, LAW, LIMIT, Picture, axes
from bumpstop.report.section import Part
from bumpstop.study.answer_warnings import FAILS_WITH_FINER_STEPS
from bumpstop.study.parameters.fits import R2_WANTED, Fit, fit_models
from bumpstop.study.parameters.parameters import outside_words
from bumpstop.study.variable import ALIASES, per
from bumpstop.terminal import NONE, number

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.figure import Figure

    from bumpstop.collision import Scenario
    from bumpstop.study.parameters.parameters import ParameterStudy

# Why Schroeder's newtons are not ours, for whoever compares them.
_ABSOLUTE = (
    "Schroeder's absolute forces do not follow from its own published parameters: its charts have about 109 N at the "
    "control group, where its table 5.2 in its standard pose gives about 24 N. No single pose explains them: its slope "
    "over the threshold needs a moment arm of 0.14 m, its slope over the speed more force per second than stiffness "
    "times speed can give, and its 108 N at 50 mm/s disagrees with the 52 N it measured. Its relationships and their "
    "directions can be compared; its derivatives stand beside ours for the record."
)
_REACTION = (
    "On the way to stop the point travels as far as its speed squared over twice its deceleration. The peak force is "
    "therefore the force at detection, which no reaction can change, plus a part that falls with one over the joint "
    "acceleration. A power without a constant cannot say that over a wide range."
)


def pages_of(
    study: ParameterStudy, rows: pl.DataFrame, summary: dict[str, Any]
) -> tuple[str, list[Part], Sequence[str]]:
    """Title, parts and notes of the page."""
    parts: list[Part] = [SweepsPart(summary, rows), FitsPart(summary), DerivativesPart(summary)]
    if "equal_risk" in summary:
        parts.append(EqualRiskPart(summary["equal_risk"]))
    if "guide" in summary:
        parts.append(GuidePart(summary, study.scenario.verdict.accepted_probability))
    notes = [
        "One parameter is changed at a time, all others stay as in the scenario.",
        _model_note(study.scenario),
    ]
    return "What the peak force depends on", parts, notes


def _model_note(scenario: Scenario) -> str:
    """What the distributions behind all figures are."""
    if scenario.detector.residuals is None:
        return (
            "Every figure is of an integrated distribution: there is no sampling noise in curves, fits or derivatives."
        )
    from bumpstop.collision.evaluation import RESAMPLED_RUNS

    return (
        f"Measured residuals have no integrated distribution: every figure is of {RESAMPLED_RUNS} sampled "
        "collisions, drawn from the same seed each time. Curves, fits and derivatives have sampling noise; the "
        "relative errors below do not include all of it."
    )


class SweepsPart(Part):
    """Mean and spread of the peak force over each parameter."""

    title = "Peak force over each parameter"
    anchor = "sweeps"

    def __init__(self, summary: dict[str, Any], rows: pl.DataFrame) -> None:
        self._summary = summary
        self._rows = rows.filter(rows["kind"] == "sweep")

    def content(self) -> list[Html]:
        """The scenario's own force."""
        control = self._summary["control"]
        text = (
            f"The scenario as it is has a mean peak force of {number(control['mean_N'])} N with a standard deviation "
            f"of {number(control['sd_N'])} N. Points: mean; band: one standard deviation to either side; dashed line: "
            "the named model fitted to the means; green line: the scenario's own value."
        )
        lowest = [each["key"] for each in self._summary["parameters"] if each["key"].startswith("detector.thresholds")]
        told = [paragraph(f"{key}: {ALIASES[key][1]}.") for key in lowest if key in ALIASES]
        unbounded = [each["key"] for each in self._summary["parameters"] if each["without_mean"]]
        more = [paragraph(f"Values without a mean, as some collisions are never detected: {', '.join(unbounded)}.")]
        outside = [
            paragraph(f"{words[0].upper()}{words[1:]}.")
            for words in map(outside_words, self._summary["parameters"])
            if words
        ]
        return [paragraph(text), *told, *outside, *(more if unbounded else [])]

    def pictures(self) -> list[Picture]:
        """One for each parameter."""
        return [self._picture(each, number) for number, each in enumerate(self._summary["parameters"], start=1)]

    def _picture(self, each: dict[str, Any], order: int) -> Picture:
        own = self._rows.filter(self._rows["key"] == each["key"])
        x, mean, sd = (own[name].to_numpy() for name in ("value", "mean_N", "sd_N"))
        name = each.get("better_law") or each.get("source_law")
        known = np.isfinite(mean)
        fit = next((fit for fit in _fits(x[known], mean[known]) if fit.name == name), None)
        label = each["key"] + (f" [{each['unit']}]" if each["unit"] else "")

        def draw(figure: Figure) -> None:
            panel = axes(figure)
            panel.fill_between(x, mean - sd, mean + sd, color=AREA, alpha=0.35, linewidth=0)
            if fit is not None:
                panel.plot(x[known], fit.fitted, color=FAINT, linestyle="--", linewidth=1.2)
            panel.plot(x, mean, "o", color=LAW, markersize=3.5)
            if each["low"] <= each["control"] <= each["high"]:
                panel.axvline(each["control"], color=EVENT, linewidth=1.2)
            panel.set_xlabel(label)
            panel.set_ylabel("peak force [N]")
            panel.set_ylim(bottom=0)
            panel.set_title(f"{fit.name}, R2 {fit.r2:.4f}" if fit else "no fit")

        return Picture(
            f"parameter_{order}",
            f"Mean peak force over {each['key']}, going {each['direction']}, with its standard deviation.",
            f"Peak force over {label}: it goes {each['direction']}." + (f" Fit: {fit.formula}." if fit else ""),
            draw,
        )


def _fits(x: Any, y: Any) -> list[Fit]:
    return fit_models(x, y) if x.size >= 3 else []


class FitsPart(Part):
    """How well each model fits, and which one Schroeder (2013) named."""

    title = "Which model each dependence follows"
    anchor = "fits"

    def __init__(self, summary: dict[str, Any]) -> None:
        self._parameters = summary["parameters"]

    def content(self) -> list[Html]:
        """One table, and why a model of Schroeder (2013) is not enough."""
        names = ("linear", "quadratic", "power", "constant plus power")
        rows = []
        for each in self._parameters:
            r2 = {fit["name"]: fit["r2"] for fit in each["fits"]}
            formula = {fit["name"]: fit["formula"] for fit in each["fits"]}
            named = each.get("source_law")
            best = each.get("better_law") or named
            cells = []
            for name in names:
                text = f"{r2[name]:.5f}" if name in r2 and math.isfinite(r2[name]) else NONE
                cells.append(element("strong", text) if name == best else text)
            rows.append([each["key"], named or "not studied", *cells, f"{best}: {formula[best]}" if best else NONE])
        found = [
            paragraph(
                "R2 is the share of the variance of the means that a model explains. A model of Schroeder (2013) "
                f"stands where it explains at least {R2_WANTED:g}; where it does not, or none is named, the best is."
            ),
            table(
                ["parameter", "Schroeder (2013)", *names, "taken"],
                rows,
                caption="R2 of four models (Schroeder's table 5.3)",
                numbers=True,
            ),
        ]
        weak = [each for each in self._parameters if each.get("source_law") and each.get("better_law")]
        found += [
            paragraph(
                f"{each['key']}: Schroeder's {each['source_law']} model falls short; {each['better_law']} is better."
            )
            for each in weak
        ]
        if any(each["key"].startswith("reaction.joint_acceleration") for each in weak):
            found.append(paragraph(_REACTION))
        return found


class DerivativesPart(Part):
    """What a small change is worth."""

    title = "What a small change is worth"
    anchor = "derivatives"

    def __init__(self, summary: dict[str, Any]) -> None:
        self._parameters = summary["parameters"]

    def content(self) -> list[Html]:
        """One table (5.4), and why Schroeder's figures differ."""
        rows = []
        for each in self._parameters:
            slope = each["derivative"]
            how = "whole steps" if slope["quantised"] else f"relative error {_relative(slope)}"
            source = each.get("source_derivative")
            unit = per("N", each["unit"])
            rows.append(
                [each["key"], number(each["control"]), _signed(slope["mean"]), _signed(slope["sd"]), unit,
                 _signed(slope["elasticity"]), how, NONE if source is None else _signed(source)]
            )  # fmt: skip
        headings = ["parameter", "at", "d mean / dx", "d sd / dx", "unit", "% per %", "how", "Schroeder (2013)"]
        found = [
            paragraph(
                "Differences of distributions on either side of the scenario's own value. Where a key only takes whole "
                "steps, the difference is across whole steps: between them nothing changes."
            ),
            table(headings, rows, caption="Derivatives at its own values (Schroeder's table 5.4)", numbers=True),
        ]
        if any("source_derivative" in each for each in self._parameters):
            found.append(paragraph(_ABSOLUTE))
        return found


def _relative(slope: dict[str, Any]) -> str:
    if not (slope["mean"] and math.isfinite(slope["error"])):
        return "unknown"
    return f"{abs(slope['error'] / slope['mean']):.1g}"


def _signed(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else NONE


class EqualRiskPart(Part):
    """Pairs of values that just meet the limits."""

    title = "Curves of equal risk"
    anchor = "equal-risk"

    def __init__(self, pairs: Sequence[dict[str, Any]]) -> None:
        self._pairs = pairs

    def content(self) -> list[Html]:
        """How to read them."""
        return [
            paragraph(
                "Along each curve the probability of exceeding a limit of the body is the same. The more conservative "
                "side is that of the curves of smaller probability. The cross is the scenario."
            )
        ]

    def pictures(self) -> list[Picture]:
        """One for each pair."""
        return [self._picture(pair, order) for order, pair in enumerate(self._pairs, start=1)]

    def _picture(self, pair: dict[str, Any], order: int) -> Picture:
        styles = ((LIMIT, "-"), (LAW, "--"), (EVENT, "-."), (INK, ":"))

        def draw(figure: Figure) -> None:
            panel = axes(figure, left=0.85, right=0.25)
            for curve, (color, style) in zip(pair["curves"], styles, strict=True):
                label = f"{percent(curve['risk'])}" + ("" if curve["lines"] else " (not in this range)")
                for line in curve["lines"] or [[[math.nan, math.nan]]]:
                    points = np.array(line)
                    panel.plot(points[:, 0], points[:, 1], color=color, linestyle=style, label=label)
                    label = "_"
            # The scenario may lie on the rim, where its cross would be cut in half.
            panel.plot(*pair["controls"], "x", color=INK, markersize=7, markeredgewidth=2, clip_on=False)
            (x0, x1), (y0, y1) = pair["ends"]
            panel.set_xlim(min(x0, pair["controls"][0]), max(x1, pair["controls"][0]))
            panel.set_ylim(min(y0, pair["controls"][1]), max(y1, pair["controls"][1]))
            panel.set_xlabel(pair["labels"][0])
            panel.set_ylabel(pair["labels"][1])
            panel.legend(title="P(over a limit)")

        keys = " and ".join(pair["keys"])
        return Picture(
            f"equal_risk_{order}",
            f"Curves of equal probability of exceeding a limit over {keys}.",
            f"Pairs of {keys} with the same probability of exceeding a limit of the body.",
            draw,
        )


class GuidePart(Part):
    """The cheapest way to meet the limits."""

    title = "The cheapest way to meet the limits"
    anchor = "guide"

    def __init__(self, summary: dict[str, Any], risk: float) -> None:
        self._guide = summary["guide"]
        self._risk = risk

    def content(self) -> list[Html]:
        """One table of plans."""
        guide = self._guide
        now = guide["now"]
        ratio = f"{now['force_over_allowed']:.4g}"
        found = [
            paragraph(
                f"The force that is exceeded with the accepted probability of {percent(self._risk)} is {ratio} "
                "times what force and pressure limit allow. Every plan below was checked by its own distribution."
            )
        ]
        if guide["reason"]:
            found.append(paragraph(guide["reason"]))
        keys = list(now["values"])
        rows = [["as it is", *(f"{now['values'][key]:.10g}" for key in keys), "0", ratio]]
        for name, plan in guide["single_change"].items():
            rows.append(self._row(f"{name} alone", plan, keys))
        if guide["single_change"]:
            rows.append(self._row("together, cheapest", guide["combined"], keys))
        found.append(
            table(["plan", *keys, "cost", "force over allowed"], rows, caption="Ways to meet the limits", numbers=True)
        )
        return found

    def _row(self, name: str, plan: dict[str, Any] | None, keys: Sequence[str]) -> list[str]:
        if plan is None:
            return [name, *[NONE for _ in keys], "not in its range", NONE]
        values = [f"{plan['values'][key]:.10g}" for key in keys]
        but = f", but {FAILS_WITH_FINER_STEPS}" if fails_with_finer_steps(plan["warnings"]) else ""
        return [name, *values, f"{plan['cost']:.4g}", f"{plan['force_over_allowed']:.4f}{but}"]
