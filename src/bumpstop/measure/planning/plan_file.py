"""Plans as folders: the table to fill in, the settings, and the scenarios of the situations."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bumpstop.collision.scenario.scenario_file import load_scenario
from bumpstop.collision.scenario.settings_file import scenario_data
from bumpstop.errors import InputError, near_matches, where_else
from bumpstop.measure.learning.posterior import ErrorModel
from bumpstop.measure.planning.filled_shots import WANTED, FilledShot, read_shots
from bumpstop.measure.reading.text_table import read_text_table
from bumpstop.register.shots import COLUMNS as SHOT_COLUMNS
from bumpstop.register.situation import Situation, common_statements
from bumpstop.register.statements import OPEN_STATUSES, Statement, read_statements
from bumpstop.text_files import as_path, parse_toml, read_text, to_toml, write_text

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario import Scenario
    from bumpstop.measure.planning.plan import MeasurementPlan

TABLE, SETTINGS, SCENARIOS = "plan.csv", "plan.toml", "situations"
REGISTER = "calibrated_register.toml"
"""Stands beside calibrated scenarios: none of them has this name."""
COLUMNS = (
    *SHOT_COLUMNS,
    "recording",
    "remark",
    "distribution_p5_N",
    "distribution_p95_N",
    "expected_spread_percent",
)
_TO_FILL = ("measured_peak_force_N", "recording", "remark")


def table_text(plan: MeasurementPlan) -> str:
    """The table to fill in, as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for shot in plan.shots:
        writer.writerow(
            (
                shot.situation,
                shot.number,
                f"{shot.speed_mm_s:.10g}",
                f"{shot.predicted_N:.2f}",
                f"{shot.low_N:.2f}",
                f"{shot.high_N:.2f}",
                "",
                "",
                "",
                f"{shot.distribution_N[0]:.2f}",
                f"{shot.distribution_N[1]:.2f}",
                f"{100 * shot.spread:.3g}",
            )
        )
    return text.getvalue()


def write_plan(plan: MeasurementPlan, folder: Path, situations: Sequence[Situation] = ()) -> Path:
    """Write ``plan.csv``, ``plan.toml`` and a scenario for each situation; returns the path of the table.

    Args:
        plan: to write.
        folder: made where it is missing.
        situations: of registers that the plan is of: what their rows say besides scenarios is kept for calibrated ones.

    Raises:
        InputError: the folder cannot be written, or has a plan whose table is filled in.
    """
    table = folder / TABLE
    if table.exists() and _is_filled(table):
        raise InputError(str(table), "is filled in already", "give another folder, or move the table away")
    try:
        (folder / SCENARIOS).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("--out", f"{str(folder)!r} cannot be written ({error.strerror})", where_else(error)) from None
    rows: list[dict[str, Any]] = []
    facts = {each.name: each.facts for each in situations}
    for name, file in file_names([each.name for each in plan.situations]).items():
        write_text(folder / SCENARIOS / file, to_toml(scenario_data(plan.situation(name).scenario)))
        situation = plan.situation(name)
        at = {} if situation.onset_s is None else {"contact_onset_s": situation.onset_s}
        rows.append({"name": name, "file": f"{SCENARIOS}/{file}", "gauge": situation.gauge.device} | at)
        rows[-1] |= facts.get(name, {})
    settings: dict[str, Any] = {
        "points": plan.points,
        "seed": plan.seed,
        "gauge_error": plan.errors.gauge,
        "model_error": plan.errors.model,
        "fixed": list(plan.fixed),
        "spread": {each.key: each.sd for each in plan.parameters.each},
        "situation": rows,
        "input": inputs_of_register(common_statements(situations)),
    }
    write_text(folder / SETTINGS, to_toml(settings))
    write_text(table, table_text(plan))
    return table


def inputs_of_register(statements: Mapping[str, Statement]) -> list[dict[str, str]]:
    """The ``[[input]]`` tables of statements, as registers have them."""
    return [
        {"key": key, "status": statement.status} | ({"source": statement.source} if statement.source else {})
        for key, statement in statements.items()
    ]


def _is_filled(path: Path) -> bool:
    """Whether people have written into a table: into cells left empty for them, or columns of their own."""
    table = read_text_table(path, WANTED)
    planned = set(COLUMNS).difference(_TO_FILL)
    own = [column for column, name in enumerate(table.names) if name not in planned]
    return bool(table.beyond) or any(row[column].strip() for row in table.rows for column in own)


