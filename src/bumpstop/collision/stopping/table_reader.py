"""From the cells of a file of stopping distances to a checked table in SI."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.collision.stopping.column_names import LENGTHS, Column, check_unit, read_column
from bumpstop.collision.stopping.joint_names import NO_JOINT, TCP, JointName, first_number
from bumpstop.collision.stopping.stopping_table import StoppingTable
from bumpstop.collision.stopping.table_cells import are_joint_words, category_of, joint_of, number_of
from bumpstop.errors import InputError

_DEG = math.pi / 180
# What a file may state beside its rows, and what of SI one of it is.
FULL_SPEED = {"full_speed_deg_s": _DEG, "full_speed_rad_s": 1.0, "full_speed_mm_s": 1e-3, "full_speed_m_s": 1.0}
STATED = (*FULL_SPEED, "reach_mm")
_STATED_FOR_EXAMPLE = {"full_speed_deg_s": "180", "reach_mm": "1300"}
WANTED = "wanted a table of stopping distances (.csv or .toml)"
EXAMPLE = "speed_percent, distance_1_deg, distance_2_deg, and where known payload_percent, extension_percent"


def _full_speeds(joints: int) -> str:
    return f"wanted one number above zero, or {joints}: one for each joint of the table, by their numbers"


class TableReader:
    """Cells and names of a file on their way to a table.

    Args:
        name: of the file, as errors say it.
        names: of the columns.
        cells: row by row, as they stand in the file.
        stated: what the file or the command states beside them: full speeds and reach.
    """

    def __init__(self, name: str, names: list[str], cells: list[list[Any]], stated: dict[str, Any]) -> None:
        self.name, self.stated = name, stated
        self.notes: list[str] = []
        self.category: int | None = None
        if len(set(names)) != len(names):
            twice = next(column for column in names if names.count(column) > 1)
            raise InputError(name, f"has the column {twice!r} twice", "name each once")
        for number, row in enumerate(cells, start=1):
            if len(row) != len(names):
                raise InputError(f"{name}, row {number}", f"has {len(row)} values", f"there are {len(names)} columns")
        if not cells:
            raise InputError(name, "has no rows", WANTED)
        self.columns: list[Column] = []
        self.values: dict[str, FloatArray] = {}
        read = [read_column(each) for each in names]
        for place, each in enumerate(names):
            if read[place] is None and are_joint_words([row[place] for row in cells]):
                read[place] = Column(each, "joint", "", NO_JOINT)
        unknown = [each for each, column in zip(names, read, strict=True) if column is None]
        in_rows = self._joints_of_rows(read, cells)
        columns = [(f"{name}, column {column.name!r}", column.named) for column in read if column is not None]
        first = first_number([*columns, *in_rows])
        for place, column in enumerate(read):
            if column is not None and column.quantity != "joint":
                self.columns.append(column.counted(first))
                self.values[column.name] = self._numbers(column, [row[place] for row in cells])
        # By row, where rows say a joint; NaN where one says none.
        self.joints = np.array([joint.joint(first, field) for field, joint in in_rows], dtype=float)
        if first == 0:
            self.notes.append("The file counts joints from 0; here they are counted from 1.")
        if unknown:
            self.notes.append("Columns passed over: " + ", ".join(repr(each) for each in unknown) + ".")

    def _joints_of_rows(self, columns: list[Column | None], cells: list[list[Any]]) -> list[tuple[str, JointName]]:
        """What errors call each row's joint, and what all its cells about it say together; empty without such cells."""
        about = {place: column.name for place, column in enumerate(columns) if column and column.quantity == "joint"}
        found = []
        for number, row in enumerate(cells, start=1) if about else ():
            field = f"{self.name}, row {number}, column {next(iter(about.values()))!r}"
            found.append((field, joint_of([row[place] for place in about], field)))
        return found

    def _numbers(self, column: Column, cells: list[Any]) -> FloatArray:
        values = np.empty(len(cells))
        for number, cell in enumerate(cells, start=1):
            field = f"{self.name}, row {number}, column {column.name!r}"
            value = category_of(cell, field) if column.quantity == "category" else number_of(cell)
            if value is None or math.isinf(value):
                raise InputError(field, f"{str(cell)[:40]!r} is not a number", "wanted a number, or nothing")
            if value < 0 or (value == 0 and column.quantity in ("speed", "distance", "extension")):
                raise InputError(field, f"{value:g} cannot be used", "wanted more than zero")
            values[number - 1] = value
        return values

    def table(self, category: int | None) -> StoppingTable:
        """The checked table."""
        keep = self._of_category(category)
        if self.joints.size:
            return self._from_long(keep).checked()
        distances = self._by_joint("distance")
        if not distances:
            raise InputError(self.name, "has no distances", f"wanted columns such as {EXAMPLE}")
        joints = tuple(sorted(distances))
        carried = self._extension(keep), *self._payload(keep)
        distance = np.column_stack([self._in_si(distances[j])[keep] for j in joints])
        times = self._by_joint("time")
        time = np.column_stack(
            [self._in_si(times[j])[keep] if j in times else np.full(len(keep), np.nan) for j in joints]
        )
        return self._assemble(joints, distance, time, carried, keep).checked()

    def _assemble(
        self,
        joints: tuple[int, ...],
        distance: FloatArray,
        time: FloatArray,
        carried: tuple[FloatArray, FloatArray, str],
        keep: np.ndarray,
        group: np.ndarray | None = None,
    ) -> StoppingTable:
        """The table of rows with these distances; ``carried``: extension, payload and its unit."""
        extension, payload, payload_unit = carried
        linear = self._linear()
        speed, full_speed, speed_linear = self._speed(joints, keep)
        if group is not None:  # one row for each combination, one column for each joint
            speed = speed[group]
        reach = self.stated.get("reach_mm")
        if reach is not None and (linear or speed_linear):
            arm = 1e-3 * self._stated_number("reach_mm") * extension[:, None]
            if not np.isfinite(arm).all():
                raise InputError(self.name, "has no extension", "wanted it, to turn lengths into angles by reach_mm")
            distance = distance / arm if linear else distance
            speed = speed / arm if speed_linear else speed
            full_speed = np.full_like(full_speed, np.nan) if speed_linear else full_speed
            linear = speed_linear = False
            self.notes.append(f"Lengths turned into angles by the extension and a reach of {float(reach):g} mm.")
        if linear != speed_linear:
            this, other = ("lengths", "angles") if linear else ("angles", "lengths")
            raise InputError(
                self.name,
                f"has distances as {this} and speeds as {other}",
                "wanted one of the two, or reach_mm with the extension",
            )
        return StoppingTable(
            source=self.name,
            joints=joints,
            payload=payload,
            payload_unit=payload_unit,
            extension=extension,
            speed=speed,
            distance=distance,
            time=time,
            full_speed=full_speed,
            linear=linear,
            row=tuple(int(i) + 1 for i in keep) if group is None else tuple(int(keep[i]) + 1 for i in group),
            category=self.category,
            notes=tuple(self.notes),
        )

    def _from_long(self, keep: np.ndarray) -> StoppingTable:
        """One row for each joint: gathered into one row for each payload, extension and speed."""
        numbers = self.joints[keep]
        (distance_column,) = self._single("distance")
        times = [column for column in self.columns if column.quantity == "time"]
        joints = tuple(sorted({int(number) for number in numbers if math.isfinite(number)}))
        if not np.isfinite(numbers).all() or not joints:
            hole = int(np.flatnonzero(~np.isfinite(numbers))[0])
            raise InputError(f"{self.name}, row {keep[hole] + 1}", "names no joint", "wanted a number from 1")
        extension, payload, payload_unit = self._extension(keep), *self._payload(keep)
        speed_column = self._single("speed")[0]
        raw = np.column_stack([np.nan_to_num(payload, nan=-1), np.nan_to_num(extension, nan=-1)])
        keys = np.column_stack([raw, self._in_si(speed_column)[keep]]).round(9)
        _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        shape = (len(first), len(joints))
        distance, time = np.full(shape, np.nan), np.full(shape, np.nan)
        for i, (g, number) in enumerate(zip(group.ravel(), numbers, strict=True)):
            k = joints.index(int(number))
            value = float(self._in_si(distance_column)[keep][i])
            if math.isnan(value):
                continue
            if math.isfinite(distance[g, k]) and distance[g, k] != value:
                raise InputError(
                    f"{self.name}, row {keep[i] + 1}",
                    "says another distance than an earlier row of the same joint, payload, extension and speed",
                    "leave one of the two out",
                )
            if math.isfinite(distance[g, k]):
                self.notes.append(f"Row {keep[i] + 1} repeats an earlier row: left out.")
            distance[g, k] = value
            if times:
                time[g, k] = self._in_si(times[0])[keep][i]
        carried = extension[first], payload[first], payload_unit
        return self._assemble(joints, distance, time, carried, keep, group=first)

    def _of_category(self, category: int | None) -> np.ndarray:
        """Rows of a stop category; columns of other categories are dropped.

        Raises:
            InputError: there are several, and none was asked for, or there is no such.
        """
        count = len(next(iter(self.values.values()), []))
        (column,) = self._single("category") if any(each.quantity == "category" for each in self.columns) else (None,)
        values = np.full(count, np.nan) if column is None else self.values[column.name]
        in_rows = {int(value) for value in values if math.isfinite(value)}
        in_names = {each.category for each in self.columns if each.category is not None}
        for known, where in (
            (in_rows, f"column {column.name!r}" if column else ""),
            (in_names, "the names of columns"),
        ):
            several = ", ".join(map(str, sorted(known)))
            if category is None and len(known) > 1:
                problem = f"is not given, and {self.name} has the stop categories {several} in {where}"
                raise InputError("category", problem, f"wanted one of {several}")
            if category is not None and known and category not in known:
                raise InputError("category", f"{category} is not in {self.name}", f"valid: {several}")
        if category is not None:
            self.columns = [each for each in self.columns if each.category in (None, category)]
        only = [each for each in (category, *in_rows, *in_names) if each is not None]
        self.category = only[0] if in_rows or in_names else None
        return np.flatnonzero(values == category) if category is not None and in_rows else np.arange(count)

    def _single(self, quantity: str) -> list[Column]:
        found = [column for column in self.columns if column.quantity == quantity]
        if len(found) != 1:
            problem = f"has {len(found) or 'no'} columns of the {quantity}"
            raise InputError(self.name, problem, f"wanted one: {EXAMPLE}")
        return found

    def _by_joint(self, quantity: str) -> dict[int, Column]:
        """Columns of a quantity; without a number it is that of the tool centre point."""
        found: dict[int, Column] = {}
        for column in self.columns:
            if column.quantity != quantity:
                continue
            joint = TCP if column.joint is None else column.joint
            numbers = f"wanted joints by their numbers, such as {EXAMPLE}"
            if column.joint is None and {"joint", "axis"} & {*column.named.rest}:  # as the "S-axis" of Yaskawa
                raise InputError(f"{self.name}, column {column.name!r}", "says a joint, and not which", numbers)
            if joint in found:
                whose = "no joint's number" if joint == TCP else "the same joint"
                problem = f"{found[joint].name!r} and {column.name!r}, both a {quantity}, say {whose}"
                raise InputError(self.name, problem, numbers if joint == TCP else "leave one of the two out")
            found[joint] = column
        return found

    def _in_si(self, column: Column) -> FloatArray:
        return np.asarray(self.values[column.name] * check_unit(column, self.name))

    def _linear(self) -> bool:
        """Whether distances are lengths.

        Raises:
            InputError: some are, others are angles.
        """
        columns = [column for column in self.columns if column.quantity == "distance"]
        lengths = [column for column in columns if column.unit in LENGTHS]
        if lengths and len(lengths) != len(columns):
            angle = next(column for column in columns if column.unit not in LENGTHS)
            problem = f"{lengths[0].name!r} is a length and {angle.name!r} an angle"
            raise InputError(self.name, problem, "wanted one of the two for all joints: give a file to each")
        return bool(lengths)

    def _payload(self, keep: np.ndarray) -> tuple[FloatArray, str]:
        if not any(column.quantity == "payload" for column in self.columns):
            return np.full(len(keep), np.nan), ""
        (column,) = self._single("payload")
        if column.unit == "kg":
            return self._filled(column, self._in_si(column)[keep], keep), "kg"
        return self._share(column, keep), "share"

    def _extension(self, keep: np.ndarray) -> FloatArray:
        if not any(column.quantity == "extension" for column in self.columns):
            return np.full(len(keep), np.nan)
        (column,) = self._single("extension")
        if column.unit in LENGTHS:
            lengths = self._filled(column, self._in_si(column)[keep], keep)
            return np.asarray(lengths / (1e-3 * self._stated_number("reach_mm")))
        return self._share(column, keep)

    def _filled(self, column: Column, values: FloatArray, keep: np.ndarray) -> FloatArray:
        """The values of the rows kept, where none is missing."""
        for i in np.flatnonzero(np.isnan(values)):
            raise InputError(f"{self.name}, row {keep[i] + 1}, column {column.name!r}", "is empty", "wanted a number")
        return values

    def _share(self, column: Column, keep: np.ndarray) -> FloatArray:
        """Values of a column in percent, or as shares, checked to be at most 1."""
        factor = check_unit(column, self.name)
        values = self.values[column.name][keep]
        # Nobody measures a stop at one percent and below: the numbers are shares.
        if factor != 1 and np.nanmax(values, initial=0.0) <= 1 and column.quantity != "payload":
            self.notes.append(f"Column {column.name!r} has no value above 1: read as shares, not percent.")
            factor = 1.0
        shares = self._filled(column, np.asarray(values * factor), keep)
        for i in np.flatnonzero(shares > 1 + 1e-9):
            field = f"{self.name}, row {keep[i] + 1}, column {column.name!r}"
            raise InputError(field, f"{values[i]:g} cannot be used", f"wanted at most {1 / factor:g}")
        return shares

    def _speed(self, joints: tuple[int, ...], keep: np.ndarray) -> tuple[FloatArray, FloatArray, bool]:
        """Speeds by row and joint, full speeds by joint, and whether they are those of lengths."""
        found = [column for column in self.columns if column.quantity == "speed"]
        if not found:
            raise InputError(self.name, "has no speeds", f"wanted columns such as {EXAMPLE}")
        by_joint = {column.joint: column for column in found}
        if None not in by_joint and set(by_joint) != set(joints):
            raise InputError(self.name, "has speeds of some joints only", "wanted one speed, or one for each distance")
        if len({column.unit in LENGTHS for column in found}) > 1 or len({column.unit for column in found}) > 1:
            problem = f"{found[0].name!r} and {found[1].name!r} are in different units"
            raise InputError(self.name, problem, "wanted one unit for all speeds")
        columns = [by_joint.get(None) or by_joint[joint] for joint in joints]
        if found[0].unit not in ("percent", "share"):
            speed = np.column_stack([self._in_si(column)[keep] for column in columns])
            self._no_holes(columns, speed, keep)
            self.notes += [
                f"{key} has no effect on speeds that are no shares." for key in FULL_SPEED if key in self.stated
            ]
            return speed, np.full(len(joints), np.nan), found[0].unit in LENGTHS
        shares = np.column_stack([self._share(column, keep) for column in columns])
        full, linear = self._full_speed(len(joints))
        return shares * full, full, linear

    def _no_holes(self, columns: list[Column], speed: FloatArray, keep: np.ndarray) -> None:
        for i, k in np.argwhere(~np.isfinite(speed)):
            field = f"{self.name}, row {keep[i] + 1}, column {columns[k].name!r}"
            raise InputError(field, "is empty", "wanted a number")

    def _full_speed(self, joints: int) -> tuple[FloatArray, bool]:
        given = [key for key in FULL_SPEED if key in self.stated]
        if len(given) != 1:
            problem = "is missing" if not given else f"is stated twice, as {' and '.join(given)}"
            raise InputError(
                f"{self.name}, full_speed_deg_s",
                problem,
                f"wanted the joints' full speed beside speeds in percent: {self._written('full_speed_deg_s', joints)}",
            )
        (key,) = given
        value = self.stated[key]
        values = value if isinstance(value, Sequence) and not isinstance(value, str) else [value]
        numbers = [number_of(each) for each in values]
        if len(numbers) not in (1, joints) or not all(each is not None and 0 < each < math.inf for each in numbers):
            raise InputError(f"{self.name}, {key}", f"{value!r} cannot be used", _full_speeds(joints))
        full = np.array([float(each or 0.0) for each in numbers]) * FULL_SPEED[key]
        return np.broadcast_to(full, (joints,)).copy(), key in ("full_speed_mm_s", "full_speed_m_s")

    def _written(self, key: str, joints: int) -> str:
        """How the file states numbers beside its columns."""
        numbers = ", ".join(_STATED_FOR_EXAMPLE[key] for _ in range(joints))
        if self.name.lower().endswith(".toml"):
            return f"a key {key} = {f'[{numbers}]' if joints > 1 else numbers}"
        return f"a line '# {key} = {numbers}' of its own in the file"

    def _stated_number(self, key: str) -> float:
        value = number_of(self.stated.get(key))
        if value is None or not 0 < value < math.inf:
            raise InputError(
                f"{self.name}, {key}", "is missing", f"wanted a number above zero: {self._written(key, 1)}"
            )
        return value
