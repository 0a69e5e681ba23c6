"""What a page of a register was made of: files with their checksums, and versions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bumpstop.register.register import checksum
from bumpstop.report.made_by import made_by
from bumpstop.report.markup import Html, breakable, element, paragraph, table
from bumpstop.report.section import Part

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from bumpstop.register import RegisterResult


class ProvenancePart(Part):
    """Checksums of what was read, before anything was computed, versions, and the command that repeats the page."""

    title = "Provenance"
    anchor = "provenance"

    def __init__(self, result: RegisterResult, further: Sequence[Path] = ()) -> None:
        self._files = {path: checksum(path) for path in further} | dict(result.register.checksums)

    def content(self) -> list[Html]:
        """Two tables and the command."""
        made = made_by()
        command = made.pop("command", "")
        found = [
            table(
                ("file", "SHA-256"),
                [
                    (breakable(str(path)), element("span", element("code", seen), _since(path, seen)))
                    for path, seen in self._files.items()
                ],
                caption="Files that were read",
            ),
            table(("", ""), list(made.items()), caption="Versions"),
        ]
        if command:
            found.append(paragraph("To repeat: ", element("code", command)))
        return found


def _since(path: Path, seen: str) -> str:
    """Whether a file is another one now."""
    return "" if checksum(path) == seen else " (changed while the page was made: make it again)"
