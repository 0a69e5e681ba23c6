"""Where ``tune`` and ``score`` get residuals from: a file of them, or a recording with a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bumpstop.cli.robots import load_robot
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.detection import ResidualSeries

Model = Annotated[
    Path | None, typer.Option(help="Joint model, or what identify wrote (TOML), to predict a recording's torque.")
]
RobotName = Annotated[
    str | None, typer.Option(help="A built-in name, or the path of a URDF file; default: the model's.")
]
Columns = Annotated[Path | None, typer.Option(help="Column file of the recording (TOML).")]


def holds_residuals(path: Path) -> bool:
    """Whether a file is Parquet with a column ``residual_1``."""
    if path.suffix != ".parquet" or not path.is_file():
        return False
    import polars as pl

    try:
        return any(name.startswith("residual_") for name in pl.read_parquet_schema(path))
    except Exception:  # damaged: whoever reads it will say so
        return False


def joint_numbers(text: str, dof: int) -> list[int]:
    """Numbers from 0 of the joints that a person lists from 1."""
    try:
        numbers = [int(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or not all(1 <= number <= dof for number in numbers):
        raise InputError("--joints", f"{text[:80]!r} cannot be used", f"wanted numbers from 1 to {dof}, as 1,2,3")
    return [number - 1 for number in numbers]
