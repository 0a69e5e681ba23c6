"""A recording's motion on an even grid: positions, velocities and accelerations without the sensor's noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.signal import filter_even

# A time this near to that of a grid, as a share of its step, is its own.
_EVEN = 1e-3
GRAVITY = (0.0, 0.0, -9.80665)  # acceleration of free fall in the frame of an upright base [m/s2]


@dataclass(frozen=True, eq=False)
class EvenMotion:
    """A motion at an even rate.

    Attributes:
        t: (N,) [s].
        q, qd, qdd: (N, n), of one zero-phase filter [rad or m, and per second].
        rate_hz: samples a second.
    """

    t: FloatArray
    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    rate_hz: float

    def part(self, rows: slice) -> EvenMotion:
        """Some rows of it, one after the other."""
        return EvenMotion(self.t[rows], self.q[rows], self.qd[rows], self.qdd[rows], self.rate_hz)


def even_grid(t: FloatArray) -> tuple[FloatArray, float]:
    """Times at the median rate of ``t`` over the same span, and that rate [Hz]."""
    step = float(np.median(np.diff(t)))
    return np.arange(t[0], t[-1] + 0.5 * step, step), 1 / step


def onto(grid: FloatArray, t: FloatArray, x: FloatArray) -> FloatArray:
    """Columns of ``x`` (N, n) at the times of a grid, straight between samples; ``x`` itself at its own times."""
    if grid.size == t.size and float(np.abs(grid - t).max()) < _EVEN * (t[-1] - t[0]) / t.size:
        return x
    return np.stack([np.interp(grid, t, x[:, j]) for j in range(x.shape[1])], axis=1)


def lowpass(x: FloatArray, rate_hz: float, cutoff_hz: float) -> FloatArray:
    """Zero-phase fourth-order filter; a cut-off at or above half the rate leaves ``x`` (N, ...) as it is."""
    return x if cutoff_hz >= 0.499 * rate_hz else filter_even(x, rate_hz, cutoff_hz)


# What is filtered at a cut-off is kept at this many times its rate.
_RATE_PER_CUTOFF = 10.0


def _stride(rate_hz: float, cutoff_hz: float) -> int:
    """Of how many rows one is kept. A rate that is a whole multiple but for rounding of its times counts as one."""
    return max(1, int(rate_hz / (_RATE_PER_CUTOFF * cutoff_hz) * (1 + 1e-6)))


def kept_rate(t: FloatArray, cutoff_hz: float) -> float:
    """Rows a second that :func:`even_motion` keeps of a motion recorded at ``t`` (N,)."""
    rate = 1 / float(np.median(np.diff(t)))
    return rate / _stride(rate, cutoff_hz)


def even_motion(t: FloatArray, q: FloatArray, qd: FloatArray | None, cutoff_hz: float) -> EvenMotion:
    """Filter a recorded motion, differentiate it, and keep as many rows as the filter leaves something to say.

    Args:
        t: (N,) rising times [s]; may be uneven.
        q: (N, n) [rad or m].
        qd: (N, n) measured velocities, or None: then they are the positions' central differences.
        cutoff_hz: of the zero-phase filter.
    """
    if t.size < 50:
        raise InputError("recording", f"{t.size} rows", "wanted at least 50")
    grid, rate = even_grid(t)
    position = lowpass(onto(grid, t, q), rate, cutoff_hz)
    measured = None if qd is None else lowpass(onto(grid, t, qd), rate, cutoff_hz)
    velocity = np.gradient(position, 1 / rate, axis=0) if measured is None else measured
    acceleration = np.gradient(velocity, 1 / rate, axis=0)
    stride = _stride(rate, cutoff_hz)
    kept = [np.ascontiguousarray(x[::stride]) for x in (grid, position, velocity, acceleration)]
    return EvenMotion(kept[0], kept[1], kept[2], kept[3], rate / stride)
