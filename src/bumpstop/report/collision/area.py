"""What force the limits allow on which area, as in Schroeder's figure 6.1."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.report.formatting import quantity
from bumpstop.report.markup import Html, paragraph
from bumpstop.report.picture import EVENT, FAINT, INK, LAW, LIMIT, PAPER, Picture, axes, spread
from bumpstop.report.section import Section
from bumpstop.terminal import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bumpstop.contact import ContactLimits


class AreaSection(Section):
    """Force and pressure limits over the contact area, with this collision among them."""

    title = "Limits over contact area"
    anchor = "limits-over-area"

    def applies(self) -> bool:
        """Without a body region there is no limit."""
        return self.result.problem.limits is not None

    @property
    def _limits(self) -> ContactLimits:
        assert self.result.problem.limits is not None
        return self.result.problem.limits

    @property
    def _crossing(self) -> float | None:
        """Area at which both limits allow the same force, uneven pressure included [cm²]."""
        crossing = self._limits.crossing_area_cm2
        return None if crossing is None else crossing * self.result.scenario.contact.peak_factor

    def content(self) -> list[Html]:
        """Which limit governs, and from which area on the other does."""
        limits, contact = self._limits, self.result.scenario.contact
        if not limits.permitted:
            return [paragraph(limits.reason)]
        area, crossing = contact.area_cm2, self._crossing
        if crossing is None:
            return [
                paragraph(
                    f"The table has no pressure limit for {limits.label}: {quantity(limits.force_N, 'N')} hold on "
                    "every area, and nothing guards against a small, hard edge."
                )
            ]
        allowed = limits.allowed_force_N(area, contact.peak_factor)
        found = [
            paragraph(
                f"On a small area the pressure limit allows little force; from {number(crossing)} cm² on the force "
                f"limit governs. On the {area:g} cm² of this scenario {quantity(allowed, 'N')} are allowed."
            )
        ]
        if self.result.problem.transient_limits is not None:
            found.append(paragraph("These are the limits after the first phase of contact, in which others hold."))
        return found

    def pictures(self) -> list[Picture]:
        """One figure, where any contact is permitted at all."""
        if not self._limits.permitted:
            return []
        contact = self.result.scenario.contact
        allowed = self._limits.allowed_force_N(contact.area_cm2, contact.peak_factor)
        median, high = (quantity(self.result.peak_force.quantile(p), "N") for p in (0.5, 0.99))
        crossing = "" if self._crossing is None else f" The limits cross at {number(self._crossing)} cm²."
        return [
            Picture(
                "limits_over_area",
                f"Allowed force over contact area for {self._limits.label}.{crossing} On {contact.area_cm2:g} cm² "
                f"{number(allowed)} N are allowed; this collision's median is {median}, its p99 {high}.",
                f"Allowed force for {self._limits.label} ({self._limits.table}). Unhatched: both limits are kept. "
                "Horizontal lines: this collision.",
                self._draw,
                height=3.4,
            )
        ]

    def _draw(self, figure: Figure) -> None:
        limits, contact, crossing = self._limits, self.result.scenario.contact, self._crossing
        area = contact.area_cm2
        panel = axes(figure, right=1.12, top=0.34)
        panel.set_title(f"{limits.label}: allowed force")
        right = max(2.0 * area, 1.6 * (crossing or 0.0))
        x = np.linspace(right / 400, right, 400)
        allowed = np.array([limits.allowed_force_N(float(a), contact.peak_factor) for a in x])
        lines: list[tuple[float, str, dict[str, Any]]] = [
            (limits.force_N, f"force limit\n{number(limits.force_N)} N", {"color": LIMIT, "linestyle": "--"})
        ]
        top = 1.3 * limits.force_N
        for p, style in ((0.5, "-"), (0.99, "-.")):
            value = self.result.peak_force.quantile(p)
            if value < 3 * limits.force_N:
                top = max(top, 1.15 * value)
                lines.append((value, f"p{100 * p:g} {number(value)} N", {"color": LAW, "linestyle": style}))
            else:
                lines.append((math.inf, f"p{100 * p:g} ↑\n{quantity(value, 'N')}", {"color": LAW}))
        panel.set_xlim(0, right)
        panel.set_ylim(0, top)
        panel.fill_between(x, allowed, top, facecolor="none", edgecolor=LIMIT, alpha=0.5, hatch="///", linewidth=0)
        if limits.pressure_N_cm2 is not None:
            slope = limits.pressure_N_cm2 / contact.peak_factor
            panel.plot(x, slope * x, color=LIMIT, linestyle=(0, (2, 1.2)), linewidth=1.5)
        panel.plot(x, allowed, color=LIMIT, linewidth=2.4)
        _label_lines(panel, lines, right, top)
        self._mark_areas(panel, top, right)
        panel.set_xlabel("contact area [cm²]")
        panel.set_ylabel("force [N]")

    def _mark_areas(self, panel: Axes, top: float, right: float) -> None:
        """The scenario's area with its p99, and the area where the limits cross."""
        limits, contact, crossing = self._limits, self.result.scenario.contact, self._crossing
        area, high = contact.area_cm2, self.result.peak_force.quantile(0.99)
        panel.axvline(area, color=EVENT, linewidth=1.4)
        if high <= top:
            panel.plot(area, high, marker="D", markersize=6, color=INK, markeredgecolor="white", zorder=5)
        _note(panel, (area, 0.0), f"this contact {area:g} cm²", EVENT, left=area > 0.55 * right, up=5)
        if crossing is not None:
            panel.plot(
                crossing, limits.force_N, marker="o", markersize=7, color=LIMIT, markeredgecolor="white", zorder=5
            )
            panel.vlines(crossing, 0, limits.force_N, color=FAINT, linestyle=":", linewidth=1.2)
            _note(panel, (crossing, limits.force_N), f"crossing {number(crossing)} cm²", INK, left=False, up=-15)


def _note(panel: Axes, place: tuple[float, float], text: str, colour: str, *, left: bool, up: float) -> None:
    """A word beside a place, on paper of its own."""
    panel.annotate(
        text, place, (-5 if left else 5, up), textcoords="offset points", ha="right" if left else "left", fontsize=8.5,
        color=colour, bbox=PAPER,
    )  # fmt: skip


def _label_lines(panel: Axes, lines: list[tuple[float, str, dict[str, Any]]], right: float, top: float) -> None:
    """Draw horizontal lines and write their names in the margin, moved apart where they are close."""
    heights = spread([min(value, top) for value, *_ in lines], 0.13 * top, 0.03 * top, 0.98 * top)
    for (value, text, style), height in zip(lines, heights, strict=True):
        if math.isfinite(value):
            panel.axhline(value, linewidth=1.5, **style)
        leader = {"arrowstyle": "-", "color": style["color"], "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0}
        panel.annotate(
            text, (right, min(value, top)), (right * 1.045, height), va="center", ha="left", fontsize=8.5,
            color=style["color"], annotation_clip=False, arrowprops=leader if math.isfinite(value) else None,
        )  # fmt: skip
