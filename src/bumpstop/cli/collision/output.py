"""The files of ``bumpstop evaluate --out``."""

from __future__ import annotations

import platform
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError, where_else
from bumpstop.output_files import write_bytes, write_parquet
from bumpstop.text_files import encoded

if TYPE_CHECKING:
    from bumpstop.collision import CollisionResult
    from bumpstop.uncertainty import UncertainResult


def write_outputs(result: CollisionResult, folder: Path, uncertain: UncertainResult | None = None) -> Path:
    """Write report.html with its figures, law.parquet and settings.toml; returns the report's path.

    Args:
        result: of the scenario, of ``[uncertainty]`` that of the central case.
        folder: made where it is missing.
        uncertain: the verdict with an interval, where the scenario has ``[uncertainty]``.

    Raises:
        InputError: the folder cannot be written.
    """
    from bumpstop.collision.tables import result_table
    from bumpstop.report import write_report

    settings = encoded(settings_toml(result, uncertain), "scenario")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_bytes(folder / "settings.toml", settings)
        write_parquet(folder / "law.parquet", result_table(result))
        return write_report(result, folder, uncertain=uncertain)
    except OSError as error:
        raise InputError(
            "--out",
            f"{str(folder)!r} cannot be written ({error.filename or folder}: {error.strerror or error})",
            where_else(error),
        ) from None


def settings_toml(result: CollisionResult, uncertain: UncertainResult | None = None) -> str:
    """Scenario, distribution and versions: enough to repeat the evaluation.

    The file is itself a scenario: its reader passes over the table ``[made_by]``.
    """
    from bumpstop._native import target
    from bumpstop.collision.scenario.keys import MADE_BY
    from bumpstop.collision.scenario.settings_file import scenario_data
    from bumpstop.text_files import to_toml

    made_by: dict[str, Any] = {"law": result.kind}
    if result.kind == "sampled":
        made_by |= {"samples": result.samples, "seed": result.seed}
    made_by |= {
        "bumpstop": version("bumpstop"),
        "numpy": version("numpy"),
        "python": platform.python_version(),
    }
    made_by["instruction_set"] = target
    # Of the scenario as given, not of its central case.
    data = scenario_data(result.scenario if uncertain is None else uncertain.scenario)
    options = f" --sampled {result.samples} --seed {result.seed}" if result.kind == "sampled" else ""
    return f"# To repeat: bumpstop evaluate settings.toml{options}\n" + to_toml(data | {MADE_BY: made_by})
