"""The page of ``bumpstop identify --protocol``: table 2.2 and figures 2.7 to 2.12 of this arm."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.report.document import Document, write_document
from bumpstop.report.formatting import with_error
from bumpstop.report.identification.fit_verdict import VerdictPart
from bumpstop.report.markup import Html, bullets, paragraph, table
from bumpstop.report.section import Part
from bumpstop.reproduction.schroeder2013.protocol_comparison import BesidePart
from bumpstop.reproduction.schroeder2013.protocol_figures import (
    FrictionPart,
    HysteresisPart,
    InertiaPart,
    MapPart,
    StrokesPart,
)
from bumpstop.terminal import number

if TYPE_CHECKING:
    from bumpstop.identification import FitVerdict
    from bumpstop.reproduction.schroeder2013.fit_comparison import FitComparison
    from bumpstop.reproduction.schroeder2013.protocol import ProtocolFit

_UNITS = {"A": "Nm/A2", "B": "Nm/A", "D": "A", "F": "1", "coulomb": "A", "viscous": "A s/rad", "load": "1"}
_UNITS |= {"hysteresis": "Nm", "inertia": "kg m2"}


class TablePart(Part):
    """Table 2.2 with standard errors."""

    title = "Parameters"
    anchor = "parameters"

    def __init__(self, fit: ProtocolFit) -> None:
        self._fit = fit

    def content(self) -> list[Html]:
        """One row for each joint that was identified, and why the others were not."""
        units = {name: unit for name, unit in _UNITS.items() if any(name in own.parameters for own in self._fit.joints)}
        rows = [
            (
                joint.experiment.name,
                *(with_error(joint.parameters.get(name)) for name in units),
                number(joint.friction_sd),
                joint.map.replace("_", " "),
                f"{joint.r2:.4f}",
            )
            for joint in self._fit.joints
        ]
        headings = ("joint", *(f"{name} [{unit}]" for name, unit in units.items()), "friction sd [A]")
        found: list[Html] = [
            paragraph(
                "Value and standard error, as Schroeder's table 2.2. Current is written as ampere here; it is in "
                "whatever unit the recording had. R2 is that of the torque at constant speed."
            ),
            table((*headings, "map", "R2"), rows, caption="Joint torque model", numbers=True),
        ]
        said = [f"{joint.experiment.name}: {note}" for joint in self._fit.joints for note in joint.notes]
        said += [f"{self._fit.plan.robot.joints[k].name}: not identified: {why}" for k, why in self._fit.missing]
        said += [
            f"{lost.name}: not identifiable, as {lost.reason}; remedy: {lost.remedy}"
            for lost in self._fit.plan.unobservable
        ]
        return [*found, *([bullets(said)] if said else [])]


def write_protocol_report(
    fit: ProtocolFit, folder: Path, beside: FitComparison | None = None, verdict: FitVerdict | None = None
) -> Path:
    """Write ``report.html`` and its figures; returns the page's path.

    Args:
        fit: by the protocol.
        folder: made where it is missing.
        beside: the general fit, or None.
        verdict: on the fit, or None.

    Raises:
        InputError: the folder cannot be written.
    """
    arm = fit.plan.robot.title or fit.plan.robot.name
    parts = (TablePart, StrokesPart, FrictionPart, MapPart, HysteresisPart, InertiaPart)
    document = Document(
        f"{arm}: {len(fit.joints)} of {fit.plan.robot.dof} joints from {fit.rows} rows",
        "bumpstop: identification by protocol",
        "identification",
        [VerdictPart(one) for one in (verdict,) if one is not None]
        + [part(fit) for part in parts[:1]]
        + [BesidePart(beside)]
        + [part(fit) for part in parts[1:]],
    )
    return write_document(document, folder)
