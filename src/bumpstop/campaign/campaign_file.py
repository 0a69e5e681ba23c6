"""Campaign files (TOML)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bumpstop.arrays import as_name, as_number, as_whole_number
from bumpstop.campaign.campaign import AXES, MAX_SETUPS, Campaign, Choice
from bumpstop.collision import Scenario, load_scenario
from bumpstop.collision.scenario.keys import MADE_BY
from bumpstop.errors import InputError, near_matches
from bumpstop.study.parameters.effectiveness import DIRECTIONS
from bumpstop.text_files import parse_toml, read_text

_MAX_BYTES = 1_000_000
_KEYS = ("seed", "poses", "directions", "speeds_mm_s", "shard_s", *AXES)
_MAX_POSES = 10**9
_MAX_DIRECTIONS = 100_000
_MAX_SPEEDS = 1000


def load_campaign(path: str | Path) -> Campaign:
    """Read a campaign file.

    Args:
        path: of a TOML file, or of the ``settings.toml`` of a campaign's folder.

    Raises:
        InputError: the file is absent or damaged, a key is unknown or has an unusable value, or a setup cannot be used.
    """
    path = Path(path)
    text = read_text(path, "wanted a campaign file", max_bytes=_MAX_BYTES)
    return parse_campaign(text, str(path), path.parent)


def parse_campaign(text: str, file: str, folder: Path) -> Campaign:
    """A campaign from the text of its file.

    Args:
        text: TOML.
        file: how errors call it.
        folder: where paths of scenarios start.

    Raises:
        InputError: as :func:`load_campaign`.
    """
    data = parse_toml(text, file)
    data.pop(MADE_BY, None)
    for key in data:
        if key not in _KEYS:
            raise InputError(key, "is no key of a campaign", near_matches(key, _KEYS))
    fields: dict[str, Any] = {axis: _choices(data[axis], axis, folder) for axis in AXES if axis in data}
    if "robots" not in fields:
        raise InputError("robots", "is missing", 'wanted [[robots]] with scenario = "FILE"')
    setups = math.prod(len(choices) for choices in fields.values())
    if setups > MAX_SETUPS:
        raise InputError("robots", f"and the other axes have {setups} combinations", f"wanted at most {MAX_SETUPS}")
    if "seed" in data:
        fields["seed"] = as_whole_number(data["seed"], "seed", 0, 2**63 - 1)
    if "poses" in data:
        fields["poses"] = as_whole_number(data["poses"], "poses", 1, _MAX_POSES)
    if "directions" in data:
        fields["directions"] = _directions(data["directions"])
    if "speeds_mm_s" in data:
        fields["speeds_mm_s"] = _speeds(data["speeds_mm_s"])
    if "shard_s" in data:
        fields["shard_s"] = as_number(data["shard_s"], "shard_s")
        if not 1e-3 <= fields["shard_s"] <= 1e4:
            raise InputError("shard_s", f"is {fields['shard_s']:g}", "wanted 0.001 to 10000 s")
    campaign = Campaign(**fields)
    campaign.check()
    return campaign


def _choices(value: Any, axis: str, folder: Path) -> tuple[Choice, ...]:
    if not isinstance(value, list) or not value or not all(isinstance(each, Mapping) for each in value):
        raise InputError(axis, "is no list of tables", f"wanted [[{axis}]] with name and keys")
    found = tuple(_choice(each, f"{axis}[{i}]", axis == "robots", folder) for i, each in enumerate(value, start=1))
    names = [choice.name for choice in found]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{axis}.name", f"{name!r} is there twice", "give each a name of its own")
    return found


def _choice(table: Mapping[str, Any], field: str, is_robot: bool, folder: Path) -> Choice:
    known = ("name", "keys", "scenario", "folder") if is_robot else ("name", "keys")
    for key in table:
        if key not in known:
            raise InputError(f"{field}.{key}", "is no key of a choice", near_matches(key, known))
    keys = table.get("keys", {})
    if not isinstance(keys, Mapping):
        raise InputError(f"{field}.keys", "is no table", 'wanted keys = { "contact.area_cm2" = 1.0 }')
    changes = tuple((key, value) for key, value in _flat(keys))
    if not is_robot:
        return Choice(as_name(table.get("name"), f"{field}.name"), changes)
    source = table.get("scenario")
    if isinstance(source, str):
        if "folder" in table:
            raise InputError(f"{field}.folder", "is that of the scenario's file", "leave it out")
        scenario, name = load_scenario(folder / source), Path(source).stem
    elif isinstance(source, Mapping):
        begin = as_name(table["folder"], f"{field}.folder") if "folder" in table else ""
        scenario = Scenario.from_dict(dict(source), folder / begin)
        name = scenario.robot
    else:
        raise InputError(f"{field}.scenario", "is missing", "wanted the path of a scenario file")
    return Choice(as_name(table.get("name", name), f"{field}.name"), changes, scenario)


def _flat(keys: Mapping[str, Any], above: str = "") -> list[tuple[str, Any]]:
    """Dotted keys, written as such or as tables."""
    found: list[tuple[str, Any]] = []
    for key, value in keys.items():
        name = f"{above}{key}"
        found += _flat(value, f"{name}.") if isinstance(value, Mapping) else [(name, value)]
    return found


def _directions(value: Any) -> tuple[str, ...] | int:
    if isinstance(value, list) and value:
        names = tuple(as_name(each, "directions") for each in value)
        for name in names:
            if name not in DIRECTIONS:
                raise InputError("directions", f"{name!r} is unknown", near_matches(name, DIRECTIONS))
        return tuple(dict.fromkeys(names))
    return as_whole_number(value, "directions", 1, _MAX_DIRECTIONS, "names of directions, or 1 to 100000")


def _speeds(value: Any) -> tuple[float, ...]:
    if not isinstance(value, list) or not 0 < len(value) <= _MAX_SPEEDS:
        raise InputError("speeds_mm_s", "is no list of speeds", f"wanted 1 to {_MAX_SPEEDS} of them")
    speeds = [as_number(each, "speeds_mm_s") for each in value]
    for speed in speeds:
        if not 1e-3 <= speed <= 1e5:
            raise InputError("speeds_mm_s", f"{speed:g} cannot be used", "wanted 0.001 to 100000 mm/s")
    return tuple(sorted(set(speeds)))
