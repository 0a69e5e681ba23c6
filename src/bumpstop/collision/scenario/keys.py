"""Dotted keys of scenarios, and how they are set."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bumpstop.collision.scenario.scenario_tables import ScenarioTables
from bumpstop.collision.scenario.scenario_words import as_written, unknown_key
from bumpstop.collision.scenario.spellings import check_one_spelling, other_spelling, replace_other_spelling
from bumpstop.collision.scenario.uncertainty_table import check_name, flattened
from bumpstop.errors import InputError
from bumpstop.text_files import list_items

_MAX_LIST = 10_000  # characters
# The table that ``settings.toml`` has more than a scenario.
MADE_BY = "made_by"
# The key that lists keys whose values nobody knows of the cell.
ASSUMED = "assumed"
# The word that takes a key out, for rows and options, in which None cannot be written.
_NONE = "none"


def takes_out(value: Any) -> bool:
    """Whether setting a key to a value takes the key out: None, or the word ``none``."""
    return value is None or (isinstance(value, str) and value == _NONE)


def set_keys(data: dict[str, Any], changes: Mapping[str, Any]) -> None:
    """Set dotted keys in nested dictionaries; what is set is not :data:`ASSUMED` any more.

    A value that :func:`takes_out` leaves the scenario without the key, as if nobody had given it.

    Raises:
        InputError: a key cannot be set, or two of them say one thing.
    """
    if not isinstance(changes, Mapping) or not all(isinstance(key, str) for key in changes):
        raise InputError("changes", f"{as_written(changes)} cannot be used", "wanted dotted keys and their values")
    check_one_spelling(key for key, value in changes.items() if not takes_out(value))
    for key, value in changes.items():
        if takes_out(value):
            # In either spelling, unless the other one is set.
            for one in (key, *(other for other in other_spelling(key) if takes_out(changes.get(other)))):
                _take_out(data, one)
        else:
            set_key(data, key, value)
    if ASSUMED not in changes:
        drop_assumed(data, changes)


def told_to_take_out(error: InputError, changes: Mapping[str, Any]) -> InputError:
    """A refusal that asks for a key to be left out, with how that is done where other keys were changed."""
    if not changes or error.field.replace('"', "") in changes:
        return error
    valid = re.sub("leave (it|one of the two) out", rf"\g<0> (set {error.field} to {_NONE})", error.valid)
    return InputError(error.field, error.problem, valid)


def _take_out(data: dict[str, Any], key: str) -> None:
    """Take a dotted key, or a table, out of nested dictionaries, whether it is given or not."""
    table, dot, name = key.partition(".")
    if table == "uncertainty" and dot:
        check_name(name, ScenarioTables)
        given = flattened(data.get(table, {})).items()
        gone = (name, *other_spelling(name))
        # With all items of a list, and all keys of a table.
        parts = tuple(f"{one}{sign}" for one in gone for sign in ".[")
        data[table] = {one: spec for one, spec in given if one not in gone and not one.startswith(parts)}
        return
    field = ScenarioTables.model_fields.get(table)
    if field is None or (dot and name not in getattr(field.annotation, "model_fields", {})):
        is_table = field is not None and hasattr(field.annotation, "model_fields")
        raise unknown_key(ScenarioTables, (table, name) if is_table else (table if field is None else key,))
    inner = data.get(table) if dot else data
    if isinstance(inner, dict):
        inner.pop(name or table, None)


def drop_assumed(data: dict[str, Any], known: Iterable[str]) -> None:
    """Take dotted keys, in either spelling, and those of tables out of the list of those that are only assumed."""
    assumed = data.get(ASSUMED)
    if isinstance(assumed, list):
        replaced = {one for key in known for one in (key, *other_spelling(key))}
        data[ASSUMED] = [key for key in assumed if key not in replaced and key.partition(".")[0] not in replaced]


def leave_out(data: dict[str, Any], keys: Sequence[str]) -> None:
    """Take dotted keys, and tables, out of nested dictionaries of a checked scenario.

    What is not given there is neither uncertain nor :data:`ASSUMED`.
    """
    for key in keys:
        table, _, last = key.rpartition(".")
        (data.get(table, {}) if table else data).pop(last, None)
    if "uncertainty" in data:
        gone = set(keys)
        uncertain = data["uncertainty"].items()
        data["uncertainty"] = {key: one for key, one in uncertain if gone.isdisjoint((key, key.partition(".")[0]))}
    drop_assumed(data, keys)


def set_key(data: dict[str, Any], key: str, value: Any) -> None:
    """Set a dotted key in nested dictionaries, making tables on the way. Of two spellings one remains."""
    *tables, last = key.split(".")
    if key.split(".")[0] == MADE_BY:
        # Its table is passed over, whatever stands in it.
        raise InputError(key, "is not a key of a scenario", f"[{MADE_BY}] only records how a result was made")
    if tables[:1] == ["uncertainty"]:
        # Its keys are dotted themselves.
        data["uncertainty"] = flattened(data.get("uncertainty", {})) | {".".join(key.split(".")[1:]): value}
        return
    here = data
    for table in tables:
        here = here.setdefault(table, {})
        if not isinstance(here, dict):
            raise InputError(key, f"{table!r} is not a table", "a key is written as table.key or as key alone")
    replace_other_spelling(data, key)
    here[last] = value


def value_of(text: str) -> Any:
    """What a value outside a TOML file means: a TOML value, or numbers with commas between them, else the text."""
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):  # bad TOML, a number of thousands of digits, thousands of brackets
        return _numbers(text) or text.strip()
    # More than one line may hold more than one value.
    return parsed["value"] if len(parsed) == 1 else text.strip()


def _numbers(text: str) -> list[float] | None:
    """Of a list without brackets, as other options take it; None where it is none."""
    items = list_items(text)
    try:
        return [float(item) for item in items] if len(items) > 1 and len(text) < _MAX_LIST else None
    except ValueError:
        return None
