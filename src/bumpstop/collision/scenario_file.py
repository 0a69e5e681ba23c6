"""Scenario files."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from bumpstop.collision.scenario import Scenario, set_key
from bumpstop.errors import InputError

# Beyond this it is no scenario, but perhaps a recording or a device that never ends.
_MOST_BYTES = 1_000_000
_MOST_DOTS = 500  # in a line


def load_scenario(path: str | Path, changes: dict[str, Any] | None = None) -> Scenario:
    """Read a scenario file.

    Args:
        path: of a TOML file.
        changes: dotted keys and values that replace those of the file before it is checked.

    Raises:
        InputError: the file is absent or damaged, or a key is unknown, missing or has an unusable value.
    """
    path = Path(path)
    wanted = "wanted a scenario file"
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({error.strerror})", wanted) from None
    except ValueError as error:  # a NUL character in the path
        raise InputError(str(path), f"cannot be read ({error})", wanted) from None
    if len(content) > _MOST_BYTES:
        raise InputError(str(path), f"is longer than {_MOST_BYTES} bytes", wanted)
    try:
        # Editors on Windows begin UTF-8 files with a mark that TOML does not know.
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            str(path), f"is not UTF-8 text (byte {error.start + 1})", f"{wanted}, saved as UTF-8"
        ) from None
    data = _parse(text, str(path))
    for key, value in (changes or {}).items():
        set_key(data, key, value)
    return Scenario.from_dict(data, path.parent)


def _parse(text: str, path: str) -> dict[str, Any]:
    shallow = "tables one level deep"
    # The parser takes time with the square of a key's depth.
    if any(line.partition("#")[0].count(".") > _MOST_DOTS for line in text.splitlines()):
        raise InputError(path, "is nested too deeply", f"wanted {shallow}")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(path, f"is not valid TOML: {error}") from None
    except RecursionError:
        raise InputError(path, "is nested too deeply", f"wanted {shallow}") from None
    except ValueError:
        raise InputError(path, "holds a number of thousands of digits", "wanted numbers below 1e10") from None
