"""How the peak force is distributed, and where the limits stand in it."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.collision.distribution.distribution import QUANTILES
from bumpstop.collision.probability_text import accepted_percent, percent
from bumpstop.report.collision.bins import bins, why_no_figure
from bumpstop.report.formatting import percentile, quantity
from bumpstop.report.markup import Html, paragraph
from bumpstop.report.picture import AREA, EVENT, FAINT, INK, LAW, LIMIT, PAPER, Picture, scale_by, stack
from bumpstop.report.section import Section
from bumpstop.terminal import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bumpstop.collision import Distribution

# The least probability shown: beyond it the model's tails say nothing about an arm.
_MIN_PROBABILITY = 1e-6


class DistributionSection(Section):
    """Density and exceedance of the peak force; pressure is the same curve on another scale."""

    title = "Peak force and pressure"
    anchor = "distribution"

    def content(self) -> list[Html]:
        """How to read the figure, and what lies outside it."""
        result, contact = self.result, self.result.scenario.contact
        if not self._edges.size:
            return [paragraph(f"There is no figure: {why_no_figure(result)}.")]
        meets = "where this curve meets a limit stands the probability of exceeding it"
        if result.problem.transient_limits is not None:
            meets = "a force that is gone in time may exceed the limit that holds later, but not the one at first"
        uneven = f" times the peak factor {contact.peak_factor:g}" if contact.peak_factor != 1 else ""
        text = [
            paragraph(
                "Upper panel: how often which peak force occurs. Lower panel: the probability that the peak is higher "
                f"than the force on the axis; {meets}. Pressure is force over {contact.area_cm2:g} cm²{uneven}, so its "
                "scale runs along the top."
            )
        ]
        zero_force = 1 - result.peak_force.exceedance(0.0)
        if zero_force > 1e-4:
            why = [
                cause
                for cause, share in (
                    ("an alarm stops it before the body", result.false_alarm_probability),
                    (f"the motion ends before contact{result.why_no_contact()}", result.no_contact_probability),
                )
                if share > _MIN_PROBABILITY
            ]
            text.append(
                paragraph(
                    f"In {percent(zero_force)} of cases the arm does not press at all"
                    + (f", as {' or '.join(why)}" if why else "")
                    + ". The upper panel leaves them out."
                )
            )
        if result.undetected_probability > _MIN_PROBABILITY and result.unbounded_because is not None:
            text.append(
                paragraph(
                    f"{self._percent(result.undetected_probability)} of collisions are not detected "
                    f"{result.unbounded_because} and count as beyond every force: the lower curve stays above that."
                )
            )
        return text

    def pictures(self) -> list[Picture]:
        """The figure, unless too few collisions have a bounded force."""
        if not self._edges.size:
            return []
        result = self.result
        marks = ", ".join(
            f"{percentile(name)} {quantity(result.peak_force.quantile(p), 'N')}" for name, p in QUANTILES.items()
        )
        limits = "; ".join(f"{name} at {number(force)} N" for name, force in self._limits) or "no limits"
        return [
            Picture(
                "peak_force",
                f"Density of the peak force above of exceeding it below. {marks}; {limits}.",
                f"Quantiles: {marks}. Dashed: limits.",
                self._draw,
                height=4.4,
            )
        ]

    @property
    def _limits(self) -> list[tuple[str, float]]:
        """Limits as peak forces [N], lowest first."""
        limits, first, contact = (
            self.result.problem.limits,
            self.result.problem.transient_limits,
            self.result.scenario.contact,
        )
        if limits is None:
            return []
        if not limits.permitted or (first is not None and not first.permitted):
            return [("no contact permitted:", 0.0)]
        if first is not None:
            allowed = [(phase.allowed_force_N(contact.area_cm2, contact.peak_factor)) for phase in (limits, first)]
            return list(zip(("limit later", "limit at first"), allowed, strict=True))
        found = [("force limit", limits.force_N)]
        if limits.pressure_N_cm2 is not None:
            found.append(("pressure limit", limits.pressure_N_cm2 / self._pressure_per_newton))
        return sorted(found, key=lambda limit: limit[1])

    @property
    def _pressure_per_newton(self) -> float:
        contact = self.result.scenario.contact
        return contact.peak_factor / contact.area_cm2

    @cached_property
    def _edges(self) -> FloatArray:
        """Edges of the density's bins [N]; empty where too few collisions have a force with a bound."""
        return bins(self.result.peak_force, self.result.samples)

    def _draw(self, figure: Figure) -> None:
        density, exceedance = stack(figure, [1.0, 1.25], left=1.0, right=0.2, bottom=0.5, top=0.62, gap=0.14)
        for panel in (density, exceedance):
            panel.yaxis.set_label_coords(-0.21, 0.5)
        low, high = self._range()
        exceedance.set_xlim(low, high)
        exceedance.set_xlabel("peak force [N]")
        top = density.secondary_xaxis("top", functions=scale_by(self._pressure_per_newton))
        top.set_xlabel("peak pressure [N/cm²]")
        draw_density(density, self.result.peak_force, self._edges)
        density.set_ylabel("density [1/N]")
        self._draw_exceedance(exceedance, low, high)
        self._draw_limits(density, exceedance, low, high)

    def _range(self) -> tuple[float, float]:
        """From zero, unless that wastes the width; to the limits, unless they are far away."""
        low, high = float(self._edges[0]), float(self._edges[-1])
        reach = [force for _, force in self._limits if force < 2.5 * high]
        high = max([high, *reach])
        low = 0.0 if low < 0.6 * high else low - 0.1 * (high - low)
        low = min([low, *(0.85 * force for _, force in self._limits)])
        return low, high + 0.08 * (high - low)

    def _draw_exceedance(self, panel: Axes, low: float, high: float) -> None:
        force = self.result.peak_force
        least = (
            _MIN_PROBABILITY if self.result.kind == "exact" else max(_MIN_PROBABILITY, 0.3 / (self.result.samples or 1))
        )
        x = np.linspace(low, high, 401)
        # Summed from the far end, where the terms are smallest, so that the tail keeps its digits.
        beyond = np.append(force.density(x) * np.diff(x), force.exceedance(high))
        y = np.cumsum(beyond[::-1])[::-1]
        panel.plot(x, np.maximum(y, 0.01 * least), color=LAW)
        panel.set_yscale("log")
        panel.set_ylim(least, 2.5)
        decades = int(-math.floor(math.log10(least)))
        ticks = [10.0**-d for d in range(0, decades + 1, 1 if decades < 4 else 2) if 10.0**-d >= least]
        panel.set_yticks(ticks, [f"{100 * t:g} %" for t in ticks])
        panel.minorticks_off()
        panel.set_ylabel("P(peak is higher)")
        risk = self.result.scenario.verdict.accepted_probability
        if risk > least:
            panel.axhline(risk, color=FAINT, linestyle=":", linewidth=1.4)
            panel.annotate(
                f"accepted {accepted_percent(risk)}", (0, risk), (4, 3), xycoords=panel.get_yaxis_transform(),
                textcoords="offset points", color=INK, fontsize=8.5, bbox=PAPER,
            )  # fmt: skip
        for name, p in QUANTILES.items():
            value = force.quantile(p)
            if not low <= value <= high or 1 - p < least:
                continue
            panel.plot(value, 1 - p, marker="o", markersize=5, color=LAW, markeredgecolor="white")
            # The curve falls: above it on the right and below it on the left there is room.
            left = value > low + 0.6 * (high - low)
            # At the foot of the panel the numbers of the scale are below.
            below = left and 1 - p > 2 * least
            panel.annotate(
                f"{percentile(name)} {number(value)} N",
                (value, 1 - p),
                (-6 if left else 6, -1 if below else 1),
                textcoords="offset points",
                ha="right" if left else "left",
                va="top" if below else "bottom",
                fontsize=8.5,
                bbox=PAPER,
            )

    def _draw_limits(self, density: Axes, exceedance: Axes, low: float, high: float) -> None:
        seen = [(name, force) for name, force in self._limits if force <= high]
        # Of two phases the force beyond the first one's limit is too much whenever it comes.
        beyond = seen[1:] if self.result.problem.transient_limits is not None and len(self._limits) > 1 else seen
        if beyond:
            density.axvspan(beyond[0][1], high, facecolor="none", edgecolor=LIMIT, alpha=0.6, hatch="///", linewidth=0)
        # The lowest limit has the lowest label and ends there, so that no line runs through the other's label.
        for row, (name, force) in enumerate(reversed(self._limits)):
            style = "--" if name.startswith("force") else (0, (2, 1.2))
            text = f"{name} {number(force)} N"
            height = 0.97 - 0.13 * row
            label: dict[str, Any] = {
                "xycoords": density.get_xaxis_transform(), "textcoords": "offset points", "va": "top", "color": LIMIT,
                "fontsize": 8.5, "bbox": PAPER,
            }  # fmt: skip
            if force > high:
                density.annotate(f"{text} →", (high, height), (-2, 0), ha="right", **label)
                continue
            for panel, end in ((density, height), (exceedance, 1.0)):
                panel.axvline(force, ymax=end, color=LIMIT, linestyle=style, linewidth=1.5)
            left = force > (low + high) / 2
            density.annotate(text, (force, height), (-5 if left else 5, 0), ha="right" if left else "left", **label)


def draw_density(panel: Axes, distribution: Distribution, edges: FloatArray) -> None:
    """Fill a panel with a density, median and p99 marked; head room for labels is left above it."""
    height = distribution.density(edges)
    panel.stairs(height, edges, fill=True, color=AREA, alpha=0.45, linewidth=0)
    panel.stairs(height, edges, color=LAW, linewidth=1.3)
    panel.set_ylim(0, 1.75 * max(float(height.max()), 1e-300))
    panel.locator_params(axis="y", nbins=4)
    # The two labels stand on the outer sides of their lines, so that they never meet.
    near_edge = edges[0] + 0.12 * (edges[-1] - edges[0])
    for p, style in ((0.5, "-"), (0.99, "-.")):
        value = distribution.quantile(p)
        side, shift = ("right", -3) if p == 0.5 and value > near_edge else ("left", 3)
        if math.isfinite(value):
            panel.axvline(value, ymax=0.61, color=EVENT, linestyle=style, linewidth=1.3)
            panel.annotate(
                f"p{100 * p:g}", (value, 0.58), (shift, 0), xycoords=panel.get_xaxis_transform(),
                textcoords="offset points", ha=side, va="bottom", color=EVENT, fontsize=8.5,
            )  # fmt: skip
