"""Collisions all over a workspace as points: of a study's file, or computed while the page is open."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from bumpstop.arrays import FloatArray

# What points are coloured by, the first that a file has: column and what it is.
_VALUES = (("p99_N", "p99 of the peak force, N"), ("limit_mm_s", "highest safe speed, mm/s"))
# Half of how thick a slice of the workspace is.
SLICE_M = 0.05
_TIP = ("tip_x_m", "tip_y_m", "tip_z_m")
_VELOCITY = ("velocity_x_m_s", "velocity_y_m_s", "velocity_z_m_s")
_DIRECTION = ("direction_x", "direction_y", "direction_z")


@dataclass(frozen=True, eq=False)
class PointRows:
    """Rows of a workspace.

    Attributes:
        place: (N, 3) of the tip [m].
        q: (N, dof) [rad or m].
        velocity: (N, 3) of the tip [m/s]; NaN where a row has none.
        direction: (N, 3) unit vectors along which a row's limit holds; NaN of other rows.
        value: (N,) by which a point is coloured.
        label: what the value is, with its unit.
        number: (N,) of the row in the file, from 0.
        otherwise: in what they were computed otherwise than the scenario on screen is; empty: in nothing.
    """

    place: FloatArray
    q: FloatArray
    velocity: FloatArray
    direction: FloatArray
    value: FloatArray
    label: str
    number: npt.NDArray[np.int64]
    otherwise: str = ""

    def slice(self, axis: int, at: float) -> PointRows:
        """The rows within :data:`SLICE_M` of a plane.

        Args:
            axis: across the plane: 0, 1 or 2 of the base frame.
            at: where the plane stands on it [m].
        """
        near = np.abs(self.place[:, axis] - at) <= SLICE_M
        return PointRows(
            self.place[near],
            self.q[near],
            self.velocity[near],
            self.direction[near],
            self.value[near],
            self.label,
            self.number[near],
            self.otherwise,
        )

    def velocity_on_screen(self, row: int, speed: float) -> FloatArray | None:
        """The velocity (3,) [m/s] that belongs to a row; None where it has none.

        Args:
            row: of the points.
            speed: that a row gets along its direction where no speed is safe [m/s].
        """
        velocity = self.direction[row] * speed if self.none_safe(row) else self.velocity[row]
        return np.asarray(velocity) if np.isfinite(velocity).all() and velocity.any() else None

    def none_safe(self, row: int) -> bool:
        """The limit of a row is 0: no speed is safe there."""
        return bool(self.value[row] == 0 and np.isfinite(self.direction[row]).all())

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


def point_rows(rows: Mapping[str, np.ndarray], dof: int, file: str) -> PointRows:
    """The points of a study's rows.

    Args:
        rows: columns (N,) with ``q_1`` and so on, ``tip_x_m`` and so on, and ``p99_N`` or ``limit_mm_s``.
        dof: joints of the arm.
        file: named in refusals.

    Raises:
        InputError: a column is missing.
    """
    named = next(((column, label) for column, label in _VALUES if column in rows), None)
    joints = [f"q_{j + 1}" for j in range(dof)]
    missing = [column for column in (*joints, *_TIP) if column not in rows]
    if named is None or missing:
        lacks = missing[0] if missing else " or ".join(column for column, _ in _VALUES)
        raise InputError(file, f"has no column {lacks}", "wanted rows.parquet of a workspace study or of speed limits")
    if f"q_{dof + 1}" in rows:
        raise InputError(file, f"has more joints than the robot, which has {dof}")
    return PointRows(
        _side_by_side(rows, _TIP),
        _side_by_side(rows, joints),
        _velocity(rows),
        _side_by_side(rows, _DIRECTION) if set(_DIRECTION) <= set(rows) else np.full((len(rows[_TIP[0]]), 3), np.nan),
        rows[named[0]].astype(np.float64),
        named[1],
        np.arange(len(rows[named[0]])),
    )


def _velocity(rows: Mapping[str, np.ndarray]) -> FloatArray:
    if set(_VELOCITY) <= set(rows):
        return _side_by_side(rows, _VELOCITY)
    if set(_DIRECTION) <= set(rows):
        speed = rows["limit_mm_s"] / 1e3
        return np.asarray(_side_by_side(rows, _DIRECTION) * np.where(speed > 0, speed, np.nan)[:, None])
    return np.full((len(rows[_TIP[0]]), 3), np.nan)


def _side_by_side(rows: Mapping[str, np.ndarray], names: Sequence[str]) -> FloatArray:
    return np.column_stack([rows[name] for name in names])


def read_rows(file: Path) -> dict[str, np.ndarray]:
    """The columns of a study's Parquet file that :func:`point_rows` knows (N,): lists of probabilities stay in it.

    Raises:
        InputError: it cannot be read.
    """
    import polars as pl

    known = {*_TIP, *_VELOCITY, *_DIRECTION, *(column for column, _ in _VALUES)}
    try:
        with file.open("rb") as content:
            names = [name for name in pl.read_parquet_schema(content) if name in known or name.startswith("q_")]
        with file.open("rb") as content:
            return {column.name: column.to_numpy() for column in pl.read_parquet(content, columns=names)}
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InputError(str(file), f"cannot be read ({str(error).splitlines()[0]})", "wanted rows.parquet") from None
