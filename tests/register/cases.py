"""Registers that several tests read."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from bumpstop.text_files import to_toml

REPOSITORY = Path(__file__).parents[2]
SCENARIO = REPOSITORY / "examples" / "01_hand_downward.toml"
EXAMPLES = REPOSITORY / "examples" / "register"


def write_register(folder: Path, *rows: dict[str, Any], inputs: tuple[dict[str, str], ...] = ()) -> Path:
    """A register of TOML on a copy of the first example."""
    (folder / "cell.toml").write_text(SCENARIO.read_text(encoding="utf-8"), encoding="utf-8")
    path = folder / "register.toml"
    data: dict[str, Any] = {"scenario": "cell.toml", "situation": list(rows)}
    if inputs:
        data["input"] = list(inputs)
    path.write_text(to_toml(data), encoding="utf-8")
    assert tomllib.loads(path.read_text(encoding="utf-8"))["scenario"] == "cell.toml"
    return path
