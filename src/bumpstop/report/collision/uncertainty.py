"""How sure the verdict is: cases of the inputs, what matters most, and the band of the exceedance curve."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.probability_text import percent, use_percent
from bumpstop.report.markup import Html, bullets, element, paragraph, table
from bumpstop.report.picture import AREA, EVENT, FAINT, INK, LAW, LIMIT, PAPER, Picture, axes
from bumpstop.report.section import Section
from bumpstop.terminal import number
from bumpstop.uncertainty.point_evaluation import LEVELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bumpstop.collision import CollisionResult
    from bumpstop.uncertainty import TornadoBar, UncertainResult

# Bars of the tornado; what moves less than the rest is in the table.
_BARS = 12


class UncertaintySection(Section):
    """The verdict's interval over the uncertain inputs."""

    title = "How sure"
    anchor = "how-sure"

    def __init__(self, result: CollisionResult, uncertain: UncertainResult | None) -> None:
        super().__init__(result)
        self._uncertain = uncertain

    def applies(self) -> bool:
        """Only where the scenario says how well its numbers are known."""
        return self._uncertain is not None

    @property
    def _found(self) -> UncertainResult:
        assert self._uncertain is not None
        return self._uncertain

    @property
    def _judged(self) -> bool:
        return self._found.conclusion != "no_limits"

    def content(self) -> list[Html]:
        """What the cases mean, their figures, and the inputs."""
        found = self._found
        sure = f"{100 * found.confidence:g} %"
        meaning = (
            "The central case has every input at its median, and what is assumed at the value given. "
            f"The {sure} case is not passed by {sure} of the inputs that have a distribution. The worst admissible "
            "case is the same with what is assumed at its worst value. "
        )
        if self._judged:
            meaning += (
                f"Over all inputs that have a distribution the mean probability is {self._percent(found.mean_p_over)}. "
                "Each probability is that of exceeding a limit in one contact; it is not the risk of ISO 12100."
            )
        notes = [bullets(found.notes)] if found.notes else []
        return [paragraph(meaning), self._cases(), self._inputs(), *notes]

    def _cases(self) -> Html:
        found = self._found
        names = {
            "central": "central",
            "confident": f"{100 * found.confidence:g} % of the inputs",
            "worst": "worst admissible",
        }
        rows = []
        for case in found.cases:
            over = self._percent(case.p_over) if self._judged else "no limit"
            rows.append(
                (
                    names[case.name],
                    over,
                    self._used(case.utilisation),
                    self._percent(case.false_alarm),
                )
            )
        used = "Force exceeded with the accepted probability" + (", of the limit" if self._judged else " [N]")
        return table(
            ("Case", "Over a limit in one contact", used, "False alarm"),
            rows,
            caption="The verdict's interval",
            numbers=True,
        )

    def _inputs(self) -> Html:
        rows = [
            (
                element("code", bar.key),
                f"{number(bar.low)} to {number(bar.high)}" + (" times" if bar.relative else ""),
                "assumed" if bar.assumed else "distribution",
                f"{self._used(bar.utilisation_low)} to {self._used(bar.utilisation_high)}",
            )
            for bar in self._found.tornado
        ]
        headings = ("Input", "from, to", "known by", "of the limit" if self._judged else "force [N]")
        return table(headings, rows, caption="What matters most, one input at a time")

    def _used(self, value: float) -> str:
        if math.isinf(value):
            return "unbounded"
        return use_percent(value) if self._judged else number(value)

    def pictures(self) -> list[Picture]:
        """The tornado, and the band."""
        found = self._found
        bars = found.tornado[:_BARS]
        moves = "; ".join(
            f"{bar.key} {self._used(bar.utilisation_low)} to {self._used(bar.utilisation_high)}" for bar in bars
        )
        what = "share of the limit" if self._judged else "force"
        pictures = []
        if any(np.isfinite([bar.utilisation_low, bar.utilisation_high]).all() for bar in bars):
            pictures.append(
                Picture(
                    "tornado",
                    f"Tornado chart of the {what} that each input moves by itself: {moves}.",
                    "One input at a time from end to end, the others central. Hatched: assumed.",
                    self._draw_tornado,
                    height=1.0 + 0.34 * len(bars),
                )
            )
        if np.isfinite(found.force_band[:, LEVELS >= 0.1]).all():
            sure = f"{100 * (1 - found.confidence):g} % to {100 * found.confidence:g} %"
            pictures.append(
                Picture(
                    "exceedance_band",
                    f"Probability of exceeding a peak force: the median and the band of {sure} of the inputs.",
                    f"Band: {sure} of the inputs that have a distribution. Line: the central case.",
                    self._draw_band,
                    height=3.2,
                )
            )
        return pictures

    def _draw_tornado(self, figure: Figure) -> None:
        bars = [bar for bar in self._found.tornado[:_BARS] if np.isfinite(bar.utilisation_low + bar.utilisation_high)]
        panel = axes(figure, left=2.05, right=0.25, bottom=0.5, top=0.2)
        scale = 100.0 if self._judged else 1.0
        central = scale * self._found.case("central").utilisation
        for place, bar in enumerate(bars):
            _draw_bar(panel, place, bar, scale)
        panel.set_yticks(range(len(bars)), [_short(bar) for bar in bars], fontsize=7.5)
        panel.set_ylim(len(bars) - 0.4, -0.6)
        panel.margins(x=0.06)
        if math.isfinite(central):
            panel.axvline(central, color=INK, linewidth=1.0)
        if self._judged:
            panel.axvline(100.0, color=LIMIT, linestyle="--", linewidth=1.5)
        panel.set_xlabel("force used of the limit [%]" if self._judged else "peak force [N]")

    def _draw_band(self, figure: Figure) -> None:
        found, panel = self._found, axes(figure, left=0.95, bottom=0.5, top=0.2)
        low, _, high = found.force_band
        shown = np.isfinite(high) & np.isfinite(low)
        panel.fill_betweenx(LEVELS[shown], low[shown], high[shown], color=AREA, alpha=0.45, linewidth=0)
        for edge in (low, high):
            panel.plot(edge[shown], LEVELS[shown], color=LAW, linewidth=0.8)
        central = np.array([self.result.peak_force.quantile(1 - level) for level in LEVELS])
        kept = np.isfinite(central)
        panel.plot(central[kept], LEVELS[kept], color=LAW, linewidth=1.8)
        accepted = self.result.scenario.verdict.accepted_probability
        panel.axhline(accepted, color=FAINT, linestyle=":", linewidth=1.2)
        panel.set_yscale("log")
        panel.set_ylim(LEVELS[-1], 1.0)
        limits, contact = self.result.problem.limits, self.result.scenario.contact
        if limits is not None and limits.permitted:
            allowed = limits.allowed_force_N(contact.area_cm2, contact.peak_factor)
            panel.axvline(allowed, color=LIMIT, linestyle="--", linewidth=1.5)
            # On the side that has room.
            right = allowed < sum(panel.get_xlim()) / 2
            panel.annotate(
                f"limit {number(allowed)} N", (allowed, 1.0), (4 if right else -4, -12), color=LIMIT, fontsize=8.5,
                xycoords=("data", "axes fraction"), textcoords="offset points", ha="left" if right else "right",
                bbox=PAPER,
            )  # fmt: skip
        panel.annotate(
            "accepted", (0.0, accepted), (3, 3), xycoords=("axes fraction", "data"), textcoords="offset points",
            color=INK, fontsize=8.5,
        )  # fmt: skip
        panel.yaxis.set_major_formatter(lambda value, _: percent(value))
        panel.yaxis.set_tick_params(labelsize=7.5)
        panel.set_xlabel("peak force [N]")
        panel.set_ylabel("probability of exceeding")
        panel.yaxis.set_label_coords(-0.19, 0.5)


def _draw_bar(panel: Axes, place: int, bar: TornadoBar, scale: float) -> None:
    """From the low end of the input to its high end: the high end is marked."""
    low, high = scale * bar.utilisation_low, scale * bar.utilisation_high
    hatch = "///" if bar.assumed else None
    panel.barh(place, high - low, left=low, height=0.62, facecolor=AREA, edgecolor=LAW, hatch=hatch, linewidth=0.8)
    panel.plot(high, place, marker="|", markersize=11, color=EVENT, markeredgewidth=2.0)


def _short(bar: TornadoBar) -> str:
    """Key and range in two lines."""
    return f"{bar.key}\n{number(bar.low)} to {number(bar.high)}{' times' if bar.relative else ''}"
