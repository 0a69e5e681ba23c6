"""Rows of a plan that are filled in, and what recordings tell of them."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.errors import InputError
from bumpstop.measure.reading.text_table import TextTable, read_text_table
from bumpstop.register.shots import COLUMNS, LASTING, LOWER_BOUND, OF_RECORDINGS, PRESSURES, UNUSABLE
from bumpstop.rounding import to_decimals

if TYPE_CHECKING:
    from bumpstop.measure.reading.gauge_reading import GaugeReading

_NUMBERS = ("shot", *COLUMNS[2:], LOWER_BOUND, LASTING, *PRESSURES)
_NEEDED = ("situation", "speed_mm_s", "measured_peak_force_N")
WANTED = "wanted the plan.csv of bumpstop measure plan, filled in"


@dataclass(frozen=True)
class FilledShot:
    """A row of a filled plan.

    Attributes:
        row: of the file, from 1, without the header.
        shot: number as the plan has it; 0: the row has none.
        situation: name of it.
        speed_mm_s: of the tip [mm/s].
        predicted_N, low_N, high_N: as the plan has them [N]; NaN: the table does not say.
        measured_N: peak force that the gauge showed [N]; NaN: not taken yet.
        recording: file of it beside the table; empty: none.
        lower_bound_N, unusable_recording, lasting_N: of a recording that was read before, as a :class:`Shot` of a
            register has them.
        pressure_N_cm2, lasting_pressure_N_cm2: likewise, or of a film, as somebody wrote them down.
    """

    row: int
    shot: int
    situation: str
    speed_mm_s: float
    predicted_N: float
    low_N: float
    high_N: float
    measured_N: float
    recording: str
    lower_bound_N: float = math.nan
    unusable_recording: str = ""
    lasting_N: float = math.nan
    pressure_N_cm2: float = math.nan
    lasting_pressure_N_cm2: float = math.nan

    def with_reading(self, reading: GaugeReading | None) -> FilledShot:
        """The row with what its recording tells; None: it was not read."""
        if reading is None:
            return self
        usable = reading.usable
        # What a film showed beside a recording was there, too.
        pressures = (
            (self.pressure_N_cm2, reading.pressure_N_cm2),
            (self.lasting_pressure_N_cm2, reading.pressing_pressure_N_cm2),
        )
        first, later = (written if math.isnan(read) or written > read else read for written, read in pressures)
        return replace(
            self,
            measured_N=reading.peak_N if usable else self.measured_N,
            lower_bound_N=math.nan if usable else reading.lower_bound_N,
            unusable_recording="" if usable else self.recording,
            lasting_N=reading.pressing_N,
            pressure_N_cm2=first,
            lasting_pressure_N_cm2=later,
        )


def read_shots(path: Path) -> tuple[FilledShot, ...]:
    """Rows of a table of shots; columns in any order, further ones are passed over.

    Raises:
        InputError: a column is missing, a value cannot be used, or a recording is that of two shots; names row and
            column.
    """
    table = read_text_table(path, WANTED)
    for name in _NEEDED:
        if name not in table.names:
            raise InputError(f"{path}, column {name}", "is missing", WANTED)
    table.refuse_long_rows(table.beyond)
    numbers = {name: table.numbers(column) for column, name in enumerate(table.names) if name in _NUMBERS}
    found: list[FilledShot] = []
    rows_of: dict[str, int] = {}
    for row in range(len(table.rows)):
        name = table.cell(row, "situation").strip()
        measured = _positive(table, numbers, row, "measured_peak_force_N", empty=True)
        recording = table.cell(row, "recording").strip() if "recording" in table.names else ""
        if recording.isdigit() and not math.isnan(measured):
            where = f"{path}, row {row + 1}, recording"
            valid = "wanted a file, and decimal points where commas are between cells"
            raise InputError(where, f"{recording!r} stands beside a force of {measured:g} N", valid)
        # Where a force is filled in the recording is not read.
        if recording and math.isnan(measured):
            first = rows_of.setdefault(os.path.normpath(recording), row + 1)
            if first != row + 1:
                where = f"{path}, row {row + 1}, recording"
                raise InputError(where, f"{recording!r} is that of row {first}", "give each shot its own")
        if not name:
            raise InputError(f"{path}, row {row + 1}, situation", "is empty", "wanted the name of a situation")
        shot, predicted, low, high, bound, lasting, pressure, lasting_pressure = (
            _positive(table, numbers, row, key, empty=True, unbounded=key in COLUMNS[3:6])
            if key in table.names
            else math.nan
            for key in ("shot", *COLUMNS[3:6], LOWER_BOUND, LASTING, *PRESSURES)
        )
        found.append(
            FilledShot(
                row=row + 1,
                shot=0 if math.isnan(shot) else int(shot),
                situation=name,
                speed_mm_s=_positive(table, numbers, row, "speed_mm_s", empty=False),
                predicted_N=predicted,
                low_N=low,
                high_N=high,
                measured_N=measured,
                recording=recording,
                lower_bound_N=bound,
                unusable_recording=table.cell(row, UNUSABLE).strip() if UNUSABLE in table.names else "",
                lasting_N=lasting,
                pressure_N_cm2=pressure,
                lasting_pressure_N_cm2=lasting_pressure,
            )
        )
    if not found:
        raise InputError(str(path), "has no rows", WANTED)
    return tuple(found)


def shots_text(shots: Sequence[FilledShot], readings: Mapping[int, GaugeReading]) -> str:
    """Predictions and measured peak forces as CSV, in the first columns of a plan, and what recordings tell besides.

    Args:
        shots: rows.
        readings: of the recordings that count, by number of the row: a peak that can be relied on, or else what it is
            at least, and the name of the recording; what lasts, and pressures.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow((*COLUMNS, *OF_RECORDINGS))
    for row in shots:
        shot = row.with_reading(readings.get(row.row))
        told = (shot.measured_N, shot.lower_bound_N, shot.lasting_N, shot.pressure_N_cm2, shot.lasting_pressure_N_cm2)
        # What is a hair above its limit stays above it.
        up = [to_decimals(figure, 2, up=True) for figure in told]
        figures = (shot.predicted_N, shot.low_N, shot.high_N, *up)
        cells = ["" if math.isnan(figure) else f"{figure:.2f}" for figure in figures]
        speed = f"{shot.speed_mm_s:.10g}"
        writer.writerow((shot.situation, shot.shot or shot.row, speed, *cells[:5], shot.unusable_recording, *cells[5:]))
    return text.getvalue()


def _positive(
    table: TextTable,
    numbers: Mapping[str, list[float]],
    row: int,
    name: str,
    *,
    empty: bool,
    unbounded: bool = False,
) -> float:
    text = table.cell(row, name).strip()
    if not text and empty:
        return math.nan
    if unbounded and text == "inf":
        return math.inf  # as a plan writes it of shots that may never be detected
    value = numbers[name][row]
    if not 0 < value < math.inf:
        raise InputError(
            f"{table.source}, row {row + 1}, {name}", f"{text!r} cannot be used", "wanted a number above zero"
        )
    return value
