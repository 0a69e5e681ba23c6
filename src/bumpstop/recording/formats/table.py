"""What every reader hands on: numbers in file order with their row numbers, before any check of their values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray

if TYPE_CHECKING:
    import polars as pl

RowNumbers = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Table:
    """A file of named columns whose values are fetched when they are wanted.

    Attributes:
        names: of the columns; empty for a file without a header.
        width: number of columns.
        rows: (N,) number of each readable row in its file.
        filled: (M,) those of all rows that hold anything, unreadable ones, too. The place of a row in here is the place
            of its sample: an empty line is no sample.
        faults: rows that could not be taken apart, with the reason.
        numbered: what the numbers count.
        fetch: columns by index, (N, k) in the file's units; NaN where no number stands.
        joint_names, robot: what the file says of itself.
        notes: what is unusual.
        text_row: the fields of the first row, where all of them are text, as where units stand below the names.
    """

    names: tuple[str, ...]
    width: int
    rows: RowNumbers
    filled: RowNumbers
    numbered: str
    fetch: Callable[[list[int]], FloatArray]
    faults: tuple[tuple[int, str], ...] = ()
    joint_names: tuple[str, ...] = ()
    robot: str = ""
    notes: tuple[str, ...] = ()
    text_row: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class RawRecording:
    """Quantities in SI on the side they were measured, unchecked.

    Attributes:
        values: ``t`` (N, 1), ``position`` and what else was recorded (N, k); NaN where no number stands.
        rows, faults, numbered, joint_names, robot, notes: as in ``Table``.
        rows_read: readable and unreadable ones.
        base_motion, other_joints: as in ``ReadReport``.
        wrench_frame: as ``Quantity.frame``.
    """

    values: dict[str, FloatArray]
    rows: RowNumbers
    rows_read: int
    numbered: str
    faults: tuple[tuple[int, str], ...] = ()
    joint_names: tuple[str, ...] = ()
    robot: str = ""
    notes: tuple[str, ...] = ()
    base_motion: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    other_joints: int = 0
    wrench_frame: str = "tip"


def side_by_side(columns: Sequence[pl.Series]) -> FloatArray:
    """Columns of numbers (N,) as a matrix (N, k), NaN where there is none; each stays in one piece in memory."""
    together = np.empty((len(columns), len(columns[0]) if columns else 0))
    for own, column in zip(together, columns, strict=True):
        own[:] = column.fill_null(np.nan).to_numpy()
    return together.T
