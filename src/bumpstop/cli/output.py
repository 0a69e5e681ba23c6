"""The files of ``bumpstop evaluate --out``."""

from __future__ import annotations

import platform
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.collision import ForceLaw


def write_outputs(law: ForceLaw, folder: Path) -> Path:
    """Write report.html with its figures, law.parquet and settings.toml; returns the report's path.

    Raises:
        InputError: the folder cannot be written.
    """
    from bumpstop.collision.tables import law_table
    from bumpstop.report import write_report

    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "settings.toml").write_text(settings_toml(law), encoding="utf-8")
        law_table(law).write_parquet(folder / "law.parquet")
        return write_report(law, folder)
    except OSError as error:
        raise InputError(
            "--out",
            # The Parquet writer puts everything into the message.
            f"{str(folder)!r} cannot be written ({error.filename or folder}: {error.strerror or error})",
            "give another folder",
        ) from None


def settings_toml(law: ForceLaw) -> str:
    """Scenario, law and versions: enough to repeat the evaluation.

    The file is itself a scenario: its reader passes over the table ``[made_by]``.
    """
    from bumpstop.collision.scenario import MADE_BY
    from bumpstop.kernels import target

    made_by: dict[str, Any] = {"law": law.kind}
    if law.kind == "sampled":
        made_by |= {"samples": law.samples, "seed": law.seed}
    made_by |= {
        "bumpstop": version("bumpstop"),
        "numpy": version("numpy"),
        "python": platform.python_version(),
    }
    made_by["instruction_set"] = target
    data = law.scenario.to_dict()
    limits = law.scenario.contact.limits
    if law.scenario.contact.body is not None and (limits.endswith(".toml") or "/" in limits):
        # Relative paths start at the scenario's folder, which the copy has left.
        data["contact"]["limits"] = str((law.scenario.folder / limits).resolve())
    if law.scenario.detector.residuals is not None:
        data["detector"]["residuals"] = str((law.scenario.folder / law.scenario.detector.residuals).resolve())
    if law.scenario.robot_path is not None:
        data["robot"] = str(law.scenario.robot_path.resolve())
    if law.scenario.motion.file is not None:
        data["motion"]["file"] = str((law.scenario.folder / law.scenario.motion.file).resolve())
    options = f" --sampled {law.samples} --seed {law.seed}" if law.kind == "sampled" else ""
    return f"# To repeat: bumpstop evaluate settings.toml{options}\n" + to_toml(data | {MADE_BY: made_by})


def to_toml(data: dict[str, Any]) -> str:
    """Write nested dictionaries of numbers, texts, booleans and lists as TOML, one level of tables deep."""
    lines = [f"{key} = {_value(value)}" for key, value in data.items() if not isinstance(value, dict)]
    for key, table in data.items():
        if isinstance(table, dict):
            lines += ["", f"[{key}]", *(f"{inner} = {_value(value)}" for inner, value in table.items())]
    return "\n".join(lines) + "\n"


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    escaped = "".join(
        {"\\": "\\\\", '"': '\\"'}.get(c, c if c >= " " and c != "\x7f" else f"\\u{ord(c):04x}") for c in str(value)
    )
    return f'"{escaped}"'
