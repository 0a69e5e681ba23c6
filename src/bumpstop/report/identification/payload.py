"""The page of ``bumpstop identify --model payload``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bumpstop.model import unit_of
from bumpstop.report.document import Document, write_document
from bumpstop.report.identification.fit_verdict import VerdictPart
from bumpstop.report.identification.validation import decimate
from bumpstop.report.markup import Html, bullets, paragraph, table
from bumpstop.report.picture import FAINT, LAW, Picture, axes
from bumpstop.report.section import Part
from bumpstop.terminal import number

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from bumpstop.identification import FitVerdict, PayloadFit
    from bumpstop.model import Robot


class PayloadPart(Part):
    """Mass, centre and moments with standard errors."""

    title = "Payload"
    anchor = "payload"

    def __init__(self, found: PayloadFit) -> None:
        self._found = found

    def content(self) -> list[Html]:
        """One row for each figure, and what the motion cannot show."""
        found = self._found
        rows = []
        for name, (value, unit) in found.parameters.items():
            error = found.standard_errors[name]
            shown = (number(value), f"{error:.2g}") if value is not None and error is not None else ("not seen", "")
            rows.append((name, *shown, unit))
        if found.center is not None and found.center_errors is not None:
            rows += [
                (f"centre, {axis}", f"{x:.4g}", f"{error:.2g}", "m")
                for axis, x, error in zip("xyz", found.center, found.center_errors, strict=True)
            ]
        said = [f"{name} is not identifiable in this motion" for name in found.unobservable]
        said += [f"{name} is left out: its gain is unknown" for name in found.joints_left_out]
        return [
            paragraph(
                "What the tip carries, in the frame of the tip: mass, first moments, and second moments about its "
                "origin where they were asked for. Standard errors hold where residuals are correlated in time and "
                f"between joints; they know of {found.errors_known}."
            ),
            table(("", "value", "standard error", "unit"), rows, caption="Payload", numbers=True),
            *([bullets(said)] if said else []),
        ]


class ExplainedPart(Part):
    """Torque that the bare arm leaves open, and what the payload makes of it."""

    title = "Torque that the payload explains"
    anchor = "explained"

    def __init__(self, found: PayloadFit, arm: Robot) -> None:
        self._found = found
        self._joints = [next(joint for joint in arm.joints if joint.name == name) for name in found.joints]

    def content(self) -> list[Html]:
        """Errors with and without the payload."""
        found = self._found
        unit = unit_of(*self._joints)
        rows = [
            (name, number(float(without)), number(float(rmse)))
            for name, without, rmse in zip(found.joints, found.rmse_without, found.rmse, strict=True)
        ]
        return [
            paragraph(
                "Torque beyond that of the arm without payload (thin), and what the payload explains of it (dashed), "
                "both after the filter of the fit."
            ),
            table(
                ("joint", f"rmse without payload [{unit}]", f"rmse with it [{unit}]"),
                rows,
                caption="Torque error",
                numbers=True,
            ),
        ]

    def pictures(self) -> list[Picture]:
        """One for each joint."""
        return [self._picture(j, name) for j, name in enumerate(self._found.joints)]

    def _picture(self, j: int, name: str) -> Picture:
        found = self._found

        def draw(figure: Figure) -> None:
            panel = axes(figure, left=0.75)
            panel.axhline(0, color=FAINT, linewidth=0.6)
            panel.plot(*decimate(found.t, found.wanted[:, j]), color=FAINT, linewidth=0.9, label="without payload")
            panel.plot(
                *decimate(found.t, found.explained[:, j]), color=LAW, linewidth=1.2, linestyle="--", label="payload"
            )
            panel.set_title(name)
            panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.1)
            panel.set_xlabel("time [s]")
            panel.set_ylabel(f"torque [{unit_of(self._joints[j])}]")

        alt = f"Torque of joint {name} over time that the bare arm does not explain, and the payload's share."
        return Picture(f"payload_{j + 1}", alt, f"{name}.", draw, height=2.6)


def write_payload_report(found: PayloadFit, arm: Robot, folder: Path, *, source: str, verdict: FitVerdict) -> Path:
    """Write ``report.html`` and its figures; returns the page's path.

    Raises:
        InputError: the folder cannot be written.
    """
    title = f"{arm.title or arm.name}: what it carries" + (f", {source}" if source else "")
    parts: list[Part] = [VerdictPart(verdict), PayloadPart(found), ExplainedPart(found, arm)]
    return write_document(Document(title, "bumpstop: payload", "payload", parts), folder)
