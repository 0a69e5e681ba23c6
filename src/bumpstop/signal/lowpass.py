"""A Butterworth filter run forward and backward, also over uneven times."""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop import _native
from bumpstop.arrays import as_number
from bumpstop.errors import InputError
from bumpstop.signal.samples import as_samples

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.arrays import FloatArray

# Intervals that differ by less than this share are one interval: the rounding of printed or absolute times.
_EVEN = 1e-6
# A filter begins as if its first value had stood for ever. What that is wrong by fades to this share of itself before
# the record begins.
_BEGIN_SHARE = 1e-6


def zero_phase_lowpass(t: npt.ArrayLike, x: npt.ArrayLike, cutoff_hz: float, order: int = 4) -> FloatArray:
    """Butterworth low-pass run forward and backward: no delay at any frequency.

    The gain is 1 / (1 + (f / cutoff_hz)^(2 order)), that is 1/2 at the cut-off, up to the warping of the bilinear
    transform near half the sampling rate. White noise of standard deviation 1, sampled at the rate fs, keeps
    sqrt(2 cutoff_hz / fs c), c = (1 - 1/k) (pi/k) / sin(pi/k), k = 2 order: c = 0.898 for order 4.

    The filter needs an even grid. Uneven times are interpolated by a cubic spline onto a grid with their median
    interval, or a little less so that it ends with them, filtered there, and interpolated back to where they were. A
    gap is bridged by the spline.

    Args:
        t: times, (N,), increasing [s].
        x: values, (N, n) [any unit].
        cutoff_hz: above 0, below half the sampling rate [Hz].
        order: of the filter in one direction, 1 to 10.

    Returns:
        (N, n), in the unit of ``x``.

    Raises:
        InputError: a shape, a value or a setting that cannot be used; times that do not increase; a grid of more than
            100 points per sample, as a long gap would need.
    """
    times, grid, filtered, even = _filtered(t, x, "x", cutoff_hz, "cutoff_hz", order)
    if even:
        return filtered
    from scipy.interpolate import CubicSpline

    smooth: FloatArray = np.ascontiguousarray(CubicSpline(grid, filtered)(times))
    return smooth


def filter_even(x: FloatArray, rate_hz: float, cutoff_hz: float, order: int = 4) -> FloatArray:
    """The filter of :func:`zero_phase_lowpass` over values already even in time.

    Args:
        x: (N, ...), filtered along the first axis; at least 16 of them for order 4.
        rate_hz: values a second.
        cutoff_hz: above 0, below half the rate.
        order: of the filter in one direction.

    Returns:
        As ``x``.

    Raises:
        InputError: fewer rows than the filter reaches over.
    """
    flat = np.ascontiguousarray(x, dtype=np.float64).reshape(x.shape[0], -1)
    rows = x.shape[0]
    if rows <= _min_padding(order):
        raise InputError("x", f"has {rows} rows", f"a filter of order {order} needs {_min_padding(order) + 1}")
    padding = min(rows - 1, padding_rows(rate_hz, cutoff_hz, order))
    filtered: FloatArray = _native.zero_phase_lowpass(flat, order, cutoff_hz, rate_hz, padding)
    return filtered.reshape(x.shape)


def filter_reach(rate_hz: float, cutoff_hz: float, share: float, order: int = 4) -> int:
    """Rows beyond which :func:`filter_even` does not carry more than a share of a value.

    So many rows before and after a part of a longer record go through the filter with it and are then cut off: the part
    is that of the whole record, but for ``share`` of what the values change by at its ends. The absolute sum of the
    impulse response beyond that distance, on one side, is ``share``.

    Args:
        rate_hz: values a second.
        cutoff_hz: above 0, below half the rate.
        share: above 0, below 1; not below 1e-12, where rounding begins.
        order: of the filter in one direction.
    """
    # Twice as long each time, until its outer half says nothing: near half the rate a filter rings for long.
    half = int(8 * rate_hz / cutoff_hz) + 4 * _min_padding(order)
    while True:
        impulse = np.zeros((2 * half + 1, 1))
        impulse[half] = 1.0
        response = np.abs(filter_even(impulse, rate_hz, cutoff_hz, order)[half + 1 :, 0])
        beyond = np.cumsum(response[::-1])[::-1]
        if beyond[half // 2] < share:
            return int(np.argmax(beyond < share))
        half *= 2


def padding_rows(rate_hz: float, cutoff_hz: float, order: int = 4) -> int:
    """Rows that :func:`filter_even` puts before and after a record by point reflection, where it has so many.

    A record that begins at speed is not what the filter begins with, a value that has stood for ever. The pole nearest
    to the unit circle, by the bilinear transform, lets that fade by its absolute value every row.

    Args:
        rate_hz: values a second.
        cutoff_hz: above 0, below half the rate.
        order: of the filter in one direction.
    """
    pole = math.tan(math.pi * cutoff_hz / rate_hz) * cmath.exp(0.5j * math.pi * (1 + 1 / order))
    fading = -math.log(abs((1 + pole) / (1 - pole)))
    return max(_min_padding(order), math.ceil(-math.log(_BEGIN_SHARE) / fading))


def _min_padding(order: int) -> int:
    """Rows that are put before and after a record at the least, as scipy's ``sosfiltfilt`` does."""
    return 3 * (2 * ((order + 1) // 2) + 1)


def lowpass_derivatives(
    t: npt.ArrayLike, q: npt.ArrayLike, window_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Filtered values with the cut-off 1 / window_s, and the first two derivatives of the cubic spline through them.

    The spline is through the even grid: a second difference at uneven times errs by the difference of its intervals.
    """
    from scipy.interpolate import CubicSpline

    times, grid, filtered, _ = _filtered(t, q, "q", 1 / window_s, "1 / window_s", 4)
    spline = CubicSpline(grid, filtered)
    position, rate, acceleration = (np.ascontiguousarray(spline(times, order)) for order in range(3))
    return position, rate, acceleration


def _filtered(
    t: npt.ArrayLike, x: npt.ArrayLike, field: str, cutoff_hz: float, cutoff_field: str, order: int
) -> tuple[FloatArray, FloatArray, FloatArray, bool]:
    """The times as given, an even grid with the filtered values on it, and whether the times were such a grid."""
    from scipy.interpolate import CubicSpline

    cutoff = as_number(cutoff_hz, cutoff_field)
    if isinstance(order, bool) or order not in range(1, 11):
        raise InputError("order", f"is {order!r}", "wanted a whole number from 1 to 10")
    padding = _min_padding(order)
    times, rows = as_samples(t, x, field, padding + 1, f"a filter of order {order}")
    steps = np.diff(times)
    span = times[-1] - times[0]
    points = len(times)
    even = steps.max() - steps.min() <= _EVEN * steps.mean()
    if not even:
        wanted = span / float(np.median(steps))
        if wanted > 100 * len(times):
            raise InputError(
                "t", f"needs {wanted:.3g} even intervals", "wanted at most 100 per sample: cut the gaps out"
            )
        points = max(int(np.ceil(wanted * (1 - _EVEN))) + 1, padding + 1)
    rate = (points - 1) / span
    if not 0 < cutoff < rate / 2:
        raise InputError(
            cutoff_field, f"is {cutoff:.6g}", f"wanted above 0 and below half the sampling rate, {rate / 2:.6g}"
        )
    if even:
        return times, times, filter_even(rows, rate, cutoff, order), True
    grid = np.linspace(times[0], times[-1], points)
    return times, grid, filter_even(CubicSpline(times, rows)(grid), rate, cutoff, order), False
