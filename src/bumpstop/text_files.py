"""Text that people write: read whole, but not without end, and refused in one sentence."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from bumpstop.errors import InputError

MOST_BYTES = 10_000_000


def read_text(
    path: str | os.PathLike[str], wanted: str, *, field: str | None = None, most_bytes: int = MOST_BYTES
) -> str:
    """The text of a file, without the mark that editors on Windows begin UTF-8 with.

    Args:
        path: of the file.
        wanted: what it should have been, as errors say it.
        field: what errors are about; they then quote the path. None: the path itself.
        most_bytes: longer files are refused, as a device would never end.

    Raises:
        InputError: the file cannot be read, is too long, or is not UTF-8.
    """
    name, quoted = (str(path), "") if field is None else (field, f"{str(path)!r} ")
    try:
        with Path(path).open("rb") as file:
            content = file.read(most_bytes + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the path
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(name, f"{quoted}cannot be read ({why})", wanted) from None
    if len(content) > most_bytes:
        raise InputError(name, f"{quoted}is longer than {most_bytes} bytes", wanted)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        problem = f"{quoted}is not UTF-8 text (byte {error.start + 1})"
        raise InputError(name, problem, f"{wanted}, saved as UTF-8") from None


def parse_toml(text: str, file: str) -> dict[str, Any]:
    """What a TOML document says; ``file`` is how errors call it.

    Raises:
        InputError: it is no TOML, or holds what nobody writes: numbers of thousands of digits, thousands of brackets.
    """
    import tomllib

    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(file, f"is not valid TOML: {' '.join(str(error).split())[:200]}") from None


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a file in UTF-8.

    Raises:
        InputError: it cannot be written.
    """
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(str(path), f"cannot be written ({error.strerror})") from None
