"""Scenario files, and the robot that one names."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bumpstop.collision.scenario.keys import set_keys, told_to_take_out
from bumpstop.collision.scenario.scenario import Scenario
from bumpstop.errors import InputError
from bumpstop.text_files import as_path, read_text

if TYPE_CHECKING:
    from bumpstop.model import Robot

# Beyond this it is no scenario, but perhaps a recording or a device that never ends.
_MAX_BYTES = 1_000_000
_MAX_DOTS = 500  # in a line


def load_scenario(path: str | Path, changes: dict[str, Any] | None = None) -> Scenario:
    """Read a scenario file.

    Args:
        path: of a TOML file.
        changes: dotted keys and values that replace those of the file before it is checked; None, or the word
            ``none``, takes a key out.

    Raises:
        InputError: the file is absent or damaged, or a key is unknown, missing or has an unusable value.
    """
    path = as_path(path, "scenario")
    data = read_tables(path)
    set_keys(data, changes or {})
    try:
        return Scenario.from_dict(data, path.parent)
    except InputError as error:
        raise told_to_take_out(error, changes or {}) from None


def read_tables(path: Path) -> dict[str, Any]:
    """The tables of a scenario file, not checked yet.

    Raises:
        InputError: the file is absent, damaged or a register.
    """
    tables = _parse(read_text(path, "wanted a scenario file", max_bytes=_MAX_BYTES), str(path))
    if isinstance(tables.get("situation"), list):
        valid = "wanted a scenario, as its rows name; bumpstop evaluate, report and measure plan take registers"
        raise InputError(str(path), "is a register of contact situations", valid)
    return tables


def _parse(text: str, path: str) -> dict[str, Any]:
    shallow = "tables one level deep"
    # The parser takes time with the square of a key's depth.
    if any(line.partition("#")[0].count(".") > _MAX_DOTS for line in text.splitlines()):
        raise InputError(path, "is nested too deeply", f"wanted {shallow}")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(path, f"is not valid TOML: {error}") from None
    except RecursionError:
        raise InputError(path, "is nested too deeply", f"wanted {shallow}") from None
    except ValueError:
        raise InputError(path, "holds a number of thousands of digits", "wanted numbers below 1e10") from None


def robot_of(scenario: Scenario) -> Robot:
    """The arm of a scenario.

    Raises:
        InputError: there is none of that name, or its file cannot be used.
    """
    from bumpstop.model import Robot

    path = scenario.robot_path
    if path is None:
        return Robot.load(scenario.robot)
    try:
        return Robot.from_urdf(path, scenario.base, scenario.tip)
    except InputError as error:
        if error.field in ("base", "tip"):
            raise
        raise InputError("robot", f"{error.field}: {error.problem}", error.valid) from None
