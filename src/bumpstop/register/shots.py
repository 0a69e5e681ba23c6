"""Shots of a force gauge: what was predicted for each, and what was measured."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass

from bumpstop.collision.scenario.scenario_tables import MIN_SPEED_MM_S
from bumpstop.csv_table import read_csv_table
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
LOWER_BOUND, UNUSABLE, LASTING, RECORDING = "lower_bound_N", "unusable_recording", "lasting_force_N", "recording"
PRESSURES = ("pressure_N_cm2", "lasting_pressure_N_cm2")
"""Columns of the pressure in the first half second of contact and after it."""
OF_RECORDINGS = (LOWER_BOUND, UNUSABLE, LASTING, *PRESSURES)
"""Columns that ``measure calibrate`` adds: what recordings tell beside peaks, and where no peak can be relied on."""
MAY_LACK = (*OF_RECORDINGS, RECORDING)
"""Columns that a file may have beside :data:`COLUMNS`; the last is one of a plan."""
_NUMBERS = (*COLUMNS[2:], LOWER_BOUND, LASTING, *PRESSURES)
_MAX_FORCE_N, _MAX_PRESSURE_N_CM2, _MAX_SPEED_MM_S = 1e6, 1e6, 1e5
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
        measured_N: peak force of the gauge [N]; NaN: there is none, be it that the shot is not made yet.
        lower_bound_N: without a peak, what the gauge showed at least [N]; NaN: not known.
        unusable_recording: file whose peak cannot be relied on; empty: none.
        lasting_N: greatest force of the gauge after the first half second of contact [N]; NaN: not known.
        pressure_N_cm2, lasting_pressure_N_cm2: highest pressure that a film or sensor showed, at least; of one that is
            told over time, in the first half second of contact and after it [N/cm2]; NaN: not known.
        recording: file that was not read yet, as a plan has it; empty: none.
    """

    situation: str
    shot: str
    speed_mm_s: float
    predicted_N: float
    low_N: float
    high_N: float
    measured_N: float
    lower_bound_N: float = math.nan
    unusable_recording: str = ""
    lasting_N: float = math.nan
    pressure_N_cm2: float = math.nan
    lasting_pressure_N_cm2: float = math.nan
    recording: str = ""

    @property
    def measured(self) -> bool:
        """Whether there is a measured peak."""
        return math.isfinite(self.measured_N)

    @property
    def without_peak(self) -> bool:
        """Whether the shot was made and has no peak that can be relied on."""
        told = (self.lower_bound_N, self.lasting_N, *self.pressures_N_cm2)
        return not self.measured and (any(map(math.isfinite, told)) or bool(self.unusable_recording or self.recording))

    @property
    def pressures_N_cm2(self) -> tuple[float, float]:
        """Those of the first half second and after it [N/cm2]."""
        return self.pressure_N_cm2, self.lasting_pressure_N_cm2

    @property
    def in_band(self) -> bool | None:
        """Whether the measured peak lies in the band; None where either is missing."""
        if not self.measured or math.isnan(self.low_N) or math.isnan(self.high_N):
            return None
        return self.low_N <= self.measured_N <= self.high_N


def load_shots(path: str | os.PathLike[str], situations: Sequence[Situation]) -> tuple[Shot, ...]:
    """Read a file of shots.

    Args:
        path: of a CSV with the columns :data:`COLUMNS`; predictions and measured peaks may be empty. It may have those
            of :data:`OF_RECORDINGS`, and the ``recording`` of a plan.
        situations: of the register that the shots belong to.

    Raises:
        RegisterError: rows and cells that cannot be used; it names them all.
        InputError: the file cannot be read, or lacks a column.
    """
    path = as_path(path, "shots")
    table = read_csv_table(read_text(path, _WANTED), path, _WANTED, "shot", known=(*COLUMNS, *MAY_LACK))
    for column in (*COLUMNS, *MAY_LACK):
        if column not in table.names and column in COLUMNS:
            raise InputError(f"{path} column {column}", "is missing", _WANTED)
        if table.names.count(column) > 1:
            raise InputError(f"{path} column {column}", "is there twice", _WANTED)
    if not table.rows:
        raise InputError(str(path), "has no shots", _WANTED)
    numbers = {table.names.index(column) for column in _NUMBERS if column in table.names}
    decimal_commas = table.delimiter != "," and any(
        "," in row[i] for _, row in table.rows if not isinstance(row, InputError) for i in numbers
    )
    faults: list[InputError] = []
    shots: list[Shot] = []
    known = {situation.name for situation in situations}
    for number, row in table.rows:
        if isinstance(row, InputError):
            faults.append(row)
            continue
        cells = dict.fromkeys(MAY_LACK, "")
        cells |= {name: cell.strip() for name, cell in zip(table.names, row, strict=True)}
        shots.append(_Row(f"{path} row {number}", cells, faults, decimal_commas).shot(known))
    if faults:
        raise RegisterError(str(path), faults)
    return tuple(shots)


