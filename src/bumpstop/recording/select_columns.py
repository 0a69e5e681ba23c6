"""From a table's columns to quantities in SI."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError, near_matches
from bumpstop.recording.column_draft import MissingColumnsError, as_list, draft_of_names, draft_of_numbers
from bumpstop.recording.columns import UNITS, Columns, Quantity
from bumpstop.recording.formats.table import RawRecording, RowNumbers, Table
from bumpstop.recording.read_report import payload_note

_OWN = {"position": "q", "reference": "q_ref", "velocity": "qd", "current": "current", "torque": "tau"}
_WRENCH = tuple(f"wrench_{axis}" for axis in ("fx", "fy", "fz", "tx", "ty", "tz"))
_RTDE = {
    "position": "actual_q",
    "reference": "target_q",
    "velocity": "actual_qd",
    "current": "actual_current",
    "wrench": "actual_TCP_force",
}
# What may be a unit in the name of a column; a letter alone in round ones may mean anything.
_IN_BRACKETS = re.compile(r"(?<=\[)[^\]]+(?=\])|(?<=\()[^)]{2,}(?=\))")
# The controller's base, whatever the robot's base frame is: drivers for ROS turn that by half a turn.
_RTDE_FRAME = "first_joint"
_RTDE_NOTE = (
    "The columns are taken for those of a UR controller (RTDE): actual_q, target_q, actual_qd, actual_current, "
    "TCP force."
)


def choose(table: Table, columns: Columns, path: Path, open_table: Callable[[Path], Table]) -> RawRecording:
    """Fetch the columns that a column file names, or those a file of ours or of RTDE has.

    Args:
        table: of the recording.
        columns: the column file.
        path: of the recording, for messages.
        open_table: opens another file of the same format, for quantities that stand in one.
    """
    notes = list(table.notes)
    quantities = dict(columns.quantities)
    if not quantities:
        quantities, rtde = _found(table, path)
        _refuse_text_row(table, path)
        notes += [_RTDE_NOTE, *_payload_notes(table, path)] if rtde else []
    if "position" not in quantities:
        raise InputError("columns.position", "is missing", "wanted the columns of the joint positions")
    time = quantities.pop("time", Quantity())
    if not time.columns and time.rate_hz is None:
        raise InputError("columns.time", "names neither a column nor a rate", "wanted column = ..., or rate_hz = ...")
    if time.columns:
        quantities["t"] = time
    names, told = _joint_names(table, columns)
    notes += told
    values = _fetched(table, {name: own for name, own in quantities.items() if own.file is None}, path)
    if not time.columns:
        assert time.rate_hz is not None
        values["t"] = (np.searchsorted(table.filled, table.rows) / time.rate_hz)[:, None]
    raw = RawRecording(
        values=values,
        rows=table.rows,
        rows_read=table.filled.size,
        numbered=table.numbered,
        faults=table.faults,
        joint_names=names,
        robot=table.robot,
        notes=tuple(notes),
        wrench_frame=quantities.get("wrench", Quantity()).frame,
    )
    for name, quantity in quantities.items():
        if quantity.file is not None:
            beside = open_table(quantity.file)
            raw = _beside(raw, table, beside, _fetched(beside, {name: quantity}, quantity.file), quantity.file)
    return raw


def _joint_names(table: Table, columns: Columns) -> tuple[tuple[str, ...], list[str]]:
    """The file's names of the joints whose columns are read, and a note where its names say nothing of them.

    They are those of the columns ``q_1 ..``, ``current_1 ..`` and so on; a column file may choose others.
    """
    if not columns.quantities or not table.joint_names or columns.joint_names:
        return table.joint_names, []
    numbers = {
        tuple(_number(table, column, _OWN[name]) for column in quantity.columns)
        for name, quantity in columns.quantities.items()
        if name in _OWN and quantity.file is None
    }
    if len(numbers) == 1:
        (chosen,) = numbers
        if chosen and all(0 < number <= len(table.joint_names) for number in chosen):
            return tuple(table.joint_names[number - 1] for number in chosen), []
    note = (
        f"The file calls its joints {', '.join(table.joint_names)}, but the column file does not choose its own "
        "columns of each joint: the joints are taken in the order of the column file. Its joint_names can say their "
        "names."
    )
    return (), [note]


def _number(table: Table, column: int | str, stem: str) -> int:
    """Of the joint, from 1, that a column of ours belongs to; 0: it is none of them."""
    if isinstance(column, int):
        column = table.names[column - 1] if column <= len(table.names) else ""
    found = re.fullmatch(rf"{stem}_(\d{{1,3}})", column)
    return int(found[1]) if found else 0


def _fetched(table: Table, quantities: dict[str, Quantity], path: Path) -> dict[str, FloatArray]:
    """All columns in one go: a reader may have to pass through the file for each."""
    if not quantities:
        return {}
    places = {name: _places(table, name, quantity, path) for name, quantity in quantities.items()}
    for name, place in places.items():
        _check_told_units(table, name, quantities[name], place, path)
    block = table.fetch([i for place in places.values() for i in place])
    values, start = {}, 0
    for name, place in places.items():
        part = block[:, start : start + len(place)]
        values[name] = quantities[name].in_si(part, name)
        start += len(place)
    return values


def _refuse_text_row(table: Table, path: Path) -> None:
    """Refuse a row of text below names of ours: it may hold units, and the values would be read in SI."""
    if table.text_row:
        raise InputError(
            f"{path} {table.numbered} {table.rows[0]}",
            f"holds no number but {as_list(table.text_row)}: are these units?",
            "say with --columns FILE.toml which columns hold what, in which unit, or delete the row",
        )


def _check_told_units(table: Table, name: str, quantity: Quantity, place: list[int], path: Path) -> None:
    """Refuse a unit that the file itself contradicts, in a row below its names or in the name that chose a column."""
    key = "time" if name == "t" else name
    known = UNITS.get(key, {"": 1.0})
    used = quantity.units or (next(iter(known)),)
    each = used * len(place) if len(used) == 1 else used
    for i, unit, column in zip(place, each, quantity.columns, strict=False):
        told = []
        if table.text_row:
            told.append((table.text_row[i].strip('"[]() '), f"{table.numbered} {table.rows[0]}", "or delete the row"))
        if isinstance(column, str):
            told += [(word, f"the name {column!r}", "or columns by number") for word in _IN_BRACKETS.findall(column)]
        for word, where, way_out in told:
            other = word.replace("°", "deg")
            if other in known and known[other] != known[unit]:
                problem = f"is {unit!r}, but {str(path)!r} says {other!r} in {where}"
                raise InputError(f"columns.{key}.unit", problem, f'wanted "{other}", {way_out}')


def _places(table: Table, name: str, quantity: Quantity, path: Path) -> list[int]:
    where = "columns.time.column" if name == "t" else f"columns.{name}.columns"
    if not quantity.columns:
        raise InputError(where, "is missing", "wanted numbers from 1, or names")
    places = []
    for column in quantity.columns:
        if isinstance(column, str):
            if column not in table.names:
                known = near_matches(column, table.names) if table.names else "the file has no header: give numbers"
                raise InputError(where, f"{str(path)!r} has no column {column!r}", known)
            if table.names.count(column) > 1:
                raise InputError(
                    where,
                    f"{str(path)!r} has {table.names.count(column)} columns {column!r}",
                    "give their numbers, from 1",
                )
            places.append(table.names.index(column))
        elif column > table.width:
            raise InputError(where, f"{column} is no column of {str(path)!r}", f"it has {table.width}")
        else:
            places.append(column - 1)
    return places


def _found(table: Table, path: Path) -> tuple[dict[str, Quantity], bool]:
    """What the names say, and whether they are those of RTDE."""
    names = set(table.names)
    for name in table.names:
        if table.names.count(name) > 1 and re.fullmatch(r"t|timestamp|\w+_\d+", name):
            known = "say with --columns FILE.toml, by numbers, which hold what"
            raise InputError(str(path), f"has {table.names.count(name)} columns {name!r}", known)
    if "t" in names and "q_1" in names:
        found = {"time": Quantity(columns=("t",))}
        for quantity, stem in _OWN.items():
            columns = _numbered(names, stem, 1)
            if columns:
                found[quantity] = Quantity(columns=columns)
        if names.issuperset(_WRENCH):
            found["wrench"] = Quantity(columns=_WRENCH)
        return found, False
    if {"timestamp", "actual_q_0"} <= names:
        found = {"time": Quantity(columns=("timestamp",))}
        found |= {
            key: Quantity(columns=_numbered(names, stem, 0)) for key, stem in _RTDE.items() if f"{stem}_0" in names
        }
        if "wrench" in found:
            found["wrench"] = replace(found["wrench"], frame=_RTDE_FRAME)
        return found, True
    valid = "say with --columns FILE.toml which columns hold what"
    if not names:
        problem = f"has no header, and {table.width} columns"
        raise MissingColumnsError(str(path), problem, valid, draft_of_numbers(table.width))
    if 2 * sum(not name for name in table.names) > len(table.names):  # as a spreadsheet writes a line of text
        valid += "; or delete what stands above the names of the columns, or begin it with #"
    problem = f"has no columns t and q_1, but {len(table.names)} others: {as_list(table.names)}"
    raise MissingColumnsError(str(path), problem, valid, draft_of_names(table.names))


def _payload_notes(table: Table, path: Path) -> list[str]:
    """What the controller of a UR was told that the arm carries: a fit must be told, too."""
    names = ("payload", *(f"payload_cog_{axis}" for axis in range(3)))
    if not set(names) <= set(table.names):
        return []
    told = _fetched(table, {"payload": Quantity(columns=names)}, path)["payload"]
    told = told[np.isfinite(told).all(axis=1)]
    if not told.size or not (told[:, 0] > 0).any():
        return []
    if (told != told[0]).any():
        return ["The controller was told of a payload that changes (payload, payload_cog): cut the recording there."]
    return [payload_note(float(told[0, 0]), told[0, 1:].tolist())]


def _numbered(names: set[str], stem: str, first: int) -> tuple[str, ...]:
    numbers = sorted(int(found[1]) for name in names if (found := re.fullmatch(rf"{stem}_(\d{{1,3}})", name)))
    if numbers != list(range(first, first + len(numbers))):
        raise InputError(f"columns {stem}_*", f"are numbered {numbers}", f"wanted {stem}_{first} and on, without holes")
    return tuple(f"{stem}_{number}" for number in numbers)


def _beside(raw: RawRecording, table: Table, other: Table, more: dict[str, FloatArray], path: Path) -> RawRecording:
    """Join the rows of another file to those of ``table`` by their place; a row bad in either is bad."""
    if other.filled.size != table.filled.size:
        raise InputError(str(path), f"has {other.filled.size} rows, the positions have {table.filled.size}")

    def row_here(rows: RowNumbers | int) -> RowNumbers:
        return table.filled[np.searchsorted(other.filled, rows)]

    both, here, there = np.intersect1d(raw.rows, row_here(other.rows), assume_unique=True, return_indices=True)
    values = {name: value[here] for name, value in raw.values.items()}
    values |= {name: value[there] for name, value in more.items()}
    known = {row for row, _ in raw.faults}
    others = [(int(row_here(row)), why) for row, why in other.faults]
    faults = [*raw.faults, *((row, why) for row, why in others if row not in known)]
    return replace(raw, values=values, rows=both, faults=tuple(sorted(faults)))
