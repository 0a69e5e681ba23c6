"""Trajectory files: joint positions over time, as CSV or as ROS JointTrajectory in YAML or JSON, read strictly."""

from __future__ import annotations

import csv
import json
import math
import re
import string
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError, near_matches

if TYPE_CHECKING:
    from bumpstop.model import Robot

FIELD = "motion.file"
_MAX_BYTES = {".csv": 50_000_000, ".json": 50_000_000, ".yaml": 5_000_000, ".yml": 5_000_000}
_MAX_CHARACTERS = 60  # of a value that is shown
_MAX_LEVELS = 20  # of YAML
_MAX_INT = 10**_MAX_CHARACTERS
_MAX_PARTS = 8  # of a table that is shown
_TIMES = (("sec", "nanosec"), ("secs", "nsecs"))  # of ROS 2, of ROS 1
_MESSAGE_KEYS = ("header", "joint_names", "points")
_POINT_KEYS = ("positions", "velocities", "accelerations", "effort", "time_from_start")


class Rows(NamedTuple):
    """What a file says, checked for numbers and shapes alone.

    Attributes:
        time: (rows,) [s], from wherever the file counts.
        position: (rows, dof) [rad or m].
        velocity: (rows, dof) [rad/s or m/s], or None where the file has none.
        row: what a row is called: ``"row"`` or ``"point"``.
        position_names, velocity_names: what the columns are called.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray | None
    row: str
    position_names: list[str]
    velocity_names: list[str]


def read_rows(path: Path, robot: Robot) -> Rows:
    """Read a trajectory file for a robot.

    Raises:
        InputError: the file is absent, too long or damaged; names row and column.
    """
    kind = path.suffix.lower()
    if kind not in _MAX_BYTES:
        raise refusal(path, f"has the extension {kind!r}", f"wanted one of {', '.join(_MAX_BYTES)}")
    try:
        with path.open("rb") as file:
            content = file.read(_MAX_BYTES[kind] + 1)
    except (OSError, ValueError) as error:  # a NUL character in the path is a ValueError
        why = (isinstance(error, OSError) and error.strerror) or str(error)
        raise refusal(path, f"cannot be read ({why})", "wanted a trajectory file") from None
    if len(content) > _MAX_BYTES[kind]:
        raise refusal(path, f"is longer than {_MAX_BYTES[kind]} bytes", "wanted a trajectory file")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise refusal(path, f"is not UTF-8 text (byte {error.start + 1})") from None
    if kind == ".csv":
        return _csv(path, text, robot)
    return _message(path, _parsed_json(path, text) if kind == ".json" else _parsed_yaml(path, text), robot)


def refusal(path: Path, problem: str, valid: str = "") -> InputError:
    """The error for a file: names it, and what is wrong with it."""
    return InputError(FIELD, f"{path}: {problem}", valid)


def _csv(path: Path, text: str, robot: Robot) -> Rows:
    lines = csv.reader(text.splitlines())
    try:
        header = [name.strip() for name in next(lines, [])]
        rows = [row for row in lines if row]
    except csv.Error as error:
        raise refusal(path, f"is not valid CSV (line {lines.line_num}: {error})") from None
    positions = [f"q_{j}" for j in range(1, robot.dof + 1)]
    velocities = [f"qd_{j}" for j in range(1, robot.dof + 1)]
    wanted = f"wanted the header t,q_1,...,q_{robot.dof} and perhaps qd_1,...,qd_{robot.dof}"
    for name in header:
        if name not in ("t", *positions, *velocities):
            raise refusal(
                path, f"has a column {_shown(name)}", f"{near_matches(_word(name), ['t', *positions])}; {wanted}"
            )
        if header.count(name) > 1:
            raise refusal(path, f"has the column {name!r} twice", wanted)
    needed = ["t", *positions, *(velocities if any(name in header for name in velocities) else [])]
    for name in needed:
        if name not in header:
            raise refusal(path, f"has no column {name!r}", wanted)
    table = np.empty((len(rows), len(header)))
    for number, row in enumerate(rows, start=1):
        if len(row) != len(header):
            raise refusal(path, f"row {number} has {len(row)} values", f"the header has {len(header)} columns")
        try:
            table[number - 1] = [float(cell) for cell in row]
        except ValueError:
            for name, cell in zip(header, row, strict=True):
                _number(path, cell.strip(string.whitespace), f"row {number}, column {name}")
            raise
    column = {name: table[:, i] for i, name in enumerate(header)}
    velocity = np.column_stack([column[name] for name in velocities]) if velocities[0] in column else None
    return Rows(
        column["t"], np.column_stack([column[name] for name in positions]), velocity, "row", positions, velocities
    )


def _parsed_json(path: Path, text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:  # bad JSON, a number of thousands of digits, thousands of brackets
        raise refusal(path, f"is not valid JSON ({_one_line(error)})") from None


def _parsed_yaml(path: Path, text: str) -> Any:
    import yaml

    # The loader in C, where there is one, is ten times as fast and just as safe.
    class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
        def flatten_mapping(self, node: Any) -> None:
            # Merges of merges grow without bound, and no message has any.
            if any(key.tag == "tag:yaml.org,2002:merge" for key, _ in node.value):
                raise yaml.constructor.ConstructorError(None, None, "merge keys are not read", node.start_mark)

    depth = 0
    try:
        for event in yaml.parse(text, Loader):
            if isinstance(event, yaml.CollectionStartEvent):
                depth += 1
            elif isinstance(event, yaml.CollectionEndEvent):
                depth -= 1
            # Thousands of levels exhaust the stack of the loader in C, which ends the process.
            if depth > _MAX_LEVELS:
                raise yaml.YAMLError(f"nested deeper than {_MAX_LEVELS} levels")
        # A recording of a topic ends with the mark that begins the next message.
        documents = [document for document in yaml.load_all(text, Loader) if document is not None]
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise refusal(path, f"is not valid YAML ({_one_line(error)})") from None
    if len(documents) > 1:
        raise refusal(path, f"holds {len(documents)} trajectories", "wanted one: save each in a file of its own")
    return documents[0] if documents else None


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]


def _message(path: Path, message: Any, robot: Robot) -> Rows:
    """A ROS JointTrajectory."""
    if not isinstance(message, Mapping):
        raise refusal(path, "is no JointTrajectory", "wanted joint_names and points")
    _check_keys(path, message, _MESSAGE_KEYS, ("joint_names", "points"), "")
    names = _list(path, message["joint_names"], "joint_names")
    known = [joint.name for joint in robot.joints]
    for name in names:
        if not isinstance(name, str) or name not in known:
            raise refusal(
                path, f"joint_names: {robot.name} has no joint {_shown(name)}", near_matches(_word(name), known)
            )
        if names.count(name) > 1:
            raise refusal(path, f"joint_names: {name!r} occurs twice")
    for name in known:
        if name not in names:
            raise refusal(path, f"joint_names: {name!r} is missing", f"wanted every joint of {robot.name}")
    order = [names.index(name) for name in known]
    points = _list(path, message["points"], "points")
    time = np.empty(len(points))
    position, velocity = np.empty((len(points), len(names))), np.empty((len(points), len(names)))
    moving = 0  # points with velocities
    for number, point in enumerate(points, start=1):
        where = f"point {number}"
        if not isinstance(point, Mapping):
            raise refusal(path, f"{where}: {_shown(point)} is no point", "wanted positions and time_from_start")
        _check_keys(path, point, _POINT_KEYS, ("positions", "time_from_start"), f"{where}: ")
        time[number - 1] = _seconds(path, point["time_from_start"], where)
        position[number - 1] = _numbers(path, point["positions"], names, f"{where}, positions")
        if point.get("velocities"):  # ROS writes an empty list for none
            velocity[number - 1] = _numbers(path, point["velocities"], names, f"{where}, velocities")
            moving += 1
        if moving not in (0, number):
            raise refusal(path, f"{where}: velocities are given at some points only", "wanted them at all or at none")
    return Rows(time, position[:, order], velocity[:, order] if moving else None, "point", known, known)


def _check_keys(path: Path, data: Mapping[Any, Any], known: Iterable[str], needed: Iterable[str], where: str) -> None:
    for key in data:
        if key not in known:
            raise refusal(path, f"{where}{_shown(key)} is not a key", near_matches(_word(key), known))
    for key in needed:
        if key not in data:
            raise refusal(path, f"{where}{key} is missing")


def _list(path: Path, value: Any, where: str) -> list[Any]:
    if not isinstance(value, list):
        raise refusal(path, f"{where}: {_shown(value)} cannot be used", "wanted a list")
    return value


def _numbers(path: Path, value: Any, names: list[str], where: str) -> list[float]:
    values = _list(path, value, where)
    if len(values) != len(names):
        raise refusal(path, f"{where}: has {len(values)} values", f"joint_names has {len(names)}")
    return [_number(path, item, f"{where}, joint {name}") for name, item in zip(names, values, strict=True)]


def _number(path: Path, value: Any, where: str) -> float:
    # YAML takes 1e-3, without a point, for a text.
    if isinstance(value, str) and re.fullmatch(r"[+-]?([0-9]+(\.[0-9]+)?|\.[0-9]+)([eE][+-]?[0-9]{1,3})?", value):
        value = float(value)
    usable = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300
    if not usable or not math.isfinite(value):
        raise refusal(path, f"{where}: {_shown(value)} cannot be used", "wanted a finite number")
    return float(value)


def _seconds(path: Path, value: Any, where: str) -> float:
    where = f"{where}, time_from_start"
    if not isinstance(value, Mapping):
        return _number(path, value, where)
    for whole, billionths in _TIMES:
        if set(value) == {whole, billionths}:
            return _number(path, value[whole], where) + 1e-9 * _number(path, value[billionths], where)
    raise refusal(
        path, f"{where}: {_shown(dict(value))} cannot be used", "wanted sec and nanosec, or a number of seconds"
    )


def _shown(value: Any) -> str:
    if isinstance(value, dict) and len(value) <= _MAX_PARTS and not any(isinstance(x, dict) for x in value.values()):
        text = "{" + ", ".join(f"{_shown(key)}: {_shown(part)}" for key, part in value.items()) + "}"
    elif isinstance(value, int) and abs(value) >= _MAX_INT:
        text = "a number of more than 60 digits"
    elif isinstance(value, str | int | float | None):
        text = repr(value[: _MAX_CHARACTERS + 1] if isinstance(value, str) else value)
    else:
        # Not looked into: references in YAML make a value of a few lines as large as they like.
        text = f"a value of type {type(value).__name__}"
    return text if len(text) <= _MAX_CHARACTERS else text[:_MAX_CHARACTERS] + "..."


def _word(value: Any) -> str:
    return value[:100] if isinstance(value, str) else ""
