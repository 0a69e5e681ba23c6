"""Force over time as a gauge recorded it."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.errors import InputError
from bumpstop.measure.reading.gauge_columns import UNITS, GaugeColumn, Quantity, find_column
from bumpstop.measure.reading.gauge_preamble import stated_range, stated_rates
from bumpstop.measure.reading.text_table import TextTable, is_figure, read_text_table
from bumpstop.text_files import as_path, shown

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray

_WANTED = "wanted the CSV of a gauge: time and force with their units in the header"
_MAX_BYTES = 100_000_000
_MIN_SAMPLES = 8
# What no device shows is no number of one; clocks count up to microseconds since 1970.
_MAX_VALUE, _MAX_CLOCK = 1e9, 1e16
_SAME_TIME_S = 1e-9
# Where time goes back in a larger share of the rows, it is none.
MAX_BACKWARD_SHARE = 0.1
_MIN_RECORDING_SHARE = 0.05
_MAX_OVERLONG_SHARE = 0.05


@dataclass(frozen=True)
class GaugeFormat:
    """What a user tells of a recording; None: found in the file.

    Attributes:
        time_column, force_column, pressure_column: names, or numbers from 1.
        time_unit, force_unit, pressure_unit: see :data:`bumpstop.measure.reading.gauge_columns.UNITS`.
        rate_hz: sampling rate of a file without time.
        trigger_N: force at which contact begins.
        full_scale_N: end of the device's range.
    """

    time_column: str | None = None
    force_column: str | None = None
    pressure_column: str | None = None
    time_unit: str | None = None
    force_unit: str | None = None
    pressure_unit: str | None = None
    rate_hz: float | None = None
    trigger_N: float | None = None
    full_scale_N: float | None = None

    def __post_init__(self) -> None:
        for name in ("rate_hz", "trigger_N", "full_scale_N"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise InputError(name, f"is {value:g}", "wanted a number above zero")


@dataclass(frozen=True, eq=False)
class GaugeCurve:
    """Samples of one recording, in the order of time.

    Attributes:
        time: (samples,) [s].
        force: positive where the gauge is pressed (samples,) [N].
        pressure: highest of the sensor (samples,), NaN where unreadable [N/cm2]; None: the file has none.
        source: the file.
        columns: names of the columns of time, force and pressure; empty: none.
        units: their units as read.
        full_scale_N: end of the device's range; NaN: not known.
        lost: when rows that held no number stand in the file; a row without a time has that of the row before [s].
        repeated: rows at a time that an earlier one has.
        backward: rows that stood in the wrong order of time and were sorted.
        rate_told: the times were made from a sampling rate.
    """

    time: FloatArray
    force: FloatArray
    pressure: FloatArray | None
    source: str
    columns: tuple[str, str, str]
    units: tuple[str, str, str]
    full_scale_N: float
    lost: FloatArray
    repeated: int
    backward: int
    rate_told: bool

    @property
    def unreadable(self) -> int:
        """How many rows held no number."""
        return int(self.lost.size)

    @property
    def step(self) -> float:
        """Median time between samples [s]."""
        return float(np.median(np.diff(self.time)))


def load_gauge_curve(path: Path, form: GaugeFormat | None = None) -> GaugeCurve:
    """Read a recording of a gauge.

    Rows without numbers and rows at a time that was there already are dropped, rows in the wrong order of time sorted;
    all are counted.

    Args:
        path: CSV with comma, semicolon or tab, decimal point or comma, any lines above the header.
        form: what the user tells.

    Raises:
        InputError: the file cannot be read, has no column of force, states no unit, or has neither time nor a rate.
    """
    path = as_path(path, "recording")
    form = GaugeFormat() if form is None else form
    table = read_text_table(path, _WANTED, max_bytes=_MAX_BYTES)
    preamble = " ; ".join(table.preamble)
    overlong = _overlong(table)
    names = table.names
    if not table.has_header and len(names) == 2 and form.force_column is None:
        # Two columns without a name are time and force.
        form = _with_columns(form)
    try:
        force_column = find_column(names, "force", form.force_column, form.force_unit)
        time_column = find_column(names, "time", form.time_column, form.time_unit)
        pressure_column = find_column(names, "pressure", form.pressure_column, form.pressure_unit)
    except InputError as error:
        raise InputError(f"{path}, {error.field}", error.problem, error.valid) from None
    if force_column is None:
        raise InputError(f"{path}, force_column", "is not found", f"say which of {', '.join(map(repr, names))} it is")
    force_unit = _unit(force_column, "force", path, preamble)
    force = _values(table, force_column.number) * UNITS["force"][force_unit]
    force[overlong] = math.nan
    pressure, pressure_unit = None, ""
    if pressure_column is not None:
        pressure_unit = _unit(pressure_column, "pressure", path, preamble)
        pressure = _values(table, pressure_column.number) * UNITS["pressure"][pressure_unit]
    time_unit = ""
    if time_column is None:
        rate = form.rate_hz or _stated_rate(table, path)
        time = np.arange(force.size) / rate
    else:
        time_unit = _unit(time_column, "time", path, preamble)
        time = _values(table, time_column.number, since_median=True) * UNITS["time"][time_unit]
    full_scale = form.full_scale_N or stated_range(table.preamble)
    _refuse_second_recording(time, path)
    readable = np.isfinite(time) & np.isfinite(force)
    lost = _filled(time)[~readable]
    time, force = time[readable], force[readable]
    pressure = None if pressure is None else pressure[readable]
    time, force, pressure, counts = _sorted(time, force, pressure)
    if time.size < _MIN_SAMPLES:
        raise InputError(str(path), f"has {time.size} samples that can be read", f"wanted at least {_MIN_SAMPLES}")
    return GaugeCurve(
        time=time,
        force=force,
        pressure=pressure,
        source=shown(path),
        columns=(
            time_column.name if time_column else "",
            force_column.name,
            pressure_column.name if pressure_column else "",
        ),
        units=(time_unit, force_unit, pressure_unit),
        full_scale_N=math.nan if full_scale is None else full_scale,
        lost=lost,
        repeated=counts[0],
        backward=counts[1],
        rate_told=time_column is None,
    )


def _with_columns(form: GaugeFormat) -> GaugeFormat:
    from dataclasses import replace

    return replace(form, time_column=form.time_column or "1", force_column="2")


def _unit(column: GaugeColumn, quantity: Quantity, path: Path, preamble: str) -> str:
    if column.unit:
        return column.unit
    # Some devices state the unit once above the table.
    for unit in UNITS[quantity]:
        if re.search(rf"\b{quantity}\b[^;]{{0,20}}[\[(]\s*{re.escape(unit)}\s*[\])]", preamble, re.IGNORECASE):
            return unit
    known = ", ".join(UNITS[quantity])
    raise InputError(
        f"{path}, {quantity}_unit", f"column {column.name!r} states no unit of {quantity}", f"give one of {known}"
    )


def _stated_rate(table: TextTable, path: Path) -> float:
    """The sampling rate that stands above the table [Hz].

    Raises:
        InputError: there is none, or there are several.
    """
    rates = sorted(stated_rates(table.preamble))
    if not rates:
        raise InputError(f"{path}, time_column", "is not found", "give it, or the sampling rate: rate_hz")
    if len(rates) > 1 or not rates[0] > 0:
        said = ", ".join(f"{rate:g}" for rate in rates)
        raise InputError(f"{path}, rate_hz", f"may be any of {said} above the table", "give the sampling rate: rate_hz")
    return rates[0]


def _values(table: TextTable, column: int, *, since_median: bool = False) -> FloatArray:
    """Cells of a column; NaN where they are none that a device shows, of a clock since the middle of the recording."""
    values = np.array(table.numbers(column), dtype=np.float64)
    known = values[np.abs(values) < _MAX_CLOCK]
    middle = float(np.median(known)) if since_median and known.size else 0.0
    return np.where(np.abs(values - middle) < _MAX_VALUE, values, np.nan)


def _overlong(table: TextTable) -> list[int]:
    """Rows that have more numbers than the header has columns, so that it is not known which is which.

    Raises:
        InputError: they are many.
    """
    rows = [row for row, cells in table.beyond.items() if is_figure(cells[0])]
    if len(rows) > _MAX_OVERLONG_SHARE * len(table.rows):
        table.refuse_long_rows(rows)
    return rows


def _refuse_second_recording(time: FloatArray, path: Path) -> None:
    """Refuse times that begin anew: rows after them are at times of rows before.

    Rows that a device wrote late are few, and a ring buffer that is read out from its middle has no time twice.

    Raises:
        InputError: a second recording begins in the file.
    """
    rows = np.flatnonzero(np.isfinite(time))
    known = time[rows]
    back = np.flatnonzero(np.diff(known) < 0) + 1
    if back.size > MAX_BACKWARD_SHARE * known.size:
        return  # no time at all
    long: list[FloatArray] = []
    for begin, block in zip([0, *back.tolist()], np.split(known, back), strict=True):
        if block.size < max(_MIN_SAMPLES, _MIN_RECORDING_SHARE * known.size):
            continue
        for other in long:
            both = min(block[-1], other[-1]) - max(block[0], other[0])
            if both > 0.5 * min(np.ptp(block), np.ptp(other)):
                raise InputError(
                    f"{path}, row {rows[begin] + 1}",
                    f"goes back in time from {known[begin - 1]:.6g} s to {known[begin]:.6g} s: a second recording "
                    "begins",
                    "wanted one recording; split the file there",
                )
        long.append(block)


def _filled(time: FloatArray) -> FloatArray:
    """Times, each that is no number replaced by the last one that is."""
    known = np.isfinite(time)
    last = np.maximum.accumulate(np.where(known, np.arange(time.size), 0))
    return np.where(known[last], time[last], -math.inf)


def _sorted(
    time: FloatArray, force: FloatArray, pressure: FloatArray | None
) -> tuple[FloatArray, FloatArray, FloatArray | None, tuple[int, int]]:
    backward = int((np.diff(time) < 0).sum())
    order = np.argsort(time, kind="stable")
    first = np.ones(time.size, dtype=bool)
    first[1:] = np.diff(time[order]) > _SAME_TIME_S
    order = order[first]
    counts = (int(time.size - order.size), backward)
    return time[order], force[order], None if pressure is None else pressure[order], counts
