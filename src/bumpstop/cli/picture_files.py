"""Files that ``--picture`` names."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.errors import InputError
from bumpstop.output_files import write_bytes

if TYPE_CHECKING:
    from bumpstop.report.picture import Picture


def check_picture(path: Path | None, example: str) -> None:
    """Refuse another ending than those of pictures, before any work; ``example`` is a name with one of them."""
    if path is not None and path.suffix not in (".png", ".svg"):
        raise InputError("--picture", f"{str(path)!r} is neither .png nor .svg", f"for example --picture {example}")


def save_picture(picture: Picture, path: Path) -> None:
    """Draw into a file, as its ending says."""
    drawn = picture.render()
    try:
        write_bytes(path, drawn.png if path.suffix == ".png" else drawn.svg.encode("utf-8"))
    except OSError as error:
        problem = f"{str(path)!r} cannot be written ({error.strerror or error})"
        raise InputError("--picture", problem, "give another file") from None
