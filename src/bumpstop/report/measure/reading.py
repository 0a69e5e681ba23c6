"""The page of gauge recordings."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S
from bumpstop.report.document import Document, write_document
from bumpstop.report.markup import Html, bullets, element, paragraph, table
from bumpstop.report.picture import AREA, EVENT, FAINT, INK, LAW, Picture, axes
from bumpstop.report.print_style import print_style
from bumpstop.report.section import Part
from bumpstop.terminal import number

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from bumpstop.measure import GaugeReading

_MANY = 40  # recordings that are drawn


class ReadingsPart(Part):
    """Figures of all recordings."""

    title = "Peak forces"
    anchor = "peaks"

    def __init__(self, readings: Sequence[GaugeReading]) -> None:
        self._readings = readings

    def content(self) -> list[Html]:
        """One row for each recording."""
        headings = ("recording", "peak, N", "after, s", "left after 0.5 s, N", "pressure, N/cm²", "rate, Hz", "usable")
        rows = [
            (
                Path(each.curve.source).name,
                number(each.peak_N),
                f"{each.peak_time:.4f}",
                number(each.lasting_N),
                number(each.peak_pressure_N_cm2),
                number(each.rate_hz),
                "yes" if each.usable else "no",
            )
            for each in self._readings
        ]
        return [
            paragraph(
                f"The peak is the greatest force in the first {FIRST_PHASE_S:g} s of contact: the summit of the "
                "parabola through the highest sample and its neighbours. What is left is the greatest force after "
                "that, before another contact begins."
            ),
            table(headings, rows, caption="Recordings", numbers=True),
        ]


class FaultsPart(Part):
    """What is wrong with the recordings."""

    title = "Faults"
    anchor = "faults"

    def __init__(self, readings: Sequence[GaugeReading]) -> None:
        self._readings = readings

    def content(self) -> list[Html]:
        """By recording."""
        found: list[Html] = []
        for each in self._readings:
            if each.faults:
                sentences = [f"{fault.name} ({fault.count}): {fault.text}" for fault in each.faults]
                found += [element("h3", Path(each.curve.source).name), bullets(sentences)]
        return found or [paragraph("None was found.")]


class CurvesPart(Part):
    """Force over time of each recording."""

    title = "Force over time"
    anchor = "curves"

    def __init__(self, readings: Sequence[GaugeReading]) -> None:
        self._readings = readings

    def content(self) -> list[Html]:
        """How many are drawn."""
        more = len(self._readings) - _MANY
        return [paragraph(f"{more} more recordings are not drawn.")] if more > 0 else []

    def pictures(self) -> list[Picture]:
        """One for each recording."""
        return [self._picture(i, each) for i, each in enumerate(self._readings[:_MANY], start=1)]

    def _picture(self, index: int, reading: GaugeReading) -> Picture:
        curve, name = reading.curve, Path(reading.curve.source).name

        def draw(figure: Figure) -> None:
            panel = axes(figure)
            end = min(float(curve.time[-1]) - reading.onset, 2 * FIRST_PHASE_S)
            time = curve.time - reading.onset
            shown = (time > -0.05) & (time <= end)
            panel.axvspan(0, min(FIRST_PHASE_S, end), color=AREA, alpha=0.12, linewidth=0)
            panel.plot(time[shown], curve.force[shown], color=LAW, linewidth=1.2)
            panel.plot([reading.peak_time], [reading.peak_N], "D", color=INK, markersize=4)
            panel.axhline(0, color=FAINT, linewidth=0.8)
            if math.isfinite(reading.left_N):
                panel.hlines(reading.left_N, FIRST_PHASE_S, end, color=EVENT, linestyle="--", linewidth=1.4)
            panel.set_xlabel("time after the beginning of contact [s]")
            panel.set_ylabel("force [N]")
            panel.set_title(name)

        alt = f"Force over time of {name}: a peak of {number(reading.peak_N)} N."
        caption = f"{name}: shaded the first {FIRST_PHASE_S:g} s, diamond the peak, dashed the median of what is left."
        return Picture(f"recording_{index}", alt, caption, draw)


def write_readings(readings: Sequence[GaugeReading], folder: Path) -> Path:
    """Write ``report.html`` and its figures; returns the page's path.

    Raises:
        InputError: the folder cannot be written.
    """
    parts: list[Part] = [ReadingsPart(readings), FaultsPart(readings), CurvesPart(readings)]
    many = "1 recording" if len(readings) == 1 else f"{len(readings)} recordings"
    about = f"{many}, {sum(each.usable for each in readings)} usable"
    title = "Recordings of a gauge"
    style = print_style(f"{title}, {about}")
    document = Document(title, "bumpstop: measure", "bumpstop measure", parts, about, style)
    return write_document(document, folder)
