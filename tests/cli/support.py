"""Running the command line inside the tests' own process."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from typing import Any, NamedTuple

from bumpstop.cli.main import main

REPOSITORY = Path(__file__).parents[2]
EXAMPLE = REPOSITORY / "examples" / "01_hand_downward.toml"


class Result(NamedTuple):
    status: int
    out: str
    err: str


def run(*arguments: object) -> Result:
    """What ``bumpstop ARGUMENTS`` returns and prints."""
    out, err = io.StringIO(), io.StringIO()
    status = None
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as end:
            status = end.code
    assert isinstance(status, int), "the command ends with its status"
    return Result(status, out.getvalue(), err.getvalue())


def evaluate(*changes: str, scenario: Path = EXAMPLE, options: tuple[object, ...] = ()) -> Result:
    """``bumpstop evaluate --json`` with changes."""
    sets = [part for change in changes for part in ("--set", change)]
    return run("evaluate", scenario, "--json", *sets, *options)


def strict_json(text: str) -> dict[str, Any]:
    """The one object in ``text``; NaN and Infinity, which are no JSON, are refused."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    value = json.loads(text, parse_constant=refuse)
    assert isinstance(value, dict)
    return value
