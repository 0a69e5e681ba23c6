"""Files that ``--picture`` names."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.cli.folders import check_inputs
from bumpstop.errors import InputError
from bumpstop.output_files import write_bytes

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bumpstop.report.picture import Picture


def check_picture(path: Path | None, example: str, read: Iterable[str | Path | None]) -> None:
    """Refuse another ending than those of pictures, before any work, and a file that the command reads.

    ``example`` is a name with one of these endings.
    """
    if path is not None and path.suffix not in (".png", ".svg"):
        raise InputError("--picture", f"{str(path)!r} is neither .png nor .svg", f"for example --picture {example}")
    check_inputs(path, read, option="--picture")


def save_picture(picture: Picture, path: Path) -> None:
    """Draw into a file, as its ending says."""
    drawn = picture.render()
    try:
        write_bytes(path, drawn.png if path.suffix == ".png" else drawn.svg.encode("utf-8"))
    except OSError as error:
        problem = f"{str(path)!r} cannot be written ({error.strerror or error})"
        raise InputError("--picture", problem, "give another file") from None
