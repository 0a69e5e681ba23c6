"""A recording's motion on an even grid: positions, velocities and accelerations without the sensor's noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.signal import filter_even, filter_reach

# A time this near to that of a grid, as a share of its step, is its own.
_EVEN = 1e-3

# What is filtered at a cut-off is kept at this many times its rate.
_RATE_PER_CUTOFF = 10.0
# What lies beyond the margins of a part of a recording would change it by this share of its range: far below the noise
# of any sensor. A share of 1e-9 would make margins half as wide again.
REACH_SHARE = 1e-6
_MAX_ROWS = 100  # of a grid, for a sample of the recording
MIN_ROWS = 50  # of a motion
_SLOPE_ROWS = 2  # that two differences one after the other reach to either side


@dataclass(frozen=True, eq=False)
class UniformMotion:
    """A motion at an even rate.

    Attributes:
        t: (N,) [s].
        q, qd, qdd: (N, n), of one zero-phase filter [rad or m, and per second].
        rate_hz: samples a second.
        gravity: acceleration of free fall in the base frame [m/s2].
    """

    t: FloatArray
    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    rate_hz: float
    gravity: tuple[float, float, float] = STANDARD_GRAVITY

    def part(self, rows: slice | np.ndarray) -> UniformMotion:
        """Some rows of it."""
        return UniformMotion(self.t[rows], self.q[rows], self.qd[rows], self.qdd[rows], self.rate_hz, self.gravity)


def lowpass(x: FloatArray, rate_hz: float, cutoff_hz: float) -> FloatArray:
    """Zero-phase fourth-order filter; a cut-off at or above half the rate leaves ``x`` (N, ...) as it is."""
    return filter_even(x, rate_hz, cutoff_hz) if _filters(rate_hz, cutoff_hz) else x


@lru_cache(maxsize=256)
def lowpass_reach(rate_hz: float, cutoff_hz: float) -> int:
    """Rows to either side that :func:`lowpass` takes a value from, but for ``REACH_SHARE`` of it."""
    return filter_reach(rate_hz, cutoff_hz, REACH_SHARE) if _filters(rate_hz, cutoff_hz) else 0


def _filters(rate_hz: float, cutoff_hz: float) -> bool:
    return cutoff_hz < 0.499 * rate_hz


@dataclass(frozen=True, eq=False)
class UniformGrid:
    """Times at the median rate of a recording over its span.

    Attributes:
        recorded: (N,) rising times of the recording [s]; may be uneven.
        t: (M,) even times [s].
        rate_hz: of them a second.
        even: the recorded times are those of the grid, but for the rounding of clocks.
    """

    recorded: FloatArray
    t: FloatArray
    rate_hz: float
    even: bool

    @classmethod
    def of(cls, t: FloatArray) -> UniformGrid:
        """The grid of recorded times (N,).

        Raises:
            InputError: more rows than memory should be spent on, as a long gap would need.
        """
        step = float(np.median(np.diff(t)))
        wanted = (t[-1] - t[0]) / step
        if wanted > _MAX_ROWS * t.size:
            raise InputError(
                "recording", f"needs {wanted:.3g} even rows", f"wanted at most {_MAX_ROWS} a sample: cut the gaps out"
            )
        grid = np.arange(t[0], t[-1] + 0.5 * step, step)
        return cls(t, grid, 1 / step, grid.size == t.size and float(np.abs(grid - t).max()) < _EVEN * step)

    def stride(self, cutoff_hz: float) -> int:
        """Of how many rows one is kept behind a filter.

        A rate that is a whole multiple but for rounding of its times counts as one.
        """
        return max(1, int(self.rate_hz / (_RATE_PER_CUTOFF * cutoff_hz) * (1 + 1e-6)))

    def columns(self, x: FloatArray, rows: slice = slice(None)) -> FloatArray:
        """Columns of ``x`` (N, n) at some times of the grid, straight between samples; its own where it is even."""
        if self.even:
            return x[rows]
        t = self.t[rows]
        # The samples about these: of a long recording the others need not be looked at.
        near = slice(
            max(0, int(np.searchsorted(self.recorded, t[0], "right")) - 1),
            int(np.searchsorted(self.recorded, t[-1])) + 1,
        )
        return np.stack([np.interp(t, self.recorded[near], x[near, j]) for j in range(x.shape[1])], axis=1)

    def motion(
        self,
        q: FloatArray,
        qd: FloatArray | None,
        cutoff_hz: float,
        kept: slice | None = None,
        stride: int | None = None,
    ) -> UniformMotion:
        """Filter a recorded motion, differentiate it, and keep as many rows as the filter leaves something to say.

        Args:
            q: (N, n) [rad or m].
            qd: (N, n) measured velocities, or None: then they are the positions' central differences.
            cutoff_hz: of the zero-phase filter.
            kept: of the rows that are kept these alone, as they are in the whole; default: all.
            stride: of how many rows one is kept; default: by the cut-off.
        """
        rate, stride = self.rate_hz, stride or self.stride(cutoff_hz)
        first, last = (0, self.t.size) if kept is None else (kept.start * stride, (kept.stop - 1) * stride + 1)
        # The whole has no margins.
        margin = 0 if kept is None else lowpass_reach(rate, cutoff_hz) + _SLOPE_ROWS
        around = slice(max(0, first - margin), min(self.t.size, last + margin))
        position = lowpass(self.columns(q, around), rate, cutoff_hz)
        measured = None if qd is None else lowpass(self.columns(qd, around), rate, cutoff_hz)
        velocity = np.gradient(position, 1 / rate, axis=0) if measured is None else measured
        acceleration = np.gradient(velocity, 1 / rate, axis=0)
        own = slice(first - around.start, last - around.start, stride)
        kept_columns = [np.ascontiguousarray(x[own]) for x in (self.t[around], position, velocity, acceleration)]
        return UniformMotion(kept_columns[0], kept_columns[1], kept_columns[2], kept_columns[3], rate / stride)


def interpolate_to(grid: FloatArray, t: FloatArray, x: FloatArray) -> FloatArray:
    """Columns of ``x`` (N, n) at the times of a grid, straight between samples; ``x`` itself at its own times."""
    if grid.size == t.size and float(np.abs(grid - t).max()) < _EVEN * (t[-1] - t[0]) / t.size:
        return x
    return np.stack([np.interp(grid, t, x[:, j]) for j in range(x.shape[1])], axis=1)


def resample(t: FloatArray, q: FloatArray, qd: FloatArray | None, cutoff_hz: float) -> UniformMotion:
    """The motion of a whole recording at times ``t`` (N,); other arguments as for :meth:`UniformGrid.motion`.

    Raises:
        InputError: fewer than ``MIN_ROWS`` rows, or gaps too long to be bridged.
    """
    if t.size < MIN_ROWS:
        raise InputError("recording", f"{t.size} rows", f"wanted at least {MIN_ROWS}")
    return UniformGrid.of(t).motion(q, qd, cutoff_hz)
