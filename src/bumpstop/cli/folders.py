"""Folders and files that ``--out`` and other options name: refused before any work is done for them."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.errors import InputError, where_else
from bumpstop.text_files import parse_toml, read_text

if TYPE_CHECKING:
    from typing import Any

    from bumpstop.collision import Scenario


def check_folder(folder: Path | None, option: str = "--out") -> None:
    """Refuse a folder that can be neither made nor written into, before any work is done for it.

    Raises:
        InputError: it is a file or lies below one, its place may not be written, or it holds a page that is read-only.
    """
    if folder is None:
        return
    place = folder
    try:
        # A link that leads nowhere is there, too: no folder can be made in its place.
        there = next(place for place in (folder, *folder.parents) if place.exists() or place.is_symlink())
        why = "Not a directory" if not there.is_dir() else "" if os.access(there, os.W_OK) else "Permission denied"
        page = folder / "report.html"
        if not why and page.exists() and not os.access(page, os.W_OK):
            place, why = page, "Permission denied"
    except OSError as error:  # on the way there is a folder that may not be looked into
        why = error.strerror or str(error)
    if why:
        raise InputError(option, f"{str(place)!r} cannot be written ({why})", "give another folder")


def check_no_job(folder: Path | None) -> None:
    """Refuse the folder of a study or campaign, before any work is done: others' settings would make it useless.

    Raises:
        InputError: it is one, or what is left of one.
    """
    if folder is None:
        return
    from bumpstop.shards.result_folder import MANIFEST
    from bumpstop.shards.settings_file import SETTINGS, read_made_by

    made_by = {}
    with suppress(OSError):
        made_by = read_made_by((folder / SETTINGS).read_bytes())
    # Other programs, too, have folders and a manifest of these names: only files of a job tell.
    files = (("shards", "*.arrow"), ("rows", "*.parquet"))
    left = [name for name, pattern in files if any((folder / name).glob(pattern))]
    with suppress(OSError):
        if b'"fingerprint"' in (folder / MANIFEST).read_bytes():
            left.insert(0, MANIFEST)
    if "fingerprint" in made_by:
        kind = "a campaign" if made_by.get("study") == "campaign" else "a study"
        what = f"{kind} ({SETTINGS})"
    elif left:
        what = f"{left[0]} of a study or campaign"
    else:
        return
    raise InputError("--out", f"{str(folder)!r} holds {what}", "give another folder")


def check_inputs(out: Path | None, read: Iterable[str | Path | None], *written: str, option: str = "--out") -> None:
    """Refuse an output where a file that is read would be written over, before any work is done.

    Args:
        out: a folder, or a file where nothing is ``written``.
        read: files that the command reads; names that are of no file, such as a robot's, do no harm.
        written: names of the files that it writes into the folder, or patterns of them.
        option: that names the output.

    Raises:
        InputError: a file that is read is one of them, be it under another name: a symbolic or a hard link.
    """
    if out is None:
        return
    places = [place for pattern in written for place in out.glob(pattern)] if written else [out]
    other = "give another folder" if written else "give another file"
    for place, file in product(places, read):
        if file is not None and _is_same(place, file):
            raise InputError(option, f"{str(place)!r} is read, and would be written over", other)


def _is_same(place: Path, file: str | Path) -> bool:
    try:
        return place.is_file() and place.samefile(file)
    except (OSError, ValueError):  # what is not there is not read; ValueError: a NUL character in the path
        return False


def scenario_files(scenarios: Iterable[Scenario]) -> list[Path]:
    """Files that scenarios name, and that are read with them."""
    from bumpstop.collision.scenario.settings_file import files_of

    return [file for scenario in scenarios for file in files_of(scenario).values()]


def check_own(file: Path, is_own: Callable[[str, dict[str, Any]], bool], other: str = "give another place") -> None:
    """Refuse to replace a TOML file of somebody else's, before any work is done.

    Args:
        file: that is written.
        is_own: whether a file with this text, which says that, is one that the command wrote.
        other: what would be valid.

    Raises:
        InputError: it exists, and is not one that the command wrote.
    """
    if not file.exists():
        return
    with suppress(InputError):
        text = read_text(file, "wanted a file of this command")
        if is_own(text, parse_toml(text, str(file))):
            return
    raise InputError("--out", f"{str(file)!r} exists, and is no file of this command", other)


def check_file(file: Path | None, option: str = "--out") -> None:
    """Refuse a file that cannot be written into the folder it is in, before any work is done for it.

    Raises:
        InputError: it is a folder, or its folder does not exist or may not be written.
    """
    if file is None:
        return
    try:
        if file.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        with tempfile.TemporaryFile(dir=file.parent):
            pass
    except OSError as error:
        raise InputError(
            option, f"{str(file)!r} cannot be written ({error.strerror or error})", "give another file"
        ) from None


@contextmanager
def writing(folder: Path | None) -> Iterator[None]:
    """Make the folder, and say plainly where it cannot be written."""
    try:
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise InputError(
            "--out", f"{str(folder)!r} cannot be written ({error.strerror or error})", where_else(error)
        ) from None
