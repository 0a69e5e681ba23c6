"""Report of ``bumpstop tune``: the tail of the residuals, and alarms against newtons."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.detection import MAX_EXTRAPOLATION
from bumpstop.detection.durations import rates_in_words
from bumpstop.report.detection.settings import SettingsPart
from bumpstop.report.document import Document, write_document
from bumpstop.report.formatting import acceptable
from bumpstop.report.markup import Html, bullets, paragraph, table
from bumpstop.report.picture import AREA, EVENT, FAINT, INK, LAW, LIMIT, Picture, axes, plain_ticks
from bumpstop.report.section import Part
from bumpstop.terminal import number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bumpstop.detection import Tuning

_STYLES = (("-", LAW), ("--", EVENT), ("-.", INK), (":", LIMIT))


def write_tuning(
    tuning: Tuning,
    operating_curve: Sequence[dict[str, Any]],
    folder: Path,
    joints: Sequence[str] = (),
    about: str = "",
    *,
    asked: Mapping[str, str],
    detector: Mapping[str, Any],
) -> Path:
    """Write report.html and figures.

    Args:
        tuning: thresholds and the tail they stand on.
        operating_curve: ``per_hour``, ``extrapolated_too_far`` and forces of ``scenarios``, as ``tune --json`` has
            them.
        folder: made where it is missing.
        joints: their names, where they are known.
        about: the robot and the recordings, in words.
        asked: options and their values, for the table of settings.
        detector: settings of the detector whose residuals they are; empty where they came from a file.
    """
    parts: list[Part] = [TailPart(tuning, joints)]
    if any(point["scenarios"] for point in operating_curve):
        parts.append(OperatingCurvePart(operating_curve, tuning.target))
    parts.append(SettingsPart(asked, detector))
    title = f"Thresholds for {number(tuning.target)} false alarms an hour"
    return write_document(Document(title, "bumpstop tuning", "tuning", parts, about), folder)


class TailPart(Part):
    """Thresholds, and how the rate of alarms falls with them."""

    title = "Thresholds"
    anchor = "tail"

    def __init__(self, tuning: Tuning, joints: Sequence[str] = ()) -> None:
        self.tuning = tuning
        self.joints = joints

    def content(self) -> list[Html]:
        """The thresholds with their intervals, and the notes."""
        tuning = self.tuning
        ends = zip(tuning.thresholds(), *tuning.thresholds_interval(), strict=True)
        more = tuning.columns()
        rows = []
        for j, (value, below, above) in enumerate(ends, start=1):
            cells = [number(value), f"{number(below)} to {number(above)}"]
            cells += [number(float(column[j - 1])) for column in more.values()]
            if not math.isfinite(value):
                cells = ["not monitored", *[""] * (1 + len(more))]
            rows.append((" ".join((f"joint {j}", *self.joints[j - 1 : j])), *cells))
        percent = f"{100 * tuning.confidence:g} %"
        own = (f"{name}, {tuning.unit_of_term(name.removeprefix('per '))}" for name in more)
        return [
            paragraph(
                f"These thresholds stand for {number(tuning.target)} false alarms an hour; {percent} interval of the "
                f"rate: {rates_in_words(*tuning.per_hour_interval())} an hour."
            ),
            table(
                ["", f"threshold, {tuning.unit}", f"{percent} interval, {tuning.unit}", *own],
                rows,
                caption="Thresholds",
                numbers=True,
            ),
            bullets(tuning.notes),
        ]

    def pictures(self) -> list[Picture]:
        """Rate against factor, with the peaks it was fitted to."""
        tuning, tail = self.tuning, self.tuning.tail
        chosen = tail.level_of(tuning.target)
        far = 1 / (MAX_EXTRAPOLATION * tail.hours)
        rates = np.geomspace(min(tuning.target / 10, 1 / tail.hours), 0.98 * tail.rate, 25)

        def draw(figure: Figure) -> None:
            plot = axes(figure, left=0.8)
            factor = np.array([tail.level_of(rate) for rate in rates]) / chosen
            ends = np.array([tail.level_interval(rate, tuning.confidence) for rate in rates]) / chosen
            plot.fill_betweenx(rates, ends[:, 0], ends[:, 1], color=AREA, alpha=0.4, linewidth=0)
            plot.plot(factor, rates, color=LAW, label="fitted")
            peaks = np.sort(tail.peaks)[::-1] / chosen
            seen = np.arange(1, peaks.size + 1) / tail.hours
            plot.plot(peaks, seen, "o", color=INK, markersize=3, label="recorded peaks")
            plot.plot(1, tuning.target, "D", color=EVENT, markersize=6, label="chosen")
            plot.set_yscale("log")
            plain_ticks(plot.yaxis)
            if far > rates[0]:
                plot.axhspan(rates[0], far, color=FAINT, alpha=0.2, hatch="//", linewidth=0, label="beyond 100 times")
            plot.set_xlim(left=0.95 * float(ends.min()), right=min(3.0, 1.05 * float(ends.max())))
            plot.set_xlabel("factor on the thresholds")
            plot.set_ylabel("false alarms an hour")
            plot.set_title("Alarms an hour, any joint")
            plot.legend(loc="upper right", fontsize=8)

        alt = "False alarms an hour falling with a common factor on all thresholds, with interval and recorded peaks"
        caption = (
            f"Shaded: {100 * tuning.confidence:g} % interval. Dots: independent peaks of the recording, each at the "
            "rate at which it was reached or passed."
        ) + (f" Hatched: more than {MAX_EXTRAPOLATION} times beyond what was recorded." if far > rates[0] else "")
        return [Picture("alarm_rate", alt, caption, draw)]


class OperatingCurvePart(Part):
    """What fewer alarms cost in newtons."""

    title = "Alarms against newtons"
    anchor = "operating_curve"

    def __init__(self, operating_curve: Sequence[dict[str, Any]], target: float) -> None:
        self.operating_curve, self.target = operating_curve, target

    def content(self) -> list[Html]:
        """Every rate and scenario."""
        keys = ("p50", "p95", "p999", "anywhere")
        rows = [
            (
                number(point["per_hour"]) + (" (extrapolated)" if point["extrapolated_too_far"] else ""),
                Path(name).stem,
                *(number(math.inf if forces[key] is None else forces[key]) for key in keys),
                acceptable(forces, "no limits"),
            )
            for point in self.operating_curve
            for name, forces in point["scenarios"].items()
        ]
        headings = ["alarms an hour", "scenario", "median, N", "p95, N", "p99.9, N", "undetectable, N", "acceptable"]
        return [
            table(headings, rows, caption="Peak force at the thresholds of each rate", numbers=True),
            paragraph("Undetectable is the largest force at the pose, in any direction, below every threshold."),
        ]

    def pictures(self) -> list[Picture]:
        """The 95 % quantile of the peak force of every scenario."""

        def draw(figure: Figure) -> None:
            plot = axes(figure)
            rates = [point["per_hour"] for point in self.operating_curve]
            for k, name in enumerate(self.operating_curve[0]["scenarios"]):
                line, colour = _STYLES[k % len(_STYLES)]
                forces = [point["scenarios"][name] for point in self.operating_curve]
                p95 = [math.nan if force["p95"] is None else force["p95"] for force in forces]
                plot.plot(rates, p95, line, color=colour, marker="o", markersize=3, label=Path(name).stem)
                if forces[0]["limit"] is not None:
                    plot.axhline(forces[0]["limit"], color=colour, linewidth=0.8, linestyle=line, alpha=0.6)
            plot.axvline(self.target, color=FAINT, linewidth=0.8)
            plot.set_xscale("log")
            plain_ticks(plot.xaxis)
            plot.set_xlabel("false alarms an hour")
            plot.set_ylabel("peak force, 95 %, N")
            plot.set_title("What a rate of alarms costs")
            plot.legend(loc="best", fontsize=8)

        alt = "Peak force against false alarms an hour, one line for each scenario"
        caption = "Horizontal lines without dots: force limit of the body. Vertical: the wanted rate."
        return [Picture("alarms_against_newtons", alt, caption, draw)]
