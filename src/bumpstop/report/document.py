"""A document: parts in order, one file without anything to fetch."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING

from bumpstop.errors import InputError, where_else
from bumpstop.output_files import write_bytes
from bumpstop.report.made_by import made_by
from bumpstop.report.markup import Html, element
from bumpstop.text_files import shown

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from bumpstop.report.picture import Rendered
    from bumpstop.report.section import Part

# Pages go to people who have not read these.
_SCHROEDER_2013 = (
    "Schroeder (2013): K. Schroeder, Requirements for Effective Collision Detection on Industrial Serial "
    "Manipulators, The University of Texas at Austin, 2013."
)


class Document:
    """Parts with their figures, drawn on construction.

    Attributes:
        title: the heading of the page.
        kind: the line above it.
        about: the line below it: the robot, and what was asked; may be empty.
        name: what follows the title in the browser's window.
        style: further CSS of this page; may be empty.
        sections: those that apply, in order, each with its drawn figures.
    """

    def __init__(
        self, title: str, kind: str, name: str, parts: Sequence[Part], about: str = "", style: str = ""
    ) -> None:
        self.title = title
        self.kind = kind
        self.about = about
        self.name = name
        self.style = style
        self.sections: list[tuple[Part, list[Rendered]]] = [
            (part, [picture.render() for picture in part.pictures()]) for part in parts if part.applies()
        ]

    @property
    def figures(self) -> list[Rendered]:
        """Every drawn figure, in order."""
        return [figure for _, figures in self.sections for figure in figures]

    def html(self) -> str:
        """The whole page."""
        style = (resources.files("bumpstop.report") / "page.css").read_text(encoding="utf-8")
        contents = [element("li", element("a", part.title, href=f"#{part.anchor}")) for part, _ in self.sections]
        head = element(
            "head",
            Html('<meta charset="utf-8">'),
            Html('<meta name="viewport" content="width=device-width, initial-scale=1">'),
            element("title", f"{self.title}: {self.name}"),
            element("style", Html(style + self.style)),
        )
        main = element("main", *(part.html(figures) for part, figures in self.sections))
        about = [element("p", self.about)] if self.about else []
        told = [element("p", _SCHROEDER_2013)] if "Schroeder" in main else []
        body = element(
            "body",
            element("header", element("p", self.kind, class_="kind"), element("h1", self.title), *about),
            element("nav", element("ol", *contents), aria_label="Sections"),
            main,
            element(
                "footer", *told, _made(), element("p", "An engineering estimate, not a certified safety function.")
            ),
        )
        # The command and what was asked name files.
        return shown(f'<!DOCTYPE html>\n<html lang="en">{head}{body}</html>\n')

    def write(self, folder: Path) -> Path:
        """Write ``report.html`` and the figures as ``<name>.svg`` and ``<name>.png``; returns the page's path.

        Raises:
            OSError: the folder cannot be written.
        """
        path = folder / "report.html"
        folder.mkdir(parents=True, exist_ok=True)
        for figure in self.figures:
            write_bytes(folder / f"{figure.picture.name}.svg", figure.svg.encode("utf-8"))
            write_bytes(folder / f"{figure.picture.name}.png", figure.png)
        write_bytes(path, self.html().encode("utf-8"))
        return path


def _made() -> Html:
    """One line: the command, the day and the versions."""
    found = made_by()
    command = found.pop("command", "")
    said = ", ".join(value if name == "date" else f"{name} {value}" for name, value in found.items())
    return (
        element("p", "Made by ", element("code", command), f"; {said}.")
        if command
        else element("p", f"Made by {said}.")
    )


def write_document(document: Document, folder: Path) -> Path:
    """Write a page; where the folder cannot be written, say so.

    Raises:
        InputError: the folder cannot be written.
    """
    try:
        return document.write(folder)
    except OSError as error:
        problem = f"{str(folder)!r} cannot be written ({error.strerror or error})"
        raise InputError("--out", problem, where_else(error)) from None
