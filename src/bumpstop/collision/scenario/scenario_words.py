"""What a scenario is told it got wrong: field, value and what would be valid, in words."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Sequence
from functools import cache
from typing import Any

from pydantic import BaseModel, ValidationError

from bumpstop.errors import InputError, near_matches


class _AsWritten(reprlib.Repr):
    """Values as a scenario file spells them, cut where they are long."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxlist, self.maxstring = 3, 16, 60

    def repr_bool(self, value: bool, level: int) -> str:
        return "true" if value else "false"

    def repr_NoneType(self, value: None, level: int) -> str:
        return "None"

    def repr_int(self, value: int, level: int) -> str:
        return str(value) if abs(value) < 10**40 else "a number of more than 40 digits"

    def repr_float(self, value: float, level: int) -> str:
        return repr(value)

    def repr_dict(self, value: dict[Any, Any], level: int) -> str:
        return "a table"

    def repr_instance(self, value: Any, level: int) -> str:
        # Dates and times; whatever else a program may pass is named by its type alone.
        return value.isoformat() if hasattr(value, "isoformat") else f"a value of type {type(value).__name__}"


as_written = _AsWritten().repr


def short(number: float) -> str:
    """A number without the zeros and pluses of ``1e+06``."""
    return re.sub(r"e([+-])0*", lambda match: "e" + match[1].strip("+"), f"{number:g}")


def unknown_key(scenario: type[BaseModel], path: tuple[Any, ...]) -> InputError:
    """Of a key that no table of a scenario has."""
    *tables, key = path
    model: Any = scenario
    for table in tables:
        model = model.model_fields[table].annotation
    names = [name for name in model.model_fields if name != "folder"]
    return InputError(
        ".".join(_key_as_written(part) for part in path), "is not a key of a scenario", near_matches(str(key), names)
    )


def _key_as_written(key: Any) -> str:
    return key if isinstance(key, str) and re.fullmatch("[A-Za-z0-9_-]{1,60}", key) else as_written(key)


def explain(scenario: type[BaseModel], error: ValidationError) -> InputError:
    """Turn pydantic's first complaint into one sentence with the field, the value and what would be valid."""
    return _explain(scenario, error.errors())


def explain_all(scenario: type[BaseModel], error: ValidationError) -> list[InputError]:
    """The same of every key that pydantic complains about."""
    by_key: dict[tuple[str, ...], list[Any]] = {}
    for detail in error.errors():
        unknown = detail["type"] in ("extra_forbidden", "invalid_key")
        key = tuple(map(str, detail["loc"])) if unknown or not detail["loc"] else _place(scenario, detail["loc"])[0]
        by_key.setdefault(key, []).append(detail)
    return [_explain(scenario, details) for details in by_key.values()]


def _explain(scenario: type[BaseModel], details: Sequence[Any]) -> InputError:
    for detail in details:
        # An unknown key often explains a missing one.
        if detail["type"] in ("extra_forbidden", "invalid_key"):
            return unknown_key(scenario, detail["loc"])
    first = details[0]
    if first["type"] == "value_error":
        cause: InputError = first["ctx"]["error"]
        return InputError(cause.field, cause.problem, cause.valid)
    path, index = _place(scenario, first["loc"])
    # Of a key that takes a number or a list, the complaint about an item of the list says most.
    for detail in details:
        item = _place(scenario, detail["loc"])
        if index is None and item[0] == path and item[1] is not None:
            first, index = detail, item[1]
    field = ".".join(path)
    if first["type"] == "missing":
        return InputError(field, "is missing", f"wanted {words(scenario, path)}")
    if index is not None:
        field = f"{field}[{index + 1}]"
    value = first["input"]
    rows = isinstance(value, list) and value and all(isinstance(row, dict) for row in value)
    written = f"[[{field}]]" if rows else as_written(value)
    return InputError(field, f"{written} cannot be used", f"wanted {words(scenario, path, item=index is not None)}")


def _place(scenario: type[BaseModel], location: tuple[int | str, ...]) -> tuple[tuple[str, ...], int | None]:
    """Dotted key and index in its list. Behind the key pydantic also names the branches of ``number | list``."""
    depth = 2 if len(location) > 1 and _is_table(scenario, str(location[0])) else 1
    index = next((part for part in location[depth:] if isinstance(part, int)), None)
    return tuple(str(part) for part in location[:depth]), index


def _is_table(scenario: type[BaseModel], key: str) -> bool:
    annotation = scenario.model_fields[key].annotation
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


@cache
def words(scenario: type[BaseModel], path: tuple[str, ...], *, item: bool = False) -> str:
    """What may stand at a key, or in its list, in words."""
    model: Any = scenario
    for table in path[:-1]:
        model = model.model_fields[table].annotation
    if len(path) == 1 and _is_table(scenario, path[0]):
        table_model: Any = scenario.model_fields[path[0]].annotation
        required = table_model.model_json_schema().get("required", [])
        return f"a table: [{path[0]}]" + (f" with {' and '.join(required)}" if required else "")
    schema = model.model_json_schema()["properties"][path[-1]]
    if item:
        schema = next(branch["items"] for branch in schema.get("anyOf", [schema]) if "items" in branch)
    return _schema_words(schema)


def _schema_words(schema: dict[str, Any]) -> str:
    if "anyOf" in schema:
        branches = [branch for branch in schema["anyOf"] if branch["type"] != "null"]
        if len(branches) > 1 and branches[1]["type"] != "array":
            return " or ".join(_schema_words(branch) for branch in branches)
        if len(branches) > 1:
            return f"{_schema_words(branches[0])}, or a list of one per joint"
        return _schema_words(branches[0])
    choices = schema.get("enum", [schema["const"]] if "const" in schema else [])
    if choices:
        *others, last = (repr(choice) for choice in choices)
        return f"{', '.join(others)} or {last}" if others else last
    if schema["type"] == "string":
        return str(schema["description"])
    if schema["type"] == "array":
        items = _schema_words(schema["items"])
        if "minItems" in schema:
            return f"a list of {schema['minItems']} {items.removeprefix('a ').replace('number', 'numbers', 1)}"
        if schema["items"]["type"] == "string":
            return f"a list, each item {items}"
        if schema["items"]["type"] == "integer":
            return f"a list of {items.removeprefix('a ').replace('number', 'numbers', 1)}"
        return f"a list of {items.removeprefix('a ').replace('number', 'numbers', 1)}, one per joint"
    words = "a whole number" if schema["type"] == "integer" else "a number"
    if "exclusiveMinimum" in schema:
        return f"{words} above {short(schema['exclusiveMinimum'])} and below {short(schema['exclusiveMaximum'])}"
    if "minimum" in schema:
        return f"{words} from {short(schema['minimum'])} to {short(schema['maximum'])}"
    return words
