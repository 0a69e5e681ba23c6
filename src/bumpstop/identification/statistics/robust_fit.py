"""Robust nonlinear least squares with standard errors that hold where residuals are correlated in time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.signal import correlation_time

# Residuals up to so many robust standard deviations count by their square, larger ones by their size (Huber 1964): a
# Gaussian loses half a percent of efficiency, a collision or a glitch cannot drag the fit.
HUBER = 2.5
# Window of the long-run covariance, in correlation times of the residuals.
_WINDOW = 4.0
# A step that changes predictions by less than this share of the residuals is the last.
_SETTLED = 3e-4
_SAME_DIRECTION = 1e-14  # of the largest eigenvalue: below it is rounding
_TO_SD = 1.4826  # median absolute deviation of a Gaussian


@dataclass(frozen=True, eq=False)
class RobustFit:
    """What a fit found.

    Attributes:
        values: (k,) of the parameters.
        standard_errors: (k,); 1.96 of them to either side make a 95 % interval, also where few residuals are
            independent.
        visible: (k,) share of each parameter's column that the others cannot make up, 0 to 1.
        residual: (N,) measured less predicted.
        columns: (N, k) derivatives of the prediction.
        scale: robust standard deviation of the residuals.
        independent: number of residuals that count as independent.
        converged: whether the search ended by itself.
    """

    values: FloatArray
    standard_errors: FloatArray
    visible: FloatArray
    residual: FloatArray
    columns: FloatArray
    scale: float
    independent: float
    converged: bool


def robust_fit(
    model: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    measured: FloatArray,
    start: FloatArray,
    low: FloatArray,
    high: FloatArray,
    *,
    most: int = 80,
) -> RobustFit:
    """Fit a model under Huber's loss.

    Args:
        model: parameters (k,) to predictions (N,) and their derivatives (N, k).
        measured: (N,) evenly sampled.
        start: (k,) within the bounds.
        low: (k,) least values.
        high: (k,) largest values.
        most: steps.
    """
    values = np.clip(start, low, high)
    predicted, columns = model(values)
    scale = _scale(measured - predicted)
    knee, damping, converged = HUBER * scale, 1e-4, False
    loss = _huber(measured - predicted, knee)
    for _ in range(most):
        held = at_bound(columns, measured - predicted, values, low, high)
        step = gauss_newton_step(columns, measured - predicted, knee, damping, held)
        tried = np.clip(values + step, low, high)
        new_predicted, new_columns = model(tried)
        new_loss = _huber(measured - new_predicted, knee)
        moved = float(np.linalg.norm(columns @ (tried - values)))
        small = moved <= _SETTLED * scale * math.sqrt(measured.size)
        if not new_loss <= loss:
            converged = small  # no step so small can be told from rounding
            damping *= 10
            if small:
                break
            continue
        values, predicted, columns, loss = tried, new_predicted, new_columns, new_loss
        damping = max(damping / 10, 1e-10)
        new_scale = _scale(measured - predicted)
        if small and abs(new_scale - scale) <= 0.02 * scale:
            converged = True
            break
        # The scale of the first residuals is that of a rough start.
        scale = new_scale
        knee = HUBER * scale
        loss = _huber(measured - predicted, knee)
    residual = measured - predicted
    standard_errors, independent = long_run_errors(columns, residual, HUBER * scale)
    return RobustFit(values, standard_errors, visible_share(columns), residual, columns, scale, independent, converged)


def gauss_newton_step(
    columns: FloatArray, residual: FloatArray, knee: float, damping: float, held: npt.NDArray[np.bool_]
) -> FloatArray:
    """Step (k,) towards the least of Huber's loss, damped after Levenberg and Marquardt; held parameters stay.

    Args:
        columns: (N, k) derivatives of the prediction.
        residual: (N,).
        knee: residuals beyond count by their size.
        damping: share of each squared column that is added to it.
        held: (k,) parameters that stay.
    """
    weight = np.minimum(1.0, knee / np.maximum(np.abs(residual), 1e-300))
    length = np.linalg.norm(columns, axis=0)
    free = np.flatnonzero((length > 0) & ~held)
    scaled = columns[:, free] / length[free]
    normal = scaled.T @ (scaled * weight[:, None])
    normal[np.diag_indices(free.size)] *= 1 + damping
    step = np.zeros(columns.shape[1])
    step[free] = np.linalg.lstsq(normal, scaled.T @ (weight * residual), rcond=1e-13)[0] / length[free]
    return step


def at_bound(
    columns: FloatArray, residual: FloatArray, values: FloatArray, low: FloatArray, high: FloatArray
) -> npt.NDArray[np.bool_]:
    """Parameters (k,) at a bound that the loss would have them cross."""
    downhill = columns.T @ residual
    held: npt.NDArray[np.bool_] = ((values <= low) & (downhill < 0)) | ((values >= high) & (downhill > 0))
    return held


def _huber(residual: FloatArray, knee: float) -> float:
    size = np.abs(residual)
    return float(np.where(size <= knee, 0.5 * size**2, knee * (size - 0.5 * knee)).sum())


def long_run_errors(columns: FloatArray, residual: FloatArray, knee: float) -> tuple[FloatArray, float]:
    """Standard errors (k,) of an M-estimate whose residuals are correlated in time, and how many are independent.

    A sandwich whose filling is the long-run covariance of the scores with Bartlett's window (Newey and West 1987), its
    width W = 4 correlation times of the residuals. What that window is known to lose is given back: of an exponential
    memory the share 1 / 8, and of N rows whose scores the fit has made to add up to nothing W / N. The errors are
    widened by Student's quantile with as many degrees of freedom as the window leaves, 1.5 N / W, or as there are
    independent residuals beyond the parameters.

    Args:
        columns: (N, k) derivatives of the prediction.
        residual: (N,).
        knee: residuals beyond count by their size.
    """
    from scipy.special import ndtri, stdtrit

    rows, k = columns.shape
    memory = correlation_time(np.clip(residual, -knee, knee))
    independent = rows / memory
    inverse = np.linalg.pinv(columns.T @ (columns * (np.abs(residual) < knee)[:, None]), hermitian=True)
    scores = columns * np.clip(residual, -knee, knee)[:, None]
    window = min(math.ceil(_WINDOW * memory), rows // 3)
    filling = long_run_covariance(scores, window)
    variance = np.einsum("ij,jk,ki->i", inverse, filling, inverse)
    freedom = max(2.0, min(independent - k, 1.5 * rows / window))
    lost = (1 - 0.5 / _WINDOW) * (1 - window / rows) * max(0.1, 1 - k / independent)
    widened = float(stdtrit(freedom, 0.975) / ndtri(0.975)) / math.sqrt(lost)
    return widened * np.sqrt(np.maximum(variance, 0.0)), independent


def long_run_covariance(scores: FloatArray, window: int) -> FloatArray:
    """Sum over lags of the products of scores (N, k), with Bartlett's weights up to ``window`` rows: (k, k).

    The mean of the outer products of all overlapping sums of ``window`` rows, which is the same.
    """
    window = min(window, scores.shape[0])
    edge = np.zeros((window, scores.shape[1]))
    sums = np.cumsum(np.concatenate([edge, scores, edge[1:]]), axis=0)
    blocks = sums[window:] - sums[:-window]
    covariance: FloatArray = blocks.T @ blocks / window
    return covariance


def visible_share(columns: FloatArray) -> FloatArray:
    """Share of each column's length (N, k) that the others cannot make up, 0 to 1."""
    length = np.linalg.norm(columns, axis=0)
    full = np.where(length > 0, length, 1.0)
    squares, directions = np.linalg.eigh((columns / full).T @ (columns / full))
    # A direction that is left out, as a pseudo-inverse does, would make columns that are alike seem seen as a whole.
    # The largest is 1 at least, unless no column is other than zero, or there is none.
    least = _SAME_DIRECTION * squares.max(initial=1.0)
    inverse = (directions**2 / np.maximum(squares, least)).sum(axis=1)
    share: FloatArray = np.where(length > 0, 1 / np.sqrt(np.maximum(inverse, 1.0)), 0.0)
    return share


def _scale(residual: FloatArray) -> float:
    spread = _TO_SD * float(np.median(np.abs(residual)))
    return max(spread, 0.05 * float(residual.std()), 1e-12)
