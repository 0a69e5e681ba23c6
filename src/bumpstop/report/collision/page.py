"""The page: sections in order, one file without anything to fetch."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.collision.summary import arm_title, what_is_hit
from bumpstop.errors import InputError, where_else
from bumpstop.report.collision.area import AreaSection
from bumpstop.report.collision.arm import ArmSection
from bumpstop.report.collision.detection import DetectionSection
from bumpstop.report.collision.distribution import DistributionSection
from bumpstop.report.collision.force_over_time import ForceOverTimeSection
from bumpstop.report.collision.tables import AssumptionsSection, FiguresSection, ProvenanceSection, SettingsSection
from bumpstop.report.collision.uncertainty import UncertaintySection
from bumpstop.report.collision.verdict import VerdictSection
from bumpstop.report.document import Document
from bumpstop.report.formatting import method_words
from bumpstop.text_files import as_path

if TYPE_CHECKING:
    from bumpstop.collision import CollisionResult
    from bumpstop.report.section import Section
    from bumpstop.uncertainty import UncertainResult

FIGURES = (
    "arm",
    "force_over_time_median",
    "force_over_time_bad",
    "peak_force",
    "trigger_joints",
    "detection_delay",
    "limits_over_area",
)
"""Every figure a report may have, by the name of its files; each distribution has those that make sense for it."""
FIGURES_OF_UNCERTAINTY = ("tornado", "exceedance_band")
"""The same of a verdict with an interval."""


class Page(Document):
    """A distribution's report, drawn on construction; its title names robot, speed and body."""

    def __init__(
        self,
        result: CollisionResult,
        details: Mapping[str, str] | None = None,
        uncertain: UncertainResult | None = None,
    ) -> None:
        sections: list[Section] = [
            VerdictSection(result, uncertain),
            UncertaintySection(result, uncertain),
            ArmSection(result),
            ForceOverTimeSection(result),
            DistributionSection(result),
            DetectionSection(result),
            AreaSection(result),
            FiguresSection(result),
            ProvenanceSection(result),
            SettingsSection(result, details or {}, None if uncertain is None else uncertain.scenario),
            AssumptionsSection(result),
        ]
        super().__init__(
            f"{arm_title(result)} {result.problem.motion_in_words} against {what_is_hit(result)}",
            f"bumpstop collision report; {method_words(result)}",
            "collision report",
            sections,
        )


def write_report(
    result: CollisionResult,
    folder: Path,
    *,
    details: Mapping[str, str] | None = None,
    uncertain: UncertainResult | None = None,
) -> Path:
    """Write ``report.html`` and its figures as ``<name>.png`` and ``<name>.svg``.

    The page holds everything it shows. The same distribution gives the same bytes.

    Args:
        result: exact or sampled.
        folder: made where it is missing. Figures of an earlier report there are replaced or removed.
        details: further rows for the page's table of what made it, such as the command line.
        uncertain: the verdict with an interval, of which ``result`` is the central case.

    Returns:
        The path of report.html.

    Raises:
        InputError: the folder cannot be written.
    """
    folder = as_path(folder, "folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        page = Page(result, details, uncertain)
        for name in {*FIGURES, *FIGURES_OF_UNCERTAINTY} - {figure.picture.name for figure in page.figures}:
            # Left from another distribution, it would pass for a figure of this one.
            for kind in ("svg", "png"):
                (folder / f"{name}.{kind}").unlink(missing_ok=True)
        return page.write(folder)
    except OSError as error:
        raise InputError(
            "--out", f"{str(folder)!r} cannot be written ({error.strerror or error})", where_else(error)
        ) from None