class _Row:
    """A row whose faults are gathered."""

    def __init__(self, where: str, cells: dict[str, str], faults: list[InputError], decimal_commas: bool) -> None:
        self._where, self._cells, self._faults, self._decimal_commas = where, cells, faults, decimal_commas

    def shot(self, known: set[str]) -> Shot:
        name = self._cells["situation"]
        if name not in known:
            self._fault("situation", f"{name!r} is not in the register", near_matches(name, sorted(known)))
        # Of an arm that stands nothing can be expected.
        speed = self._number("speed_mm_s", _MAX_SPEED_MM_S, MIN_SPEED_MM_S)
        if math.isnan(speed) and not self._cells["speed_mm_s"]:
            self._fault("speed_mm_s", "is missing", f"wanted a number from {MIN_SPEED_MM_S:g} to {_MAX_SPEED_MM_S:g}")
        low, high = (self._number(f"predicted_{end}_N", _MAX_FORCE_N) for end in ("low", "high"))
        for end, value, other in (("low", low, high), ("high", high, low)):
            # Half a band would judge no peak, and leave the shot without a word.
            column = f"predicted_{end}_N"
            if math.isnan(value) and not self._cells[column] and not math.isnan(other):
                self._fault(column, "is missing", "wanted both ends of the band, or neither")
        if low > high:
            self._fault("predicted_low_N", f"{low:g} is above predicted_high_N = {high:g}", "wanted low to high")
        measured, bound, lasting = (
            self._number(column, _MAX_FORCE_N) for column in ("measured_peak_force_N", LOWER_BOUND, LASTING)
        )
        if not math.isnan(measured) and not math.isnan(bound):
            self._fault(LOWER_BOUND, "stands beside a measured peak", "give one of the two")
        pressure, lasting_pressure = (self._number(column, _MAX_PRESSURE_N_CM2, above=True) for column in PRESSURES)
        return Shot(
            situation=name,
            shot=self._cells["shot"],
            speed_mm_s=speed,
            predicted_N=self._number("predicted_peak_force_N", _MAX_FORCE_N),
            low_N=low,
            high_N=high,
            measured_N=measured,
            lower_bound_N=bound,
            unusable_recording=self._cells[UNUSABLE],
            lasting_N=lasting,
            pressure_N_cm2=pressure,
            lasting_pressure_N_cm2=lasting_pressure,
            recording=self._cells[RECORDING],
        )

    def _number(self, column: str, most: float, least: float = 0.0, *, above: bool = False) -> float:
        text = self._cells[column]
        if not text:
            return math.nan
        if self._decimal_commas and "." in text:
            # 1.250 may be a thousand and more, and would be read as little more than one.
            problem = f"{text[:40]!r} has a dot, and the file has decimal commas"
            self._fault(column, problem, "wanted numbers with decimal commas and no marks between thousands")
            return math.nan
        try:
            value = float(text.replace(",", ".") if self._decimal_commas else text)
        except ValueError:
            value = math.nan
        if not least <= value <= most or (above and value == least):
            empty = "" if least > 0 else ", or nothing"
            wanted = f"above {least:g} and up to {most:g}" if above else f"from {least:g} to {most:g}"
            self._fault(column, f"{text[:40]!r} cannot be used", f"wanted a number {wanted}{empty}")
            return math.nan
        return value

    def _fault(self, column: str, problem: str, valid: str) -> None:
        self._faults.append(InputError(f"{self._where}, {column}", problem, valid))
