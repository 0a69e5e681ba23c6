"""A scenario that tests of the reader begin with."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

EXAMPLE = Path(__file__).parents[2] / "examples" / "01_hand_downward.toml"


def example() -> dict[str, Any]:
    return tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))
