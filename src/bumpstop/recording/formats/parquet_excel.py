"""Parquet and Excel files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.recording.formats.csv import are_numbers
from bumpstop.recording.formats.table import Table, side_by_side

if TYPE_CHECKING:
    import polars as pl


def read_parquet(path: Path) -> Table:
    """Open a Parquet file; its metadata may hold ``joint_names`` (a JSON list) and ``robot``."""
    import polars as pl

    try:
        # A bracket in the name of a file is no pattern.
        table = pl.scan_parquet(path, glob=False)
        names = list(table.collect_schema())
        said = pl.read_parquet_metadata(path)
        rows = int(table.select(pl.len()).collect().item())
    except Exception as error:  # polars raises many kinds for a damaged file
        raise _damaged(path, "Parquet", error) from None

    def fetch(wanted: list[int]) -> FloatArray:
        try:
            table = pl.read_parquet(path, columns=sorted({names[i] for i in wanted}), glob=False)
        except Exception as error:
            raise _damaged(path, "Parquet", error) from None
        return _numbers(table, [names[i] for i in wanted])

    return Table(
        names=tuple(names),
        width=len(names),
        rows=np.arange(1, rows + 1),
        first_row=1,
        rows_read=rows,
        numbered="row",
        fetch=fetch,
        joint_names=_names(said.get("joint_names", "")),
        robot=str(said.get("robot", "")),
    )


def read_excel(path: Path, header: bool | None) -> Table:
    """Open the first sheet of an Excel file; ``header`` as in a text file.

    Raises:
        InputError: damaged, or the package that reads Excel files is not there.
    """
    import polars as pl

    def read(named: bool) -> pl.DataFrame:
        return pl.read_excel(path.read_bytes(), engine="calamine", has_header=named, infer_schema_length=None)

    named = header is not False
    try:
        table = read(named)
        # A number that stands twice in the first row comes as a name with this ending.
        if header is None and are_numbers([name.partition("_duplicated_")[0] for name in table.columns]):
            named, table = False, read(False)
    except ModuleNotFoundError:
        raise InputError(str(path), "Excel files need the package fastexcel", "pip install fastexcel") from None
    except Exception as error:  # of polars or of calamine
        raise _damaged(path, "Excel", error) from None
    first = 2 if named else 1
    return Table(
        names=tuple(table.columns) if named else (),
        width=table.width,
        rows=np.arange(first, first + table.height),
        first_row=first,
        rows_read=table.height,
        numbered="row",
        fetch=lambda wanted: _numbers(table, [table.columns[i] for i in wanted]),
    )


def _numbers(table: pl.DataFrame, names: list[str]) -> FloatArray:
    import polars as pl

    columns: list[Any] = []
    for name in names:
        column = table[name]
        if column.dtype == pl.String:
            column = column.str.strip_chars()
        elif not (column.dtype.is_numeric() or column.dtype == pl.Null):
            raise InputError(f"column {name!r}", f"holds {column.dtype}, not numbers", "wanted numbers")
        columns.append(column.cast(pl.Float64, strict=False))
    return side_by_side(columns)


def _names(text: str) -> tuple[str, ...]:
    try:
        names = json.loads(text)
    except ValueError:  # another program's list of names
        return tuple(name.strip() for name in text.split(",") if name.strip())
    return tuple(str(name) for name in names) if isinstance(names, list) else ()


def _damaged(path: Path, kind: str, error: Exception) -> InputError:
    reason = (str(error).splitlines() or [type(error).__name__])[0][:120]
    return InputError(str(path), f"cannot be read as {kind} ({reason})", "the file may be damaged or cut short")
