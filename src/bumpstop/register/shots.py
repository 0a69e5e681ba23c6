"""Shots of a force gauge: what was predicted for each, and what was measured."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass

from bumpstop.errors import InputError, near_matches
from bumpstop.register.faults import RegisterError
from bumpstop.register.situation import Situation
from bumpstop.text_files import as_path, read_text

COLUMNS = (
    "situation",
    "shot",
    "speed_mm_s",
    "predicted_peak_force_N",
    "predicted_low_N",
    "predicted_high_N",
    "measured_peak_force_N",
)
"""Columns of a file of shots, in any order; others are passed over."""
_MAX_FORCE_N, _MAX_SPEED_MM_S = 1e6, 1e5
_WANTED = f"wanted a file of shots (CSV) with the columns {', '.join(COLUMNS)}"


@dataclass(frozen=True, kw_only=True)
class Shot:
    """One shot, planned or made.

    Attributes:
        situation: name of the contact situation that it stands for.
        shot: what it is called.
        speed_mm_s: of the tip [mm/s].
        predicted_N: peak force at the gauge [N]; NaN: not predicted.
        low_N, high_N: band in which the peak was expected [N]; NaN: none.
        measured_N: peak force of the gauge [N]; NaN: not measured yet.
    """

    situation: str
    shot: str
    speed_mm_s: float
    predicted_N: float
    low_N: float
    high_N: float
    measured_N: float

    @property
    def measured(self) -> bool:
        """Whether there is a measured peak."""
        return math.isfinite(self.measured_N)

    @property
    def in_band(self) -> bool | None:
        """Whether the measured peak lies in the band; None where either is missing."""
        if not self.measured or math.isnan(self.low_N) or math.isnan(self.high_N):
            return None
        return self.low_N <= self.measured_N <= self.high_N


def load_shots(path: str | os.PathLike[str], situations: Sequence[Situation]) -> tuple[Shot, ...]:
    """Read a file of shots.

    Args:
        path: of a CSV with the columns :data:`COLUMNS`; predictions and measured peaks may be empty.
        situations: of the register that the shots belong to.

    Raises:
        RegisterError: cells that cannot be used; it names them all.
        InputError: the file cannot be read, or lacks a column.
    """
    path = as_path(path, "shots")
    lines = [
        (number, line)
        for number, line in enumerate(read_text(path, _WANTED).splitlines(), start=1)
        if line.strip(" \t,;") and not line.lstrip().startswith("#")
    ]
    if len(lines) < 2:
        raise InputError(str(path), "has no shots", _WANTED)
    head = lines[0][1]
    delimiter = max((";", "\t", ","), key=lambda mark: (head.count(mark), mark == ";"))
    try:
        cells = list(csv.reader((line for _, line in lines), delimiter=delimiter, skipinitialspace=True))
    except csv.Error as error:
        raise InputError(str(path), f"is not valid CSV ({error})", _WANTED) from None
    names = [name.strip() for name in cells[0]]
    for column in COLUMNS:
        if names.count(column) != 1:
            problem = "is missing" if column not in names else "is there twice"
            raise InputError(f"{path} column {column}", problem, _WANTED)
    faults: list[InputError] = []
    shots: list[Shot] = []
    known = {situation.name for situation in situations}
    for (number, _), row in zip(lines[1:], cells[1:], strict=False):
        reader = _Row(f"{path} row {number}", dict(zip(names, (cell.strip() for cell in row), strict=False)), faults)
        if len(row) != len(names):
            problem = f"has {len(row)} cells, and there are {len(names)} columns"
            faults.append(InputError(f"{path} row {number}", problem, "wanted one for each column"))
            continue
        shots.append(reader.shot(known, "," if delimiter == "," else "."))
    if faults:
        raise RegisterError(str(path), faults)
    return tuple(shots)


class _Row:
    """A row whose faults are gathered."""

    def __init__(self, where: str, cells: dict[str, str], faults: list[InputError]) -> None:
        self._where, self._cells, self._faults = where, cells, faults

    def shot(self, known: set[str], thousands: str) -> Shot:
        name = self._cells["situation"]
        if name not in known:
            self._fault("situation", f"{name!r} is not in the register", near_matches(name, sorted(known)))
        speed = self._number("speed_mm_s", _MAX_SPEED_MM_S, thousands)
        if math.isnan(speed) and not self._cells["speed_mm_s"]:
            self._fault("speed_mm_s", "is missing", f"wanted a number from 0 to {_MAX_SPEED_MM_S:g}")
        low, high = (self._number(f"predicted_{end}_N", _MAX_FORCE_N, thousands) for end in ("low", "high"))
        if low > high:
            self._fault("predicted_low_N", f"{low:g} is above predicted_high_N = {high:g}", "wanted low to high")
        return Shot(
            situation=name,
            shot=self._cells["shot"],
            speed_mm_s=speed,
            predicted_N=self._number("predicted_peak_force_N", _MAX_FORCE_N, thousands),
            low_N=low,
            high_N=high,
            measured_N=self._number("measured_peak_force_N", _MAX_FORCE_N, thousands),
        )

    def _number(self, column: str, most: float, thousands: str) -> float:
        text = self._cells[column]
        if not text:
            return math.nan
        try:
            value = float(text if thousands == "," else text.replace(",", "."))
        except ValueError:
            value = math.nan
        if not 0 <= value <= most:
            self._fault(column, f"{text[:40]!r} cannot be used", f"wanted a number from 0 to {most:g}, or nothing")
            return math.nan
        return value

    def _fault(self, column: str, problem: str, valid: str) -> None:
        self._faults.append(InputError(f"{self._where}, {column}", problem, valid))
