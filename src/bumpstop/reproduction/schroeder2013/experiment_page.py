"""Report of ``bumpstop experiment``: Schroeder's collisions beside the plant's."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.report.document import Document, write_document
from bumpstop.report.markup import Html, paragraph, table
from bumpstop.report.picture import EVENT, INK, LAW, LIMIT, Picture, axes
from bumpstop.report.section import Part
from bumpstop.terminal import number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bumpstop.reproduction.schroeder2013.collision_table import CollisionTable, SpeedRow

_MISSING = "-"
_BEFORE_S, _AFTER_S = 0.15, 0.15


def write_experiment(found: CollisionTable, folder: Path) -> Path:
    """Write report.html and figures; returns the page's path.

    Raises:
        InputError: the folder cannot be written.
    """
    title = f"{found.experiment.name.capitalize()}, the {found.experiment.at} hits"
    parts = [SpeedsPart(found), RunsPart(found)]
    return write_document(Document(title, "bumpstop experiment", found.experiment.name, parts), folder)


def _cell(value: float | None) -> str:
    return _MISSING if value is None else number(value)


class SpeedsPart(Part):
    """All speeds beside Schroeder's columns."""

    title = "By speed"
    anchor = "speeds"

    def __init__(self, found: CollisionTable) -> None:
        self.found = found

    def content(self) -> list[Html]:
        """The table, and what it was made with."""
        made, thing = self.found.experiment, self.found.experiment.object()
        rows = []
        for row in self.found.rows:
            data, source = row.to_json(), row.source
            delay = None if data["delay_s"] is None else 1e3 * data["delay_s"]
            rows.append(
                (
                    f"{row.speed_mm_s:g}",
                    f"{len(row.hits)} of {len(row.runs)}",
                    str(data["false_alarms"]),
                    _cell(data["force_at_detection_N"]),
                    _cell(source.force_N if source else None),
                    _cell(row.bound_N),
                    _cell(data["peak_force_N"]),
                    _cell(source.peak_N if source else None),
                    _cell(delay),
                    ", ".join(str(joint) for joint in row.joints) or _MISSING,
                    _MISSING if source is None else "yes" if source.detected else "false alarm",
                )
            )
        headings = (
            "speed, mm/s", "detected", "false alarms", "at detection, N", "Schroeder, N", "bound, N",
            "peak, N", "Schroeder, N", "delay, ms", "joints", "detected by Schroeder",
        )  # fmt: skip
        return [
            paragraph(
                f"{thing.stiffness:g} N/m ({thing.status}), {made.residual} residual, reaction "
                f"{1e3 * made.latency_s:g} ms after the sample that alarms. Published: Schroeder (2013), {made.table}. "
                "MuJoCo moves the arm."
            ),
            table(headings, rows, caption="Medians of the runs that detected, beside Schroeder (2013)", numbers=True),
            paragraph(
                f"The first threshold is reached at {made.threshold_force():.1f} N; the bound is that of eq 4.4."
            ),
        ]

    def pictures(self) -> list[Picture]:
        """Peak and detection force against speed."""
        rows = self.found.rows

        def draw(figure: Figure) -> None:
            plot = axes(figure)
            peaks = [(row.speed_mm_s, run.peak) for row in rows for run in row.hits]
            forces = [(row.speed_mm_s, force) for row in rows for force in row.forces]
            seen = [row.source for row in rows if row.source is not None and row.source.detected]
            source_peaks = [(one.speed_mm_s, one.peak_N) for one in seen if one.peak_N is not None]
            source_forces = [(one.speed_mm_s, one.force_N) for one in seen if one.force_N is not None]
            for points, marker, colour, size, text in (
                (peaks, "o", LAW, 3.5, "peak, each run"),
                (forces, "_", INK, 7.0, "at detection, each run"),
                (source_peaks, "D", EVENT, 6.0, "peak, Schroeder"),
                (source_forces, "x", EVENT, 6.0, "at detection, Schroeder"),
            ):
                if points:
                    plot.plot(*zip(*points, strict=True), marker, color=colour, markersize=size, label=text)
            plot.plot([r.speed_mm_s for r in rows], [r.bound_N for r in rows], "--", color=LIMIT, label="bound, eq 4.4")
            plot.set_xlabel("speed, mm/s")
            plot.set_ylabel("force, N")
            # The names stand above the points, whatever these are.
            plot.set_ylim(0, 1.45 * plot.get_ylim()[1])
            plot.set_title("Force against speed")
            plot.legend(loc="upper left", fontsize=8, ncols=2)

        alt = "Peak force and force at detection against speed, ours and Schroeder's"
        caption = "Runs of Schroeder (2013) that alarmed before contact are left out."
        return [Picture("peak_against_speed", alt, caption, draw, height=3.6)]


class RunsPart(Part):
    """The first run at every speed over time."""

    title = "Over time"
    anchor = "time"

    def __init__(self, found: CollisionTable) -> None:
        self.found = found

    def content(self) -> list[Html]:
        """What the figures show."""
        return [paragraph("The first run at every speed; time counts from the alarm, or from contact without one.")]

    def pictures(self) -> list[Picture]:
        """One for every speed."""
        return [self._picture(row) for row in self.found.rows]

    def _picture(self, row: SpeedRow) -> Picture:
        run = row.runs[0]
        limits = self.found.experiment.thresholds
        monitored = [j for j in range(len(limits)) if np.isfinite(limits[j])]
        joint = run.joints[0] if run.joints else monitored[1]
        start = next((t for t in (run.alarm_s, run.contact_s) if t is not None), 0.0)
        trace, found = run.run.trace, run.detection

        def draw(figure: Figure) -> None:
            force = axes(figure, top=0.32, bottom=2.05)
            residual = axes(figure, bottom=0.48, top=figure.get_size_inches()[1] - 1.8)
            t = trace.t - start
            force.plot(t, trace.contact_force[:, 0], color=LAW)
            force.axhline(self.found.experiment.threshold_force(), color=LIMIT, linestyle="--", linewidth=1)
            force.axhline(row.bound_N, color=LIMIT, linestyle=":", linewidth=1)
            force.set_ylabel("force, N")
            force.set_title(f"{row.speed_mm_s:g} mm/s")
            force.tick_params(labelbottom=False)
            residual.plot(found.t - start, found.residual[:, joint], ".-", color=INK, linewidth=0.8, markersize=3)
            for sign in (-1, 1):
                residual.axhline(sign * limits[joint], color=LIMIT, linestyle="--", linewidth=1)
            residual.set_ylabel(f"joint {joint + 1}, Nm")
            residual.set_xlabel("time from the alarm, s")
            for plot in (force, residual):
                plot.set_xlim(-_BEFORE_S, _AFTER_S)
                if run.alarm_s is not None:
                    plot.axvline(0.0, color=EVENT, linewidth=1)
            near = np.abs(found.t - start) < _BEFORE_S
            seen = found.residual[near, joint]
            most = max(float(np.nanmax(np.abs(seen), initial=0.0)), limits[joint]) * 1.15
            residual.set_ylim(-most, most)

        alt = f"Contact force and residual over time at {row.speed_mm_s:g} mm/s"
        caption = (
            "Dashed: the threshold, and the force that reaches it. Dotted: the bound of eq 4.4. Green: the alarm. "
            f"Residual of joint {joint + 1}."
        )
        return Picture(f"run_{row.speed_mm_s:g}".replace(".", "_"), alt, caption, draw, height=4.2)
