"""Text that people write and read: read whole, but not without end, and refused in one sentence; and TOML."""

from __future__ import annotations

import codecs
import math
import numbers
import os
import re
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from bumpstop.errors import InputError, near_matches
from bumpstop.output_files import write_bytes

MAX_BYTES = 10_000_000
_MAX_INTEGER = 2**64
_NAMED_FILES = 3  # of a folder that was given in place of one of them


def is_path(robot: str) -> bool:
    """Whether a robot is given by the path of its URDF, and not by the name of a built-in one."""
    return bool(Path(robot).suffix) or "/" in robot


def other_robot(name: str, other: str) -> bool:
    """Whether two names, of a file and of whoever reads it, are those of different robots.

    An empty name and the path of a file tell nothing. Case and signs between words do not count, and one name may say
    more than the other: the URDF of a ``ur10e`` calls itself ``ur10e_robot``.
    """
    if is_path(name) or is_path(other):
        return False
    one, two = (re.findall(r"[^\W_]+", text.lower()) for text in (name, other))
    return not ({*one} <= {*two} or {*two} <= {*one} or "".join(one) == "".join(two))


def as_path(value: Any, field: str) -> Path:
    """Turn ``value`` into a path.

    Raises:
        InputError: it is neither text nor a path.
    """
    try:
        return Path(value)
    except TypeError:
        problem = f"a value of type {type(value).__name__} is no path"
        raise InputError(field, problem, "wanted text or a pathlib.Path") from None


def is_folder(path: Path) -> bool:
    """Whether there is a folder of that name; a name that no file can have is none."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def _file_in(folder: Path, wanted: str) -> str:
    """What was wanted, and which files of a folder may have been meant, as of ``identify --out FOLDER``."""
    found = sorted(str(file) for file in folder.glob("*.toml") if file.is_file())[:_NAMED_FILES]
    return "; ".join(filter(None, (wanted, f"in it is {' and '.join(found)}" if found else "")))


def read_text(
    path: str | os.PathLike[str],
    wanted: str,
    *,
    field: str | None = None,
    max_bytes: int = MAX_BYTES,
    of_device: bool = False,
) -> str:
    """The text of a file, without the mark that editors on Windows begin UTF-8 with.

    Args:
        path: of the file.
        wanted: what it should have been, as errors say it.
        field: what errors are about; they then quote the path. None: the path itself.
        max_bytes: longer files are refused, as a device would never end.
        of_device: programs of instruments on Windows may have written it: UTF-16 with its mark, and Windows-1252 where
            it is not UTF-8, are taken, too. Numbers are the same in all of them.

    Raises:
        InputError: the file cannot be read, is too long, or is not UTF-8.
    """
    path = as_path(path, field or "path")
    name, quoted = (str(path), "") if field is None else (field, f"{str(path)!r} ")
    try:
        with path.open("rb") as file:
            content = file.read(max_bytes + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the path
        if is_folder(path):
            raise InputError(name, f"{quoted}is a folder", _file_in(path, wanted)) from None
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(name, f"{quoted}cannot be read ({why})", wanted) from None
    if len(content) > max_bytes:
        raise InputError(name, f"{quoted}is longer than {max_bytes} bytes", wanted)
    marked = of_device and content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        return content.decode("utf-16" if marked else "utf-8-sig")
    except UnicodeDecodeError as error:
        if of_device and not marked:
            return content.decode("cp1252", "replace")
        problem = f"{quoted}is not {'UTF-16' if marked else 'UTF-8'} text (byte {error.start + 1})"
        raise InputError(name, problem, f"{wanted}, saved as UTF-8") from None


def parse_toml(text: str, file: str) -> dict[str, Any]:
    """What a TOML document says; ``file`` is how errors call it.

    Raises:
        InputError: it is no TOML, or holds numbers of thousands of digits, or thousands of brackets.
    """
    import tomllib

    try:
        return {key: _held(value) for key, value in tomllib.loads(text).items()}
    except (ValueError, RecursionError) as error:
        raise InputError(file, f"is not valid TOML: {' '.join(str(error).split())[:200]}") from None


def check_keys(data: Mapping[str, Any], known: Iterable[str], where: str, what: str) -> None:
    """Refuse keys of a table that are none; ``where`` stands before them in errors, ``what`` has them: "a robot file".

    Raises:
        InputError: names the key, and those that are like it.
    """
    for key in data:
        if key not in known:
            raise InputError(f"{where}{key}", f"is not a key of {what}", near_matches(str(key), known))


def needed(data: Mapping[str, Any], key: str, where: str) -> Any:
    """The value of a key that a table must have.

    Raises:
        InputError: it has none.
    """
    if key not in data:
        raise InputError(f"{where}{key}", "is missing")
    return data[key]


def _held(value: Any) -> Any:
    """The same, integers beyond what TOML allows being infinite: whoever reads a field refuses it by its name."""
    if isinstance(value, dict):
        return {key: _held(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_held(inner) for inner in value]
    if isinstance(value, int) and abs(value) > _MAX_INTEGER:
        return math.inf if value > 0 else -math.inf
    return value


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a file in UTF-8, with line feeds alone at the ends of its lines.

    Raises:
        InputError: it cannot be written, or the text holds what is no text, as the name of a file may.
    """
    path = as_path(path, "path")
    try:
        write_bytes(path, text.encode("utf-8"))
    except UnicodeEncodeError as error:
        problem = f"cannot be written: {text[max(0, error.start - 20) : error.end]!r} is no text"
        raise InputError(str(path), problem, "wanted names of files in UTF-8") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the path
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(str(path), f"cannot be written ({why})") from None


