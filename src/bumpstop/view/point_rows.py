"""Collisions all over a workspace as points: of a study's file, or computed while the page is open."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bumpstop.errors import InputError

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.arrays import FloatArray

# What points are coloured by, the first that a file has: column and what it is.
_VALUES = (("p99_N", "p99 of the peak force, N"), ("limit_mm_s", "highest safe speed, mm/s"))
# Half of how thick a slice of the workspace is.
SLICE_M = 0.05
_TIP = ("tip_x_m", "tip_y_m", "tip_z_m")


@dataclass(frozen=True, eq=False)
class PointRows:
    """Rows of a workspace.

    Attributes:
        place: (N, 3) of the tip [m].
        q: (N, dof) [rad or m].
        velocity: (N, 3) of the tip [m/s]; NaN where a row has none.
        value: (N,) by which a point is coloured.
        label: what the value is, with its unit.
        number: (N,) of the row in the file, from 0.
    """

    place: FloatArray
    q: FloatArray
    velocity: FloatArray
    value: FloatArray
    label: str
    number: npt.NDArray[np.int64]

    def slice(self, axis: int, at: float) -> PointRows:
        """The rows within :data:`SLICE_M` of a plane.

        Args:
            axis: across the plane: 0, 1 or 2 of the base frame.
            at: where the plane stands on it [m].
        """
        near = np.abs(self.place[:, axis] - at) <= SLICE_M
        return PointRows(
            self.place[near], self.q[near], self.velocity[near], self.value[near], self.label, self.number[near]
        )

    def nearest(self, origin: FloatArray, direction: FloatArray, near: float) -> int | None:
        """The row whose point a ray meets first; None where it passes none.

        Args:
            origin: of the ray (3,) [m].
            direction: of the ray (3,).
            near: how close the ray must pass, as a share of the distance from its origin.
        """
        along = np.asarray(direction) / np.linalg.norm(direction)
        away = self.place - np.asarray(origin)
        far = away @ along
        aside = np.linalg.norm(away - far[:, None] * along, axis=1)
        met = np.flatnonzero((far > 0) & (aside <= near * far))
        # Of points in one direction the one that hides the others, unless the ray passes another more closely.
        return int(met[np.argmin(aside[met] / far[met] + 0.02 * far[met] / far[met].max())]) if met.size else None


def point_rows(rows: pl.DataFrame, dof: int, file: str) -> PointRows:
    """The points of a study's rows.

    Args:
        rows: with ``q_1`` and so on, ``tip_x_m`` and so on, and ``p99_N`` or ``limit_mm_s``.
        dof: joints of the arm.
        file: named in refusals.

    Raises:
        InputError: a column is missing.
    """
    named = next(((column, label) for column, label in _VALUES if column in rows.columns), None)
    joints = [f"q_{j + 1}" for j in range(dof)]
    missing = [column for column in (*joints, *_TIP) if column not in rows.columns]
    if named is None or missing:
        lacks = missing[0] if missing else " or ".join(column for column, _ in _VALUES)
        raise InputError(file, f"has no column {lacks}", "wanted rows.parquet of a workspace study or of speed limits")
    if f"q_{dof + 1}" in rows.columns:
        raise InputError(file, f"has more joints than the robot, which has {dof}")
    return PointRows(
        rows.select(_TIP).to_numpy(),
        rows.select(joints).to_numpy(),
        _velocity(rows),
        rows[named[0]].to_numpy().astype(np.float64),
        named[1],
        np.arange(rows.height),
    )


def _velocity(rows: pl.DataFrame) -> FloatArray:
    columns = [f"velocity_{axis}_m_s" for axis in "xyz"]
    if set(columns) <= set(rows.columns):
        return rows.select(columns).to_numpy()
    directions = [f"direction_{axis}" for axis in "xyz"]
    if set(directions) <= set(rows.columns):
        speed = rows["limit_mm_s"].to_numpy() / 1e3
        return np.asarray(rows.select(directions).to_numpy() * np.where(speed > 0, speed, np.nan)[:, None])
    return np.full((rows.height, 3), np.nan)


def read_rows(file: Path) -> Any:
    """The rows of a study's Parquet file.

    Raises:
        InputError: it cannot be read.
    """
    import polars as pl

    try:
        return pl.read_parquet(file, glob=False)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InputError(str(file), f"cannot be read ({str(error).splitlines()[0]})", "wanted rows.parquet") from None
