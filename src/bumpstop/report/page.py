"""The page: sections in order, one file without anything to fetch."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.errors import InputError
from bumpstop.report.area import AreaSection
from bumpstop.report.arm import ArmSection
from bumpstop.report.detection import DetectionSection
from bumpstop.report.distribution import DistributionSection
from bumpstop.report.force_over_time import ForceOverTimeSection
from bumpstop.report.markup import Html, element
from bumpstop.report.records import AssumptionsSection, FiguresSection, ProvenanceSection, SettingsSection
from bumpstop.report.verdict import VerdictSection
from bumpstop.report.words import arm, what_is_hit, which_law

if TYPE_CHECKING:
    from bumpstop.collision import ForceLaw
    from bumpstop.report.picture import Rendered
    from bumpstop.report.section import Section

FIGURES = (
    "arm",
    "force_over_time_median",
    "force_over_time_bad",
    "peak_force",
    "trigger_joints",
    "detection_delay",
    "limits_over_area",
)
"""Every figure a report may have, by the name of its files; each law has those that make sense for it."""


class Page:
    """A law's report, drawn on construction.

    Attributes:
        title: robot, speed and body.
        sections: those that apply, in order, each with its drawn figures.
    """

    def __init__(self, law: ForceLaw, details: Mapping[str, str] | None = None) -> None:
        self._law = law
        self.title = f"{arm(law)} {law.problem.motion_in_words} against {what_is_hit(law)}"
        sections: list[Section] = [
            VerdictSection(law),
            ArmSection(law),
            ForceOverTimeSection(law),
            DistributionSection(law),
            DetectionSection(law),
            AreaSection(law),
            FiguresSection(law),
            ProvenanceSection(law),
            SettingsSection(law, details or {}),
            AssumptionsSection(law),
        ]
        self.sections: list[tuple[Section, list[Rendered]]] = [
            (section, [picture.render() for picture in section.pictures()]) for section in sections if section.applies()
        ]

    @property
    def figures(self) -> list[Rendered]:
        """Every drawn figure, in order."""
        return [figure for _, figures in self.sections for figure in figures]

    def html(self) -> str:
        """The whole page."""
        style = (resources.files("bumpstop.report") / "page.css").read_text(encoding="utf-8")
        contents = [
            element("li", element("a", section.title, href=f"#{section.anchor}")) for section, _ in self.sections
        ]
        head = element(
            "head",
            Html('<meta charset="utf-8">'),
            Html('<meta name="viewport" content="width=device-width, initial-scale=1">'),
            element("title", f"{self.title}: collision report"),
            element("style", Html(style)),
        )
        header = element(
            "header",
            element("p", f"bumpstop collision report; {which_law(self._law)}", class_="kind"),
            element("h1", self.title),
        )
        body = element(
            "body",
            header,
            element("nav", element("ol", *contents), aria_label="Sections"),
            element("main", *(section.html(figures) for section, figures in self.sections)),
            element("footer", element("p", "An engineering estimate, not a certified safety function.")),
        )
        return f'<!DOCTYPE html>\n<html lang="en">{head}{body}</html>\n'


def write_report(law: ForceLaw, folder: Path, *, details: Mapping[str, str] | None = None) -> Path:
    """Write ``report.html`` and its figures as ``<name>.png`` and ``<name>.svg``.

    The page holds everything it shows. The same law gives the same bytes.

    Args:
        law: exact or sampled.
        folder: made where it is missing. Figures of an earlier report there are replaced or removed.
        details: further rows for the page's table of what made it, such as the command line.

    Returns:
        The path of report.html.

    Raises:
        InputError: the folder cannot be written.
    """
    path = folder / "report.html"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        page = Page(law, details)
        for name in set(FIGURES) - {figure.picture.name for figure in page.figures}:
            # Left from another law, it would pass for a figure of this one.
            for kind in ("svg", "png"):
                (folder / f"{name}.{kind}").unlink(missing_ok=True)
        for figure in page.figures:
            (folder / f"{figure.picture.name}.svg").write_text(figure.svg, encoding="utf-8", newline="\n")
            (folder / f"{figure.picture.name}.png").write_bytes(figure.png)
        path.write_text(page.html(), encoding="utf-8", newline="\n")
    except OSError as error:
        raise InputError(
            "--out", f"{str(folder)!r} cannot be written ({error.strerror})", "give another folder"
        ) from None
    return path
