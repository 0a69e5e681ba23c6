"""Residual files: Parquet with ``t, residual_1 .. residual_n``."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.detection.settings import DetectorSettings
from bumpstop.detection.tuning.residual_record import read_residuals, write_residuals
from bumpstop.errors import InputError
from bumpstop.text_files import shown

# An interval longer than this many typical ones is a gap: nothing is known of what happened in it. Lost samples within
# shorter ones part nothing, as those that the detector bridges.
_GAP = DetectorSettings.longest_periods


@dataclass(frozen=True, eq=False)
class ResidualSeries:
    """Residuals over time, as they were recorded.

    Attributes:
        t: (N,) rising [s].
        rows: (N, dof) residual, estimated minus predicted motor torque [Nm or N].
        source: the file, or what else it came from.
        qd, qdd: (N, dof) speeds and accelerations of the joints as the detector takes them, or their sizes [rad/s,
            rad/s2 or m/s, m/s2]; None: not known. A file does not hold them.
        found_with: robot, model and settings behind them, as :func:`found_with` has them; empty: not said.
    """

    t: FloatArray
    rows: FloatArray
    source: str = "residuals"
    qd: FloatArray | None = None
    qdd: FloatArray | None = None
    found_with: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        t = as_float_array(self.t, "t", (None,))
        rows = as_float_array(self.rows, "residuals", (t.size, None))
        for name in ("qd", "qdd"):
            if (values := getattr(self, name)) is not None:
                object.__setattr__(self, name, as_float_array(values, name, rows.shape))
        if t.size < 2:
            raise InputError(self.source, f"{t.size} rows", "wanted at least 2")
        backwards = np.flatnonzero(np.diff(t) <= 0)
        if backwards.size:
            raise InputError(self.source, f"time does not grow at row {backwards[0] + 2}", "wanted rising t in s")
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "rows", rows)

    @property
    def dof(self) -> int:
        """Number of joints."""
        return int(self.rows.shape[1])

    @property
    def period(self) -> float:
        """Median interval [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def monitored_s(self) -> float:
        """Time in which there are residuals: a period for each row, so that gaps do not count [s]."""
        return self.t.size * self.period

    def segments(self) -> list[slice]:
        """Rows between gaps: where an interval is longer than five typical ones, a new segment begins."""
        cuts = np.flatnonzero(np.diff(self.t) > _GAP * self.period) + 1
        edges = [0, *(int(cut) for cut in cuts), self.t.size]
        return [slice(a, b) for a, b in itertools.pairwise(edges)]

    def between(self, start_s: float, end_s: float) -> ResidualSeries:
        """Rows with start_s <= t < end_s; times stay as they are."""
        first, last = np.searchsorted(self.t, [start_s, end_s])
        return self.only(slice(first, last))

    def only(self, rows: slice) -> ResidualSeries:
        """Some of its rows; times stay as they are."""
        qd, qdd = (None if values is None else values[rows] for values in (self.qd, self.qdd))
        return replace(self, t=self.t[rows], rows=self.rows[rows], qd=qd, qdd=qdd)

    @classmethod
    def load(cls, path: str | Path) -> ResidualSeries:
        """Read a file; joints are as many as it has columns ``residual_*``.

        Raises:
            InputError: the file cannot be read, columns are missing, a value is not finite, or time runs backwards.
        """
        t, rows, found = read_residuals(path)
        return cls(t, rows, shown(path), found_with=found)

    def save(self, path: str | Path) -> None:
        """Write the file that :meth:`load`, ``bumpstop tune`` and the scenario key ``detector.residuals`` read.

        Raises:
            InputError: the file cannot be written.
        """
        write_residuals(path, self.t, self.rows, self.found_with)
