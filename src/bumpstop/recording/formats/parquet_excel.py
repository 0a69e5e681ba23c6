"""Parquet and Excel files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.recording.formats.reader_process import read_guarded
from bumpstop.recording.formats.table import Table


def read_parquet(path: Path) -> Table:
    """Open a Parquet file; its metadata may hold ``joint_names`` (a JSON list) and ``robot``.

    Raises:
        InputError: damaged.
    """
    found, _ = read_guarded("parquet", path)
    names, rows, said = found["names"], found["rows"], found["said"]

    def fetch(wanted: list[int]) -> FloatArray:
        if not wanted:
            return np.empty((rows, 0))
        _, columns = read_guarded("parquet", path, columns=[names[i] for i in wanted], rows=rows)
        return np.stack(columns).T

    return Table(
        names=tuple(names),
        width=len(names),
        rows=np.arange(1, rows + 1),
        filled=np.arange(1, rows + 1),
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
    found, columns = read_guarded("excel", path, header=header)
    names, rows = found["names"], columns[-1]

    def fetch(wanted: list[int]) -> FloatArray:
        for i in wanted:
            if found["problems"][i]:
                raise InputError(f"column {names[i]!r}", found["problems"][i], "wanted numbers")
        return np.stack([columns[i] for i in wanted]).T if wanted else np.empty((rows.size, 0))

    return Table(
        names=tuple(names) if found["named"] else (),
        width=len(names),
        rows=rows,
        filled=rows,
        numbered="row",
        fetch=fetch,
        text_row=tuple(found["text_row"]),
    )


def _names(text: str) -> tuple[str, ...]:
    try:
        names = json.loads(text)
    except (ValueError, RecursionError):  # another program's list of names
        return tuple(name.strip() for name in text.split(",") if name.strip())
    return tuple(str(name) for name in names) if isinstance(names, list) else ()
