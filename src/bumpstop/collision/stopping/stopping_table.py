"""Stopping distances by payload, extension and speed, as ISO 10218-1 has makers publish them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.collision.stopping.joint_names import TCP
from bumpstop.errors import InputError

# Distances by speed of one joint differ by payload and extension, but not by this: what does is in another unit.
_MAX_SPREAD = 12.0
# Of published distances and times: a stop that takes its whole way at full speed would be as far off.
_ROUNDING = 0.02


@dataclass(frozen=True, eq=False, kw_only=True)
class StoppingTable:
    """Stopping distances of an arm.

    Attributes:
        source: the file.
        joints: numbers from 1, in the order of the columns; 0 is the tool centre point.
        payload: (rows,) share of the rated payload, or kg; NaN where the table says none.
        payload_unit: ``"share"``, ``"kg"``, or empty.
        extension: (rows,) share of the reach [1]; NaN where the table says none.
        speed: (rows, joints) at the beginning of the stop [rad/s; m/s where ``linear``].
        distance: (rows, joints) until standstill [rad or m]; NaN: a hole.
        time: (rows, joints) until standstill, as published [s]; NaN: none.
        full_speed: (joints,) at 100 % [rad/s or m/s]; NaN where speeds are not shares.
        linear: the distances are lengths, of the tool centre point or of joints that slide.
        row: (rows,) numbers in the file, from 1.
        category: the stop category of its rows; None where the file says none.
        notes: what was repaired or assumed while reading.
    """

    source: str
    joints: tuple[int, ...]
    payload: FloatArray
    payload_unit: str
    extension: FloatArray
    speed: FloatArray
    distance: FloatArray
    time: FloatArray
    full_speed: FloatArray
    linear: bool
    row: tuple[int, ...]
    category: int | None = None
    notes: tuple[str, ...] = ()

    @property
    def known(self) -> np.ndarray:
        """Where there is a distance (rows, joints)."""
        return np.asarray(np.isfinite(self.distance))

    def joint_name(self, column: int) -> str:
        """``"joint 2"``, or ``"TCP"``."""
        return "TCP" if self.joints[column] == TCP else f"joint {self.joints[column]}"

    @property
    def cell(self) -> np.ndarray:
        """(rows,) number of the combination of payload and extension that a row belongs to."""
        keys = np.column_stack([np.nan_to_num(self.payload, nan=-1), np.nan_to_num(self.extension, nan=-1)])
        return np.asarray(np.unique(keys.round(9), axis=0, return_inverse=True)[1]).ravel()

    @property
    def distance_unit(self) -> tuple[str, float]:
        """Unit that people read, and how many of it an SI unit is."""
        return ("mm", 1e3) if self.linear else ("deg", 180 / np.pi)

    @property
    def speed_unit(self) -> tuple[str, float]:
        """The same of speeds."""
        return ("mm/s", 1e3) if self.linear else ("deg/s", 180 / np.pi)

    def checked(self) -> StoppingTable:
        """The table with its rows in order, without repeated ones, and what was mended in its notes.

        Raises:
            InputError: too few rows or speeds, rows that contradict each other, values in another unit than the others.
        """
        table = self._sorted()._without_repeats()
        notes = list(table.notes)
        for k in range(len(table.joints)):
            known = table.known[:, k]
            holes = [str(table.row[i]) for i in np.flatnonzero(~known)]
            if known.sum() < 2:
                what = "one distance" if known.any() else "no distance"
                raise InputError(
                    table.source, f"has {what} of {table.joint_name(k)}", "wanted at least two, at different speeds"
                )
            if holes:
                notes.append(f"No distance of {table.joint_name(k)} in row {', '.join(holes)}: left out.")
            speeds = np.unique(table.speed[known, k].round(12))
            if len(speeds) < 2:
                raise InputError(
                    table.source,
                    f"has one speed of {table.joint_name(k)} only",
                    "a law of slowing down shows at two speeds or more",
                )
            table._check_scale(k)
            notes += table._falling(k)
            notes += table._too_far(k)
        return replace(table, notes=tuple(notes))

    def _only(self, rows: np.ndarray) -> StoppingTable:
        arrays = {name: getattr(self, name)[rows] for name in ("payload", "extension", "speed", "distance", "time")}
        return replace(self, **arrays, row=tuple(self.row[int(i)] for i in rows))

    def _sorted(self) -> StoppingTable:
        keys = (self.speed[:, 0], np.nan_to_num(self.extension), np.nan_to_num(self.payload))
        order = np.lexsort(keys)
        if (order == np.arange(len(order))).all():
            return self
        note = "Rows sorted by payload, extension and speed."
        return replace(self._only(order), notes=(*self.notes, note))

    def _without_repeats(self) -> StoppingTable:
        keep: list[int] = []
        first: dict[tuple[float, ...], int] = {}
        notes = list(self.notes)
        cases = np.nan_to_num(np.column_stack([self.payload, self.extension]), nan=-1)
        for i in range(len(self.row)):
            # Joints may have speeds of their own: a row is a case of each.
            known = np.flatnonzero(self.known[i]).tolist()
            earlier = [first.setdefault((k, *np.array([*cases[i], self.speed[i, k]]).round(9)), i) for k in known]
            for k, other in zip(known, earlier, strict=True):
                if self.distance[i, k] != self.distance[other, k]:
                    raise InputError(
                        self.source,
                        f"rows {self.row[other]} and {self.row[i]} say different distances of one payload, extension "
                        f"and speed of {self.joint_name(k)}",
                        "leave one of the two out",
                    )
            if i in earlier or not earlier:
                keep.append(i)
                continue
            same = ", ".join(str(self.row[other]) for other in sorted(set(earlier)))
            notes.append(f"Row {self.row[i]} repeats row {same}: left out.")
        return replace(self._only(np.array(keep)), notes=tuple(notes))

    def _check_scale(self, k: int) -> None:
        """Refuse a value that is far from what the others lead to expect: it is in another unit."""
        known = np.flatnonzero(self.known[:, k])
        distance, speed = self.distance[known, k], self.speed[known, k]
        # No law lies outside these two: distance grows with the speed at least as its half power, at most as its cube.
        for i, d, v in zip(known, distance, speed, strict=True):
            others = known != i
            rise = v / speed[others]
            low, high = np.minimum(rise**0.5, rise**3), np.maximum(rise**0.5, rise**3)
            ratio = d / distance[others]
            if np.median(ratio / high) > _MAX_SPREAD or np.median(low / ratio) > _MAX_SPREAD:
                unit, factor = self.distance_unit
                raise InputError(
                    f"{self.source}, row {self.row[i]}",
                    f"a distance of {d * factor:.4g} {unit} of {self.joint_name(k)} at {self._speed(v)} is "
                    f"{np.median(ratio):.3g} times the others",
                    "wanted one unit for all rows of a column",
                )

    def _speed(self, v: float) -> str:
        unit, factor = self.speed_unit
        return f"{v * factor:.4g} {unit}"

    def _falling(self, k: int) -> list[str]:
        """A note for each pair of rows of which the faster one stops sooner."""
        notes = []
        cell = self.cell
        for c in np.unique(cell):
            rows = [i for i in np.flatnonzero(cell == c) if self.known[i, k]]
            for slow, fast in pairwise(sorted(rows, key=lambda i: float(self.speed[i, k]))):
                if self.distance[fast, k] < self.distance[slow, k]:
                    notes.append(
                        f"The distance of {self.joint_name(k)} in row {self.row[fast]} is shorter than in the slower "
                        f"row {self.row[slow]}."
                    )
        return notes

    def _too_far(self, k: int) -> list[str]:
        """A note where a joint goes farther than at its first speed for all of the published time."""
        with np.errstate(invalid="ignore"):
            far = self.distance[:, k] > self.speed[:, k] * self.time[:, k] * (1 + _ROUNDING)
        if not far.any():
            return []
        i, (unit, factor) = int(far.argmax()), self.distance_unit
        rows = ", ".join(str(self.row[each]) for each in np.flatnonzero(far))
        full = " and the full speed" if np.isfinite(self.full_speed[k]) else ""
        return [
            f"The distance of {self.joint_name(k)} in row {rows} is longer than "
            f"its speed for all of the published time: {self.distance[i, k] * factor:.4g} {unit} at "
            f"{self._speed(self.speed[i, k])} within {self.time[i, k] * 1e3:.4g} ms. Look at the units{full}."
        ]
