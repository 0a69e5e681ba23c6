"""Rates and accelerations by differences, by local polynomials on both sides, and by those of the past alone.

Times ``t`` have the shape (N,) and increase [s]; positions ``q`` have the shape (N, n), a column for each joint [rad,
or m]. The delay and the noise gain of each are in ``docs/reference/robot/signal.md``. Noise gain is the standard
deviation of the result for noise of standard deviation 1 in ``q``, independent from sample to sample.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from bumpstop import _native
from bumpstop.arrays import as_number
from bumpstop.errors import InputError, near_matches
from bumpstop.signal.lowpass import lowpass_derivatives
from bumpstop.signal.samples import as_samples

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.arrays import FloatArray

DerivativeMethod = Literal["local_polynomial", "butterworth", "differences"]


def derivatives(
    t: npt.ArrayLike,
    q: npt.ArrayLike,
    *,
    method: DerivativeMethod = "local_polynomial",
    window_s: float = 0.04,
    degree: int = 3,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Smoothed positions, rates and accelerations without delay, from samples on both sides.

    ``local_polynomial`` fits a polynomial about every time t_i to the samples with abs(t - t_i) < h = window_s / 2, at
    their true times, by least squares with the weights 1 - ((t - t_i) / h)^2. It is exact for polynomials of
    ``degree``. Within window_s / 2 of an end h grows to window_s; where samples are sparse or lost, until degree + 1 on
    either side lie within 0.8 h. ``butterworth`` is ``zero_phase_lowpass`` of order 4 with the cut-off
    1 / window_s, and the derivatives of the cubic spline through it. ``differences`` is :func:`differences` and does
    not smooth.

    Args:
        t: times, (N,), increasing [s].
        q: positions, (N, n) [rad].
        method: one of the three.
        window_s: width of the window, above 0 [s].
        degree: of the local polynomial, 2 to 5; the other methods have none.

    Returns:
        q_smooth [rad], qd [rad/s] and qdd [rad/s2], each (N, n).

    Raises:
        InputError: a shape, a value or a setting that cannot be used; times that do not increase.
    """
    if method not in get_args(DerivativeMethod):
        raise InputError("method", f"{method!r} is no method", near_matches(str(method), get_args(DerivativeMethod)))
    window = as_number(window_s, "window_s")
    if window <= 0:
        raise InputError("window_s", f"is {window_s}", "wanted a width above 0")
    if method == "differences":
        times, rows = as_samples(t, q, "q", 3, "a second difference")
        return rows, *differences(times, rows)
    if method == "butterworth":
        return lowpass_derivatives(t, q, window)
    order = _whole(degree, "degree", 2, _native.max_fit_degree)
    times, rows = as_samples(t, q, "q", order + 1, f"a polynomial of degree {order}")
    position, rate, acceleration = _native.local_polynomial(times, rows, window, order)
    return position, rate, acceleration


def causal_derivatives(
    t: npt.ArrayLike, q: npt.ArrayLike, *, window: int = 8, degree: int = 2
) -> tuple[FloatArray, FloatArray]:
    """Rates and accelerations from the samples up to each row, as a control loop has them.

    A polynomial fitted to the last ``window`` samples at their true times by least squares is differentiated at the
    newest. It is exact for polynomials of ``degree``. Rows before the window is full are zero. This runs the C++ class
    ``CausalDerivative`` over the rows.

    At even intervals dt and with degree 2 the acceleration is that of (window - 1) / 2 dt ago, and the rate of a slow
    motion has no delay. With m = ``window`` the noise gain of the acceleration is
    sqrt(720 / (m (m^2 - 1) (m^2 - 4))) / dt^2, that of the rate
    sqrt(12 / (m (m^2 - 1)) + 180 (m - 1)^2 / (m (m^2 - 1) (m^2 - 4))) / dt.

    Args:
        t: times, (N,), increasing [s].
        q: positions, (N, n) [rad].
        window: samples in the fit, above ``degree``, at most 512.
        degree: of the polynomial, 2 to 5.

    Returns:
        qd [rad/s] and qdd [rad/s2], each (N, n).

    Raises:
        InputError: a shape, a value or a setting that cannot be used; times that do not increase.
    """
    order = _whole(degree, "degree", 2, _native.max_fit_degree)
    count = _whole(window, "window", order + 1, _native.max_causal_window)
    times, rows = as_samples(t, q, "q", 1, "a derivative")
    rate, acceleration = _native.causal_derivatives(times, rows, count, order)
    return rate, acceleration


def differences(t: npt.ArrayLike, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Rates and accelerations of the parabola through each sample and its two neighbours, at their true times.

    Exact for polynomials of degree 2, without delay. The first and last rows take the parabola of the row beside them.
    At even intervals dt the noise gain of the rate is 1 / (sqrt(2) dt), that of the acceleration sqrt(6) / dt^2.

    Args:
        t: times, (N,), N at least 3, increasing [s].
        q: positions, (N, n) [rad].

    Returns:
        qd [rad/s] and qdd [rad/s2], each (N, n).

    Raises:
        InputError: a shape or a value that cannot be used; times that do not increase.
    """
    times, rows = as_samples(t, q, "q", 3, "a second difference")
    step = np.diff(times)[:, None]
    slope = np.diff(rows, axis=0) / step
    before, after = step[:-1], step[1:]
    qd, qdd = np.empty_like(rows), np.empty_like(rows)
    qd[1:-1] = (slope[:-1] * after + slope[1:] * before) / (before + after)
    qdd[1:-1] = 2 * (slope[1:] - slope[:-1]) / (before + after)
    qdd[0], qdd[-1] = qdd[1], qdd[-2]
    qd[0] = slope[0] - qdd[0] * step[0] / 2
    qd[-1] = slope[-1] + qdd[-1] * step[-1] / 2
    return qd, qdd


def _whole(value: Any, field: str, low: int, high: int) -> int:
    number = as_number(value, field)
    if number != int(number) or not low <= number <= high:
        raise InputError(field, f"is {value!r}", f"wanted a whole number from {low} to {high}")
    return int(number)
