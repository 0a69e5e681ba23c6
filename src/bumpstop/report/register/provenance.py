"""What a page of a register was made of: files with their checksums, and versions."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

from bumpstop.collision.scenario.settings_file import files_of
from bumpstop.report.made_by import made_by
from bumpstop.report.markup import Html, breakable, element, paragraph, table
from bumpstop.report.section import Part

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from bumpstop.register import Register, RegisterResult


class ProvenancePart(Part):
    """Checksums of every file that was read, versions, and the command that repeats the page."""

    title = "Provenance"
    anchor = "provenance"

    def __init__(self, result: RegisterResult, further: Sequence[Path] = ()) -> None:
        self._register, self._further = result.register, tuple(further)

    def content(self) -> list[Html]:
        """Two tables and the command."""
        made, files = made_by(), inputs_of(self._register, self._further)
        command = made.pop("command", "")
        found = [
            table(
                ("file", "SHA-256"),
                [(breakable(str(path)), element("code", checksum(path))) for path in files],
                caption="Files that were read",
            ),
            table(("", ""), list(made.items()), caption="Versions"),
        ]
        if command:
            found.append(paragraph("To repeat: ", element("code", command)))
        return found


def inputs_of(register: Register, further: Sequence[Path] = ()) -> list[Path]:
    """Every file that a register rests on, each once: registers, scenarios, and the files that scenarios name."""
    paths = list(register.files)
    for situation in register.situations:
        paths += files_of(situation.scenario).values()
    return list(dict.fromkeys([*paths, *further]))


def checksum(path: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal; why not, where it can no longer be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        return f"cannot be read ({error.strerror or error})"
