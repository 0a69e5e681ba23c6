"""MATLAB files: matrices by their dotted names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError, near_matches
from bumpstop.recording.column_draft import MissingColumnsError, as_list, by_length, draft_of_variables
from bumpstop.recording.columns import Columns, Quantity
from bumpstop.recording.formats.reader_process import read_guarded
from bumpstop.recording.formats.table import RawRecording


def read_matlab(path: Path, columns: Columns) -> RawRecording:
    """Read the variables a column file names.

    Args:
        path: of a file of MATLAB 5 to 7.2.
        columns: with ``time`` and ``position`` by ``variable``; time may be a rate instead.

    Raises:
        InputError: damaged, a variable that is not there, or lengths that do not fit.
    """
    variables = _variables(path)
    if "position" not in columns.quantities:
        shapes = {name: np.shape(value) for name, value in variables.items() if value is not None}
        problem = f"needs a column file; its variables are {as_list(by_length(shapes)) or 'none'}"
        example = 'say with --columns FILE.toml, for example position = { variable = "rec.q", unit = "rad" }'
        raise MissingColumnsError(str(path), problem, example, draft_of_variables(shapes))
    position = columns.quantities["position"]
    time = columns.quantities.get("time", Quantity())
    if time.rate_hz is None and not time.variable:
        raise InputError("columns.time", "names no variable", "wanted variable = ..., or rate_hz = ...")
    if time.rate_hz is None:
        t = _times(_matrix(variables, time, "time"), time) * time.scale[0]
    else:
        # No time to compare with: the longer axis is the one along which the arm moves.
        shape = _matrix(variables, position, "position").shape
        count = max(shape) if not position.axis else shape[1 if position.axis == "rows" else 0]
        t = np.arange(count) / time.rate_hz
    values = {"t": t[:, None]}
    for name, quantity in columns.quantities.items():
        if name != "time":
            values[name] = _by_row(_matrix(variables, quantity, name), quantity, name, t.size)
            if quantity.columns:
                values[name] = _chosen(values[name], quantity, f"columns.{name}.columns")
            values[name] = quantity.in_si(values[name], name)
    return RawRecording(
        values=values,
        rows=np.arange(1, t.size + 1),
        rows_read=int(t.size),
        numbered="row",
        wrench_frame=columns.quantities.get("wrench", Quantity()).frame,
    )


def _times(matrix: FloatArray, time: Quantity) -> FloatArray:
    """(N,) a row, a column, or one of a matrix."""
    if time.columns:
        rows = matrix.T if time.axis == "rows" else matrix
        return _chosen(rows, time, "columns.time.column")[:, 0]
    if min(matrix.shape) > 1:
        problem = f"{time.variable!r} is {' x '.join(map(str, matrix.shape))}"
        raise InputError("columns.time.variable", problem, "wanted one row or column, or column = ...")
    return matrix.reshape(-1)


def _by_row(matrix: FloatArray, quantity: Quantity, name: str, count: int) -> FloatArray:
    if not quantity.axis and count > 1 and matrix.shape == (count, count):
        problem = f"{quantity.variable!r} is {count} x {count}: it does not show whether joints are rows or columns"
        raise InputError(f"columns.{name}.axis", problem, 'give axis = "rows" or "columns"')
    axis = quantity.axis or ("rows" if matrix.shape[0] != count and matrix.shape[1] == count else "columns")
    rows = matrix.T if axis == "rows" else matrix
    if rows.shape[0] != count:
        shape = " x ".join(map(str, matrix.shape))
        raise InputError(f"columns.{name}", f"{quantity.variable!r} is {shape}, and there are {count} times")
    return rows


def _chosen(rows: FloatArray, quantity: Quantity, where: str) -> FloatArray:
    for column in quantity.columns:
        if not isinstance(column, int) or column > rows.shape[1]:
            raise InputError(where, f"{column!r} is no column of {quantity.variable!r}", f"1 to {rows.shape[1]}")
    return rows[:, [int(column) - 1 for column in quantity.columns]]


def _variables(path: Path) -> dict[str, Any]:
    """Matrices of numbers by their dotted names; None for every other variable."""
    found, arrays = read_guarded("matlab", path)
    numeric = dict(zip(found["numeric"], arrays, strict=True))
    return {name: numeric.get(name) for name in found["names"]}


def _matrix(variables: dict[str, Any], quantity: Quantity, name: str) -> FloatArray:
    where = f"columns.{name}.variable"
    if not quantity.variable:
        raise InputError(where, "is missing", "wanted the dotted name of a matrix")
    if quantity.variable not in variables:
        raise InputError(where, f"there is no {quantity.variable!r}", near_matches(quantity.variable, variables))
    matrix = np.asarray(variables[quantity.variable])
    if matrix.dtype.kind not in "fiu" or matrix.ndim not in (1, 2):
        raise InputError(where, f"{quantity.variable!r} is no matrix of real numbers")
    numbers: FloatArray = matrix.astype(np.float64)
    return numbers[:, None] if numbers.ndim == 1 else numbers
