"""Figures of Schroeder (2013) and of the reference runs, typed out in TOML files that live outside the repository."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parent.parent


class MissingFacts(Exception):  # noqa: N818 - it is not an error of the program
    """A file of figures is not where it was looked for; the message says where that is."""


def folder() -> Path:
    """Where the figures are: ``$BUMPSTOP_SHARED``, or else ``shared`` beside the repository."""
    return Path(os.environ.get("BUMPSTOP_SHARED") or REPOSITORY.parent / "shared")


def load(name: str) -> dict[str, Any]:
    """Read ``facts/<name>.toml``.

    Raises:
        MissingFacts: it is not there.
    """
    path = folder() / "facts" / f"{name}.toml"
    if not path.is_file():
        raise MissingFacts(f"{path} is missing: set BUMPSTOP_SHARED to the folder that holds facts/{name}.toml")
    with path.open("rb") as file:
        return tomllib.load(file)
