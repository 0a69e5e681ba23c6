"""The dossier: one page of a cell that is printed, signed and filed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.contact import LimitTable, builtin_tables
from bumpstop.register.inputs import tables_used
from bumpstop.register.measured import judged_shots
from bumpstop.report.document import Document
from bumpstop.report.register.assumptions import AssumptionsPart
from bumpstop.report.register.documents import DocumentsPart
from bumpstop.report.register.inputs import InputsPart
from bumpstop.report.register.limit_tables import LimitTablesPart
from bumpstop.report.register.measurements import MeasurementsPart
from bumpstop.report.register.page import write_page
from bumpstop.report.register.provenance import ProvenancePart
from bumpstop.report.register.register_style import register_style
from bumpstop.report.register.situations import OutcomePart, SituationsPart
from bumpstop.report.register.stopping_data import StoppingDataPart

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.register import RegisterResult
    from bumpstop.register.shots import Shot
    from bumpstop.report.section import Part


@dataclass(frozen=True, kw_only=True)
class DossierHead:
    """What a dossier is called.

    Attributes:
        cell: the cell that is judged.
        author: who answers for it.
        revision: of this document.
    """

    cell: str
    author: str
    revision: str

    def rows(self) -> dict[str, str]:
        """Rows of the table on top, with room for a signature."""
        return {
            "cell": self.cell,
            "revision": self.revision,
            "author": self.author,
            "date and signature": "",
        }


def write_dossier(
    result: RegisterResult,
    folder: Path,
    head: DossierHead,
    shots: Sequence[Shot] = (),
    shot_files: Sequence[Path] = (),
) -> Path:
    """Write ``report.html`` of a cell and its figure; returns the page's path.

    The same result, head and shots give the same bytes, but for the date and the command in it.

    Args:
        result: of the register.
        folder: made where it is missing.
        head: cell, author and revision.
        shots: of the force gauge, planned and measured.
        shot_files: that they were read from.

    Raises:
        InputError: the folder cannot be written.
    """
    situations = result.register.situations
    builtin = [LimitTable.load(name) for name in builtin_tables()]
    parts: list[Part] = [
        OutcomePart(result, head.rows()),
        SituationsPart(result),
        AssumptionsPart(result.results),
        MeasurementsPart(judged_shots(result, shots), [one.situation.name for one in result.results]),
        StoppingDataPart(situations),
        InputsPart(result.results),
        LimitTablesPart([*tables_used(list(situations)), *builtin]),
        DocumentsPart(),
        ProvenancePart(result, shot_files),
    ]
    name = f"{head.cell}, revision {head.revision}"
    document = Document(
        f"Contact situations of {head.cell}",
        f"bumpstop dossier; revision {head.revision}",
        "dossier",
        parts,
        style=register_style(name),
    )
    return write_page(document, folder)
