"""Settings files: a scenario written out in full, with what made a result beside it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from bumpstop.collision.scenario.keys import set_key
from bumpstop.collision.scenario.uncertainty_table import uncertain_inputs

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario import Scenario


def files_of(scenario: Scenario) -> dict[str, Path]:
    """Files that a scenario names, by their keys.

    Robot, limits, drive train, residuals, stopping table, trajectory, and the samples of uncertain inputs.
    """
    uncertain = (each for each in uncertain_inputs(scenario) if each.file is not None)
    return _files_of_keys(scenario) | {each.field: scenario.folder / str(each.file) for each in uncertain}


def _files_of_keys(scenario: Scenario) -> dict[str, Path]:
    """The same of keys outside ``[uncertainty]``."""
    contact, files = scenario.contact, {}
    if scenario.robot_path is not None:
        files["robot"] = scenario.robot_path
    if contact.body is not None and (contact.limits.endswith(".toml") or "/" in contact.limits):
        files["contact.limits"] = scenario.folder / contact.limits
    if scenario.arm.file is not None:
        files["arm.file"] = scenario.folder / scenario.arm.file
    if scenario.detector.residuals is not None:
        files["detector.residuals"] = scenario.folder / scenario.detector.residuals
    if scenario.reaction.stopping_table is not None:
        files["reaction.stopping_table"] = scenario.folder / scenario.reaction.stopping_table
    if scenario.motion.file is not None:
        files["motion.file"] = scenario.folder / scenario.motion.file
    return files


def scenario_data(scenario: Scenario) -> dict[str, Any]:
    """The keys of a scenario, defaults spelt out and paths absolute: a copy of it may stand in any folder."""
    return with_absolute_paths(scenario, scenario.to_dict())


def with_absolute_paths(scenario: Scenario, data: dict[str, Any]) -> dict[str, Any]:
    """Keys of a scenario, the paths among them made absolute in place."""
    # Relative paths start at the scenario's folder, which the copy has left.
    for key, path in _files_of_keys(scenario).items():
        set_key(data, key, str(path.resolve()))
    for each in uncertain_inputs(scenario):
        if each.file is not None:
            name = "relative_file" if each.relative else "file"
            path = (scenario.folder / each.file).resolve()
            data["uncertainty"][each.key] = {**data["uncertainty"][each.key], name: str(path)}
    return data
