"""Pages of registers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bumpstop.report.document import Document, write_document
from bumpstop.report.register.assumptions import AssumptionsPart
from bumpstop.report.register.inputs import InputsPart
from bumpstop.report.register.provenance import ProvenancePart
from bumpstop.report.register.register_style import register_style
from bumpstop.report.register.situations import FIGURE, OutcomePart, SituationsPart

if TYPE_CHECKING:
    from pathlib import Path

    from bumpstop.register import RegisterResult
    from bumpstop.report.section import Part


def write_register(result: RegisterResult, folder: Path) -> Path:
    """Write ``report.html`` of a register and its figure; returns the page's path.

    Raises:
        InputError: the folder cannot be written.
    """
    parts: list[Part] = [
        OutcomePart(result),
        SituationsPart(result),
        AssumptionsPart(result.results),
        InputsPart(result.results),
        ProvenancePart(result),
    ]
    title = "Contact situations"
    document = Document(
        title, "bumpstop: register of contact situations", "register", parts, style=register_style(title)
    )
    return write_page(document, folder)


def write_page(document: Document, folder: Path) -> Path:
    """Write a page; the figure of an earlier one in the folder is replaced or removed.

    Raises:
        InputError: the folder cannot be written.
    """
    path = write_document(document, folder)
    if not document.figures:
        for kind in ("svg", "png"):
            (folder / f"{FIGURE}.{kind}").unlink(missing_ok=True)
    return path