@dataclass(frozen=True)
class PlanFolder:
    """A plan that was written, and what has been filled in.

    Attributes:
        shots: rows of the table.
        named: names and scenarios of the situations.
        devices: gauge of each situation, by name; empty of a table without its folder.
        onsets: time of each trajectory at which the gauge is met, by name of the situation [s].
        spread: of the parameters before anything is measured, by key; empty: as assumed.
        fixed: keys that are known.
        facts: what rows of registers say besides scenarios, by name of the situation.
        statements: of those registers, by dotted key or table.
        errors: how far shots may be off.
        seed, points: of the ensemble.
        folder: where recordings start.
        files: that were read, and recordings that rows name.
    """

    shots: tuple[FilledShot, ...]
    named: tuple[tuple[str, Scenario], ...]
    devices: Mapping[str, str]
    onsets: Mapping[str, float]
    spread: Mapping[str, float]
    fixed: tuple[str, ...]
    facts: Mapping[str, Mapping[str, Any]]
    statements: Mapping[str, Statement]
    errors: ErrorModel
    seed: int
    points: int
    folder: Path
    files: tuple[Path, ...]

    def with_rows_of(self, given: Sequence[Situation]) -> PlanFolder:
        """The plan with what the rows of situations say that were given in place of its own.

        Of values only what keeps a situation from passing stays: the rest was said of others.
        """
        if not given:
            return self
        facts = {one.name: {**self.facts.get(one.name, {}), **one.facts} for one in given}
        said = {**self.statements, **common_statements(given)}
        open_ones = {key: statement for key, statement in said.items() if statement.status in OPEN_STATUSES}
        return replace(self, facts={**self.facts, **facts}, statements=open_ones)


def load_plan(path: Path, scenarios: Mapping[str, Scenario] | None = None) -> PlanFolder:
    """Read a plan.

    Args:
        path: the folder, or its table.
        scenarios: by name of the situation, in place of the folder's.

    Raises:
        InputError: a file is missing or damaged, or a situation has no scenario.
    """
    path = as_path(path, "plan")
    table = path / TABLE if path.is_dir() else path
    folder = table.parent
    shots = read_shots(table)
    settings_file = folder / SETTINGS
    given = dict(scenarios or {})
    data: dict[str, Any] = {}
    if settings_file.exists():
        data = parse_toml(read_text(settings_file, "wanted the plan.toml of bumpstop measure plan"), str(settings_file))
    named: dict[str, Scenario] = {}
    devices: dict[str, str] = {}
    onsets: dict[str, float] = {}
    facts: dict[str, dict[str, Any]] = {}
    statements, faults = read_statements(data.get("input", []), str(settings_file))
    if faults:
        raise faults[0]
    files = [table, settings_file, *(folder / shot.recording for shot in shots if shot.recording)]
    for number, row in enumerate(_rows(data, settings_file), start=1):
        for key in ("name", "file", "gauge"):
            if not isinstance(row.get(key), str):
                raise InputError(f"{settings_file}, situation {number}, {key}", "is missing", "wanted text")
        files.append(folder / row["file"])
        named[row["name"]] = given.pop(row["name"]) if row["name"] in given else load_scenario(files[-1])
        if row["gauge"] != "scenario":
            devices[row["name"]] = row["gauge"]
        if "contact_onset_s" in row:
            onsets[row["name"]] = _number(row, "contact_onset_s", settings_file)
        facts[row["name"]] = {key: row[key] for key in ("payload_kg", "frequency", "note") if key in row}
    named |= given
    for shot in shots:
        if shot.situation not in named:
            where = f"{table}, row {shot.row}, situation"
            valid = near_matches(shot.situation, named) if named else "give its scenario: --scenario FILE"
            raise InputError(where, f"{shot.situation!r} has no scenario", valid)
    default = ErrorModel()
    return PlanFolder(
        shots=shots,
        named=tuple(named.items()),
        devices=devices,
        onsets=onsets,
        spread={str(key): _number(data["spread"], key, settings_file) for key in data.get("spread", {})},
        fixed=tuple(str(key) for key in data.get("fixed", [])),
        facts=facts,
        statements=statements,
        errors=ErrorModel(
            gauge=_number(data, "gauge_error", settings_file) if "gauge_error" in data else default.gauge,
            model=_number(data, "model_error", settings_file) if "model_error" in data else default.model,
        ),
        seed=int(_number(data, "seed", settings_file)) if "seed" in data else 0,
        points=int(_number(data, "points", settings_file)) if "points" in data else 128,
        folder=folder,
        files=tuple(files),
    )


def _number(data: Mapping[str, Any], key: str, file: Path) -> float:
    value = data[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf:
        raise InputError(f"{file}, {key}", f"{value!r} cannot be used", "wanted a number from zero on")
    return float(value)


def _rows(data: Mapping[str, Any], file: Path) -> list[dict[str, Any]]:
    rows = data.get("situation", [])
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{file}, situation", "cannot be used", "wanted [[situation]] tables")
    return rows


def file_names(names: list[str]) -> dict[str, str]:
    """A file for each name: letters that every file system takes, and no two alike."""
    found: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_")[:60] or "situation"
        taken = {REGISTER, *(file.lower() for file in found.values())}
        file, number = f"{plain}.toml", 2
        while file.lower() in taken:
            file, number = f"{plain}_{number}.toml", number + 1
        found[name] = file
    return found
