"""Report of ``bumpstop detect``: what was detected, when nothing could be, and the settings that decided."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bumpstop.report.detection.residuals import residual_picture
from bumpstop.report.detection.settings import SettingsPart
from bumpstop.report.document import Document, write_document
from bumpstop.report.markup import Html, bullets, paragraph, table
from bumpstop.report.section import Part
from bumpstop.terminal import counted, number

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from bumpstop.detection import DetectionRun
    from bumpstop.model import Robot
    from bumpstop.report.picture import Picture

_MAX_EVENTS = 200
# What a reader may do about the faults that have a way out.
_REMEDIES = {
    "repeated": "stamps closer than a tenth of a period; --rate HZ reads rows as even",
    "out_of_order": "time runs backwards; --rate HZ reads rows as even",
    "gap": "no sample for longer than five periods",
    "outside_limits": "--limit-margin lets positions beyond their limits pass",
    "frozen": "time goes on, positions and signals do not; --frozen says how long they may",
    "filling": "too few samples yet, or an end of the recording in motion; --window sets how many a loop needs",
}


def write_events(run: DetectionRun, robot: Robot, folder: Path, *, asked: Mapping[str, str], name: str) -> Path:
    """Write report.html and its figure.

    Args:
        run: of the detector over the recording.
        robot: whose joints they are.
        folder: made where it is missing.
        asked: what was asked for, by name, for the table of settings.
        name: of the recording.
    """
    parts: list[Part] = [AlarmsPart(run, robot), SettingsPart({"robot": robot.name, **asked}, run.settings)]
    return write_document(Document(f"{name}: {_heading(run)}", "bumpstop detection", "detection", parts), folder)


def _heading(run: DetectionRun) -> str:
    count = len(run.events)
    return "detector inactive" if run.inactive else f"{count} alarm{'' if count == 1 else 's'}"


class AlarmsPart(Part):
    """The alarms, when the detector had no data, and residuals over time."""

    title = "Alarms"
    anchor = "alarms"

    def __init__(self, run: DetectionRun, robot: Robot) -> None:
        self.run, self.robot, self.units = run, robot, run.units

    def content(self) -> list[Html]:
        """The conclusion, every event, time without data by its cause, and notes."""
        run = self.run
        text = [paragraph(run.conclusion + ".")]
        if run.events:
            headings = (
                "begin, s",
                "end, s",
                "joints",
                "largest residual",
                "its threshold",
                "force, N",
                "likeliest link",
            )
            rows = [self._row(k) for k in range(min(len(run.events), _MAX_EVENTS))]
            more = f" (the first {_MAX_EVENTS} of {len(run.events)})" if len(run.events) > _MAX_EVENTS else ""
            text.append(table(headings, rows, caption=f"Events{more}", numbers=True))
            text.append(
                paragraph(
                    "An event lasts from the first to the last row over a threshold. The threshold is that of its "
                    f"first row; forces are those of the arm on the body at the first row, {run.force_at}."
                )
            )
        if run.no_data.any():
            reasons = [(name, str(rows), _REMEDIES.get(name, "")) for name, rows in run.no_data_rows().items()]
            text.append(table(("fault", "rows", "meaning"), reasons, caption=f"No data for {run.no_data_s:.4g} s"))
        if run.arming_s:
            over = counted(int(run.masked_while_arming.sum()), "row", "was")
            text.append(paragraph(f"Arming for {run.arming_s:.4g} s; {over} over a threshold meanwhile."))
        return [*text, bullets(run.notes)] if run.notes else text

    def _row(self, place: int) -> tuple[str, ...]:
        event = self.run.events[place]
        joints = sorted({*event.joints, *event.fast_joints})
        at = event.largest_joint
        return (
            f"{event.t:.4f}",
            f"{event.end:.4f}",
            ", ".join(str(j + 1) for j in joints),
            "-" if at is None else f"{number(float(event.largest_residual[at]))} {self.units[at]} at joint {at + 1}",
            "-" if at is None else f"{number(float(event.threshold[at]))} {self.units[at]}",
            number(event.force_along),
            event.link or "-",
        )

    def pictures(self) -> list[Picture]:
        """Residuals with their thresholds."""
        return [residual_picture(self.run, tuple(joint.name for joint in self.robot.joints), self.units)]
