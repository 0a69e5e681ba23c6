"""What the shell completes: names of robots, body regions and limit tables, keys of scenarios and their values.

Each function takes what has been typed and returns what it may become. Where none is returned, the shell completes
files, so that a path can be given as well.
"""

from __future__ import annotations

from typing import Any, get_args


def complete_robot(incomplete: str) -> list[str]:
    """Built-in robots."""
    from bumpstop.model import robots

    return _beginning(robots(), incomplete)


def complete_limits(incomplete: str) -> list[str]:
    """Built-in limit tables."""
    from bumpstop.contact import builtin_tables

    return _beginning(builtin_tables(), incomplete)


def complete_body(incomplete: str) -> list[str]:
    """Body regions of the built-in limit tables."""
    from bumpstop.contact import LimitTable, builtin_tables

    regions = {region.name: None for table in builtin_tables() for region in LimitTable.load(table).regions}
    return _beginning(regions, incomplete)


def complete_variable(incomplete: str) -> list[str]:
    """What ``--vary`` takes: aliases, and keys of a scenario that are a number or a list of numbers."""
    from bumpstop.study.variable import ALIASES

    numeric = [key for key, field in scenario_keys().items() if "float" in str(field.annotation)]
    return _beginning(sorted({*ALIASES, *numeric}), incomplete)


def complete_requirement(incomplete: str) -> list[str]:
    """What ``bumpstop require --vary`` takes."""
    from bumpstop.study.requirement.requirement import HIGHER_IS_WORSE

    return _beginning(HIGHER_IS_WORSE, incomplete)


def complete_setting(incomplete: str) -> list[str]:
    """What ``--set`` takes: ``KEY=``; of a key that is complete ``KEY=VALUE`` for each value that has a name.

    Bash takes ``=`` for the end of a word. So values are offered as soon as the key is complete, with the key.
    """
    key, equals, value = incomplete.partition("=")
    keys = scenario_keys()
    if key not in keys:
        return [] if equals else _beginning([f"{name}=" for name in keys], key)
    values = _beginning(_named_values(key, keys[key]), value)
    longer = [] if equals else _beginning([f"{name}=" for name in keys if name != key], key)
    return [f"{key}={one}" for one in values] + ([] if values or equals else [f"{key}="]) + longer


def scenario_keys() -> dict[str, Any]:
    """Field of every key of a scenario, by its dotted name."""
    from bumpstop.collision.scenario.scenario import Scenario

    found: dict[str, Any] = {}
    for name, field in Scenario.model_fields.items():
        inner = getattr(field.annotation, "model_fields", None)
        if name not in ("folder", "uncertainty"):
            found |= {name: field} if inner is None else {f"{name}.{key}": one for key, one in inner.items()}
    return found


def _named_values(key: str, field: Any) -> list[str]:
    by_key = {"robot": complete_robot, "contact.limits": complete_limits, "contact.body": complete_body}
    if key in by_key:
        return by_key[key]("")
    choices = [*get_args(field.annotation), *(inner for one in get_args(field.annotation) for inner in get_args(one))]
    return [choice for choice in choices if isinstance(choice, str)]


def _beginning(names: Any, incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
