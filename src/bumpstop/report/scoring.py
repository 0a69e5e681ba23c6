"""Report of ``bumpstop score``: what was detected, how late, and what a factor on the thresholds would do."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.report.document import Document, write_document
from bumpstop.report.markup import Html, paragraph, table
from bumpstop.report.picture import EVENT, INK, LAW, LIMIT, Picture, axes, plain_ticks, stack
from bumpstop.report.section import Part
from bumpstop.report.words import number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bumpstop.detection import Roc, Score


def write_scoring(score: Score, roc: Roc | None, folder: Path) -> Path:
    """Write report.html and figures.

    Args:
        score: events against labels.
        roc: the same at other thresholds, where residuals were given.
        folder: made where it is missing.
    """
    parts: list[Part] = [DetectionsPart(score)]
    if roc is not None:
        parts.append(RocPart(roc))
    title = f"{score.detected} of {len(score.labels)} contacts detected"
    return write_document(Document(title, "bumpstop scores", "scoring", parts), folder)


class DetectionsPart(Part):
    """Contacts with their delays, and false alarms."""

    title = "Detections"
    anchor = "detections"

    def __init__(self, score: Score) -> None:
        self.score = score

    def content(self) -> list[Html]:
        """Counts, and every contact."""
        score = self.score
        low, high = score.false_alarms_per_hour_interval()
        rows = [
            (f"{label.start_s:.6g} s", label.kind or "-", _delay(late), "blind" if dark else "")
            for label, late, dark in zip(score.labels, score.delay_s, score.blind, strict=True)
        ]
        return [
            paragraph(
                f"{score.detected} detected, {score.missed} missed, {score.false_alarms.size} false alarms in "
                f"{number(score.hours)} h without contact: {number(score.false_alarms_per_hour)} an hour, with 95 % "
                f"confidence between {number(low)} and {number(high)}. Blind for {number(score.blind_s)} s."
            ),
            table(["contact at", "kind", "delay, ms", ""], rows, caption="Contacts", numbers=True),
        ]

    def pictures(self) -> list[Picture]:
        """How many contacts are detected within a time."""
        score = self.score
        found = np.sort(score.delay_s[np.isfinite(score.delay_s)])
        if not found.size:
            return []

        def draw(figure: Figure) -> None:
            plot = axes(figure)
            steps = np.concatenate([[found[0]], found]) * 1e3
            plot.step(steps, np.arange(found.size + 1) / len(score.labels), where="post", color=LAW)
            plot.axhline(1, color=EVENT, linewidth=0.8)
            plot.set_ylim(0, 1.05)
            plot.set_xlabel("delay, ms")
            plot.set_ylabel("share of contacts detected")
            plot.set_title("Detected within a time")

        alt = "Share of contacts detected against the time since they began"
        return [Picture("delay", alt, "Missed contacts keep the line below 1.", draw)]


class RocPart(Part):
    """Detections and false alarms at thresholds times a factor."""

    title = "Other thresholds"
    anchor = "roc"

    def __init__(self, roc: Roc) -> None:
        self.roc = roc

    def content(self) -> list[Html]:
        """One row for each factor."""
        roc = self.roc
        rows = [
            (f"{factor:.4g}", f"{detected} of {roc.labels}", number(rate), _delay(delay))
            for factor, detected, rate, delay in zip(
                roc.factor, roc.detected, roc.false_alarms_per_hour, roc.median_delay_s, strict=True
            )
        ]
        headings = ["factor", "detected", "false alarms an hour", "median delay, ms"]
        return [table(headings, rows, caption="All thresholds times a factor", numbers=True)]

    def pictures(self) -> list[Picture]:
        """Detections, false alarms and delay against the factor."""
        roc = self.roc

        def draw(figure: Figure) -> None:
            upper, middle, lower = stack(figure, [1.0, 1.0, 1.0], left=0.8)
            upper.plot(roc.factor, roc.detected / max(1, roc.labels), color=LAW, marker="o", markersize=3)
            upper.set_ylim(-0.05, 1.05)
            upper.set_ylabel("detected")
            middle.plot(roc.factor, roc.false_alarms_per_hour, color=LIMIT, marker="s", markersize=3)
            middle.set_yscale("symlog", linthresh=max(1.0, _least(roc.false_alarms_per_hour)))
            plain_ticks(middle.yaxis)
            middle.set_ylim(bottom=0)
            middle.set_ylabel("false / h")
            lower.plot(roc.factor, 1e3 * roc.median_delay_s, color=INK, marker="^", markersize=3)
            lower.set_ylabel("delay, ms")
            lower.set_xscale("log")
            plain_ticks(lower.xaxis, [0.25, 0.5, 1, 2, 4])
            lower.set_xlabel("factor on the thresholds")
            for panel in (upper, middle, lower):
                panel.axvline(1, color=EVENT, linewidth=0.8)
            upper.set_title("What a factor on all thresholds does")

        alt = "Share detected, false alarms an hour and median delay against a factor on all thresholds"
        return [Picture("roc", alt, "Vertical line: the thresholds as they are.", draw, 4.6)]


def _least(values: np.ndarray) -> float:
    positive = values[np.isfinite(values) & (values > 0)]
    return float(positive.min()) if positive.size else 1.0


def _delay(seconds: float) -> str:
    return "missed" if math.isnan(seconds) else f"{1e3 * seconds:.4g}"