def shown(text: str | Path) -> str:
    """The same for people: bytes of names of files that are no UTF-8 are written with escapes, as errors show them."""
    return str(text).encode("utf-8", "backslashreplace").decode("utf-8")


def encoded(text: str, field: str) -> bytes:
    """A text in UTF-8.

    Raises:
        InputError: about ``field``: it holds what is no text, as the name of a file may.
    """
    try:
        return text.encode("utf-8")
    except UnicodeEncodeError as error:
        problem = f"{text[max(0, error.start - 20) : error.end]!r} is no text"
        raise InputError(field, problem, "wanted names of files in UTF-8") from None


def running_command() -> str:
    """The ``bumpstop`` command that runs, as a shell takes it; empty in any other program."""
    return shell_command(["bumpstop", *sys.argv[1:]]) if Path(sys.argv[0]).name == "bumpstop" else ""


def shell_command(words: Sequence[str]) -> str:
    """A command on one line, quoted so that a shell takes it as it was given.

    A word with what cannot be printed, such as a newline or bytes that are no UTF-8, is written between ``$'`` and
    ``'`` with escapes, as bash reads it.
    """

    def quoted(word: str) -> str:
        if word.isprintable():
            return shlex.quote(word)
        known = {"\n": "\\n", "\t": "\\t", "\r": "\\r", "'": "\\'", "\\": "\\\\"}
        return (
            "$'"
            + "".join(
                known.get(c) or (c if c.isprintable() else "".join(f"\\x{byte:02x}" for byte in os.fsencode(c)))
                for c in word
            )
            + "'"
        )

    return " ".join(quoted(word) for word in words)


def to_toml(data: Mapping[str, Any]) -> str:
    """Nested tables and lists of tables as TOML, with all digits."""
    import tomli_w

    return tomli_w.dumps({key: _plain(value) for key, value in data.items()})


def toml_value(value: Any) -> str:
    """A number, a boolean, a text, or a list of them as TOML on one line; anything else as its text."""
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    return to_toml({"value": value}).removeprefix("value = ").rstrip("\n")


def _plain(value: Any) -> Any:
    """The same of Python's own types: numpy's numbers are none that TOML knows."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, bool):
        return value
    if isinstance(value, numbers.Integral):
        return int(value)
    return float(value) if isinstance(value, numbers.Real) else str(value)


def list_items(text: str) -> list[str]:
    """The items of a list that a person writes on the command line: ``1,2,3``, with or without brackets and spaces."""
    inside = text.strip()
    if inside.startswith("[") and inside.endswith("]"):
        inside = inside[1:-1]
    return [item.strip() for item in inside.split(",")]
