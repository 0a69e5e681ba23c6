"""Report of ``bumpstop score``: what was detected, how late, and what a factor on the thresholds would do."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.detection.durations import hours_in_words
from bumpstop.detection.scoring.labels import time_text
from bumpstop.report.detection.settings import SettingsPart
from bumpstop.report.document import Document, write_document
from bumpstop.report.markup import Html, bullets, paragraph, table
from bumpstop.report.picture import EVENT, INK, LAW, LIMIT, Picture, axes, plain_ticks, stack
from bumpstop.report.section import Part
from bumpstop.terminal import counted, number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bumpstop.detection import Roc, Score


def write_scoring(
    score: Score,
    roc: Roc | None,
    folder: Path,
    about: str = "",
    *,
    asked: Mapping[str, str],
    detector: Mapping[str, Any],
    inactive: str = "",
    notes: Sequence[str] = (),
) -> Path:
    """Write report.html and figures.

    Args:
        score: events against labels.
        roc: the same at other thresholds, where residuals were given.
        folder: made where it is missing.
        about: the robot, the recording and its labels, in words.
        asked: options and their values, for the table of settings.
        detector: settings of the detector whose events they are; empty where events or residuals came from a file.
        inactive: why the detector was inactive all the time; empty: it was not.
        notes: what a reader must know, a sentence each.
    """
    parts: list[Part] = [DetectionsPart(score, inactive, notes)]
    if roc is not None:
        parts.append(RocPart(roc))
    parts.append(SettingsPart(asked, detector))
    title = f"{score.detected} of {len(score.labels)} contacts detected"
    if inactive:
        title = f"detector inactive: {title}"
    return write_document(Document(title, "bumpstop scores", "scoring", parts, about), folder)


class DetectionsPart(Part):
    """Contacts with their delays, and false alarms."""

    title = "Detections"
    anchor = "detections"

    def __init__(self, score: Score, inactive: str = "", notes: Sequence[str] = ()) -> None:
        self.score, self.inactive, self.notes = score, inactive, notes

    def content(self) -> list[Html]:
        """Counts, and every contact."""
        score = self.score
        low, high = score.false_alarms_per_hour_interval()
        rows: list[tuple[str, ...]] = [
            (f"{time_text(label.start_s)} s", label.kind or "-", _delay(late), "no_data" if dark else "")
            for label, late, dark in zip(score.labels, score.delay_s, score.no_data, strict=True)
        ]
        headings = ["contact at", "kind", "delay, ms", ""]
        if score.forces is not None:
            headings[3:3] = ["force at detection, N", "largest force, N"]
            both = zip(score.forces.at_detection, score.forces.largest, strict=True)
            rows = [
                (*row[:3], *("-" if math.isnan(force) else number(float(force)) for force in forces), row[3])
                for row, forces in zip(rows, both, strict=True)
            ]
        first = f"INACTIVE all the time ({self.inactive}): nothing could be detected." if self.inactive else ""
        return [
            *([paragraph(first)] if first else []),
            paragraph(
                f"{score.detected} detected, {score.missed} missed, "
                f"{counted(score.false_alarms.size, 'false alarm')} in {hours_in_words(score.hours)} without contact: "
                f"{number(score.false_alarms_per_hour)} an hour, with 95 % confidence between {number(low)} and "
                f"{number(high)}. No data for {number(score.no_data_s)} s."
            ),
            table(headings, rows, caption="Contacts", numbers=True),
            *([bullets(self.notes)] if self.notes else []),
        ]

    def pictures(self) -> list[Picture]:
        """How many contacts are detected within a time."""
        score = self.score
        found = np.sort(score.delay_s[np.isfinite(score.delay_s)])
        if not found.size:
            return []

        def draw(figure: Figure) -> None:
            plot = axes(figure)
            # From zero: delays that are all alike differ by rounding, which no scale should show.
            low, high = 1e3 * min(0.0, found[0]), 1e3 * max(found[-1], 0.0)
            high += 0.1 * max(high - low, 1.0)
            counts = np.minimum(np.arange(found.size + 2), found.size)
            plot.step([low, *(1e3 * found), high], counts / len(score.labels), where="post", color=LAW)
            plot.set_xlim(low, high)
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
            (f"{factor:.4g}", f"{detected} of {roc.labels}", number(rate), _delay(delay) if roc.labels else "-")
            for factor, detected, rate, delay in zip(
                roc.factor, roc.detected, roc.false_alarms_per_hour, roc.median_delay_s, strict=True
            )
        ]
        headings = ["factor", "detected", "false alarms an hour", "median delay, ms"]
        return [table(headings, rows, caption="All thresholds times a factor", numbers=True)]

    def pictures(self) -> list[Picture]:
        """Detections against false alarms; then both, and the delay, against the factor."""
        roc = self.roc

        def draw_roc(figure: Figure) -> None:
            plot = axes(figure)
            # From the largest thresholds on, as a person reads a curve from left to right.
            rates, share = roc.false_alarms_per_hour[::-1], roc.detected[::-1] / roc.labels
            plot.plot(rates, share, color=LAW, marker="o", markersize=3, clip_on=False)
            # Factors that come to the same point share its label.
            marked: dict[tuple[float, float], list[str]] = {}
            for factor in (0.5, 1.0, 2.0):
                for k in np.flatnonzero(np.abs(roc.factor - factor) < 1e-9):
                    at = (float(roc.false_alarms_per_hour[k]), float(roc.detected[k] / roc.labels))
                    marked.setdefault(at, []).append(f"x {factor:g}")
            for at, names in marked.items():
                plot.plot(*at, "D", color=EVENT, markersize=6, clip_on=False)
                text = ", ".join(names)
                plot.annotate(text, at, (6, -4), textcoords="offset points", ha="left", va="top", fontsize=8)
            plot.set_xscale("symlog", linthresh=max(1.0, _least(rates)))
            plain_ticks(plot.xaxis)
            plot.set_xlim(left=0)
            plot.set_ylim(-0.05, 1.1)
            plot.set_xlabel("false alarms an hour")
            plot.set_ylabel("share of contacts detected")
            plot.set_title("Detections against false alarms")

        def draw_factors(figure: Figure) -> None:
            upper, middle, lower = stack(figure, [1.0, 1.0, 1.0], left=0.8)
            upper.plot(roc.factor, roc.detected / roc.labels, color=LAW, marker="o", markersize=3)
            upper.set_ylim(-0.05, 1.05)
            upper.set_ylabel("detected")
            self._draw_alarms(middle)
            lower.plot(roc.factor, 1e3 * roc.median_delay_s, color=INK, marker="^", markersize=3)
            lower.set_ylabel("delay, ms")
            _mark_factors(lower)
            for panel in (upper, middle, lower):
                panel.axvline(1, color=EVENT, linewidth=0.8)
            upper.set_title("What a factor on all thresholds does")

        def draw_alarms(figure: Figure) -> None:
            plot = axes(figure, left=0.8)
            self._draw_alarms(plot)
            _mark_factors(plot)
            plot.axvline(1, color=EVENT, linewidth=0.8)
            plot.set_title("What a factor on all thresholds does")

        caption = "Vertical line: the thresholds as they are."
        if not roc.labels:
            return [Picture("factors", "False alarms an hour against a factor on all thresholds", caption, draw_alarms)]
        alt = "Share detected, false alarms an hour and median delay against a factor on all thresholds"
        return [
            Picture(
                "roc",
                "Share of contacts detected against false alarms an hour, for factors on all thresholds",
                "One point for each factor of the table; x 1 are the thresholds as they are.",
                draw_roc,
            ),
            Picture("factors", alt, caption, draw_factors, 4.6),
        ]

    def _draw_alarms(self, panel: Axes) -> None:
        rates = self.roc.false_alarms_per_hour
        panel.plot(self.roc.factor, rates, color=LIMIT, marker="s", markersize=3)
        panel.set_yscale("symlog", linthresh=max(1.0, _least(rates)))
        plain_ticks(panel.yaxis)
        panel.set_ylim(bottom=0)
        panel.set_ylabel("false / h")


def _mark_factors(panel: Axes) -> None:
    panel.set_xscale("log")
    plain_ticks(panel.xaxis, [0.25, 0.5, 1, 2, 4])
    panel.set_xlabel("factor on the thresholds")


def _least(values: np.ndarray) -> float:
    positive = values[np.isfinite(values) & (values > 0)]
    return float(positive.min()) if positive.size else 1.0


def _delay(seconds: float) -> str:
    return "missed" if math.isnan(seconds) else f"{1e3 * seconds:.4g}"
