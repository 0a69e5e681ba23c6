"""Where ``tune`` and ``score`` get residuals from: a file of them, or a recording with a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.detection import DetectionRun, ResidualSeries, Thresholds

Columns = Annotated[Path | None, typer.Option(help="Column file of the recording (TOML).")]


def load_series(path: Path, model: str | None, robot: str | None, columns: Path | None) -> ResidualSeries:
    """Residuals of a file that holds them, or of a contact-free recording.

    Raises:
        InputError: a file that cannot be used, or a model given for residuals that need none.
    """
    from bumpstop.detection import ResidualSeries, residual_record

    if holds_residuals(path):
        for option, value in (("--model", model), ("--robot", robot), ("--columns", columns)):
            if value is not None:
                raise InputError(option, f"has no meaning with the residuals of {str(path)!r}", "leave it out")
        return ResidualSeries.load(path)
    from bumpstop.cli.arm_recordings import part_of
    from bumpstop.cli.detect import load_model

    given, arm = load_model(model, robot, None, None)
    record = residual_record(part_of(path, columns, arm, None, None), arm, given)
    assert record.t is not None
    return ResidualSeries(record.t, record.rows, str(path))


def load_run(
    path: Path, thresholds: Thresholds, model: str | None, robot: str | None, columns: Path | None, rearm_s: float
) -> tuple[ResidualSeries, DetectionRun]:
    """Residuals of a recording, without its blind rows, and what the detector made of them."""
    from bumpstop.cli.arm_recordings import part_of
    from bumpstop.cli.detect import load_model
    from bumpstop.detection import ResidualSeries, detect

    given, arm = load_model(model, robot, None, None)
    run = detect(part_of(path, columns, arm, None, None), arm, given, thresholds, rearm_s=rearm_s)
    seen = ~run.blind
    return ResidualSeries(run.t[seen], run.residual[seen], str(path)), run


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
