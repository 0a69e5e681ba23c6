"""Residuals recorded in free motion, and how long their memory is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.detection.tuning.found_with import from_text, to_text
from bumpstop.errors import InputError
from bumpstop.output_files import write_parquet
from bumpstop.recording.formats.reader_process import read_guarded
from bumpstop.signal import correlation_time
from bumpstop.text_files import as_path

# A row is a tick, wherever in its period it was taken. An interval this far from the feedback period, as a share of
# it, is a lost tick or one too many: across it the noise loses its correlation, so that correlations are
# told too small by at most the share of such intervals.
_UNEVEN = 0.5
_MAX_UNEVEN_SHARE = 0.05  # share of the intervals
_MIN_ROWS = 100
# A block this many correlation times long keeps nine tenths and more of the correlation inside blocks.
_TIMES = 10
_FOUND_WITH = "found_with"  # key of a file's metadata


@dataclass(frozen=True, eq=False)
class ResidualRecord:
    """Residuals of free motion at the feedback rate, to be resampled in blocks of rows.

    Attributes:
        rows: (N, dof) residual, estimated minus predicted motor torque [Nm or N].
        block_rows: rows in a block: ten times the longest correlation time of any joint, at least 1 and at most a
            tenth of the record.
        correlation_rows: (dof,) integrated correlation time of each joint, in rows; 1 for white noise.
        notes: what is unusual about the record.
        t: (N,) times of the rows [s]; None: not kept.
        found_with: robot, model and settings behind them, as :func:`found_with` has them; empty: not said.
    """

    rows: FloatArray
    block_rows: int
    correlation_rows: FloatArray
    notes: tuple[str, ...] = ()
    t: FloatArray | None = None
    found_with: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def from_rows(cls, rows: FloatArray, notes: tuple[str, ...] = (), t: FloatArray | None = None) -> ResidualRecord:
        """Choose the block length of a record.

        Args:
            rows: (N, dof), at least 100 of them [Nm or N].
            notes: what is already known of the record.
            t: (N,) times of the rows [s], where they are known.

        Raises:
            InputError: fewer rows, or values that are not finite.
        """
        rows = as_float_array(rows, "residuals", (None, None))
        count = rows.shape[0]
        if count < _MIN_ROWS:
            raise InputError("residuals", f"{count} rows", f"wanted at least {_MIN_ROWS}")
        times = np.array([correlation_time(rows[:, j]) for j in range(rows.shape[1])])
        wanted = math.ceil(_TIMES * float(times.max()))
        block = max(1, min(wanted, count // 10))
        more = [f"Noise is resampled from {count} measured rows in blocks of {block}."]
        if block < wanted:
            more.append(
                f"The residuals are correlated over {times.max():.3g} rows: blocks of {wanted} would be wanted, more "
                "than a tenth of the record. A longer recording would say more."
            )
        return cls(rows, block, times, (*notes, *more), t)

    @classmethod
    def load(cls, path: str | Path, dof: int, period: float) -> ResidualRecord:
        """Read a Parquet file with the columns ``t, residual_1 .. residual_n``.

        Args:
            path: of the file.
            dof: joints of the robot.
            period: feedback period that the rows must have [s].

        Raises:
            InputError: the file cannot be read, columns are missing or unknown, a value is not finite, time runs
                backwards, or the rate is not the feedback rate.
        """
        where = "detector.residuals"
        try:
            t, rows, said = read_residuals(path)
        except InputError as error:
            raise InputError(where, f"{error.field!r} {error.problem}", error.valid) from None
        joints = rows.shape[1]
        if joints < dof:
            problem = f"{str(path)!r} has no column 'residual_{joints + 1}'"
            raise InputError(where, problem, f"wanted t, residual_1 .. residual_{dof}")
        if joints > dof:
            problem = f"{str(path)!r} has a column 'residual_{dof + 1}'"
            raise InputError(where, problem, f"the robot has {dof} joints")
        if rows.shape[0] < _MIN_ROWS:
            raise InputError(where, f"{str(path)!r} has {rows.shape[0]} rows", f"wanted at least {_MIN_ROWS}")
        return replace(cls.from_rows(rows, _check_time(t, period, where, str(path)), t), found_with=said)

    def save(self, path: str | Path) -> None:
        """Write ``t, residual_1 .. residual_n`` as Parquet: a scenario takes it as its noise.

        Raises:
            InputError: the times are not known, or the file cannot be written.
        """
        if self.t is None:
            raise InputError("residuals", "have no times", "only records with times can be written")
        write_residuals(path, self.t, self.rows, self.found_with)


def read_residuals(path: str | Path) -> tuple[FloatArray, FloatArray, dict[str, Any]]:
    """Times (N,) [s], residuals (N, n) [Nm or N] and what they were found with, as far as the file says it.

    The file is Parquet with ``t, residual_1 .. residual_n``.

    Raises:
        InputError: the file cannot be read, columns are missing or hold something else than finite numbers.
    """
    where, wanted = str(path), "wanted a Parquet file with columns t, residual_1 .. residual_n"
    try:
        there = as_path(path, "path").is_file()
    except OSError as error:  # as of a name that is too long for any
        raise InputError(where, f"cannot be read ({error.strerror})", wanted) from None
    if not there:
        raise InputError(where, "is no file", wanted)
    try:
        found, _ = read_guarded("parquet", Path(path))
        numeric = dict(zip(found["names"], found["numeric"], strict=True))
        read = [name for name in numeric if numeric[name] and (name == "t" or name.startswith("residual_"))]
        arrays = read_guarded("parquet", Path(path), columns=read, rows=found["rows"])[1] if read else []
    except InputError as error:
        raise InputError(where, error.problem.replace(" as Parquet", "", 1), wanted) from None
    values = dict(zip(read, arrays, strict=True))
    dof = sum(name.startswith("residual_") for name in numeric)
    names = ["t", *(f"residual_{j + 1}" for j in range(dof))]
    missing = [name for name in names if name not in numeric]
    if dof == 0 or missing:
        raise InputError(where, f"has no column {(missing or ['residual_1'])[0]!r}", wanted)
    columns: list[FloatArray] = []
    for name in names:
        if not numeric[name]:
            raise InputError(where, f"column {name!r} does not hold numbers", wanted)
        column = values[name]
        bad = np.flatnonzero(~np.isfinite(column))
        if bad.size:
            raise InputError(where, f"column {name!r}, row {bad[0] + 1} is not a finite number")
        columns.append(column)
    said = found["said"].get(_FOUND_WITH, "")
    return columns[0], np.stack(columns[1:], axis=1), from_text(said, where) if said else {}


def write_residuals(
    path: str | Path, t: FloatArray, rows: FloatArray, found_with: Mapping[str, Any] | None = None
) -> None:
    """Write ``t, residual_1 .. residual_n`` as Parquet.

    Args:
        path: of the file.
        t: (N,) [s].
        rows: (N, n) [Nm or N].
        found_with: robot, model and settings behind them, for the file's metadata; None: not said.

    Raises:
        InputError: the file cannot be written.
    """
    import polars as pl

    columns = {"t": t} | {f"residual_{j + 1}": rows[:, j] for j in range(rows.shape[1])}
    try:
        write_parquet(path, pl.DataFrame(columns), {_FOUND_WITH: to_text(found_with)} if found_with else None)
    except OSError as error:
        raise InputError(str(path), f"cannot be written ({error.strerror or error})") from None


def _check_time(t: FloatArray, period: float, where: str, path: str) -> tuple[str, ...]:
    steps = np.diff(t)
    backwards = np.flatnonzero(steps <= 0)
    if backwards.size:
        raise InputError(where, f"time does not grow at row {backwards[0] + 2} of {path!r}", "wanted rising t in s")
    typical = float(np.median(steps))
    if abs(typical - period) > 0.01 * period:
        raise InputError(
            where,
            f"{path!r} has a row every {typical:.6g} s",
            f"wanted the feedback period, detector.feedback_period_s = {period:g}",
        )
    uneven = int(np.count_nonzero(np.abs(steps - period) > _UNEVEN * period))
    if uneven > _MAX_UNEVEN_SHARE * steps.size:
        raise InputError(where, f"{uneven} of {steps.size} intervals of {path!r} are uneven", "at most 5 % may be")
    if not uneven:
        return ()
    return (f"{uneven} of {steps.size} intervals of the measured residuals are uneven and taken as even.",)
