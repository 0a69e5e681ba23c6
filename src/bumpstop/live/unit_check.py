"""Signals that look like those of another unit: currents where the detector takes torques, or the reverse."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.live.loaded_detector import LoadedDetector

_WINDOW_S = 2.0
_MIN_ROWS = 50
# Of joints that carry enough to say something, so many must have a signal outside these times what is predicted.
_LOW, _HIGH = 0.5, 2.0
_MIN_COSINE = 0.95
# Without a prediction to compare with: residuals this many times the threshold, all the time.
_MANY_THRESHOLDS = 5.0


class UnitCheck:
    """Looks at two seconds of samples at a time, and tells once until they look right again.

    Of torques the predicted one is the signal minus the residual. Where the signal of most loaded joints follows it,
    but is less than half or more than twice as large, it is likely one of another unit. Of currents the prediction is
    not known here: then residuals of two joints or more that stay above five times their threshold are told. A contact
    or a payload that nobody declared may look the same, and the sentence says so.
    """

    def __init__(self, detector: LoadedDetector) -> None:
        self._thresholds = np.where(np.isfinite(detector.thresholds), detector.thresholds, np.nan)
        self._torques = not detector.takes_current
        self._names = detector.joints
        self._told = False
        self._restart(-np.inf)

    def _restart(self, t: float) -> None:
        n = self._thresholds.size
        self._since, self._rows = t, 0
        self._signal_square, self._product, self._predicted_square = np.zeros(n), np.zeros(n), np.zeros(n)
        self._least = np.full(n, np.inf)

    def look(self, t: float, signal: FloatArray, residual: FloatArray) -> str:
        """A sentence, where the last two seconds look like another unit; else nothing."""
        if not t >= self._since or self._since == -np.inf:
            self._restart(t)
        # Numbers that are no torques of an arm may be too large for their squares.
        with np.errstate(over="ignore", invalid="ignore"):
            predicted = signal - residual
            self._signal_square += signal * signal
            self._product += signal * predicted
            self._predicted_square += predicted * predicted
        np.minimum(self._least, np.abs(residual), out=self._least)
        self._rows += 1
        if t - self._since < _WINDOW_S or self._rows < _MIN_ROWS:
            return ""
        text = self._of_torques() if self._torques else self._of_currents()
        self._restart(t)
        told, self._told = self._told, bool(text)
        return "" if told else text

    def _of_torques(self) -> str:
        usual = np.sqrt(self._predicted_square / self._rows)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            scale = self._product / self._predicted_square
            cosine = self._product / np.sqrt(self._predicted_square * self._signal_square)
        # A joint that carries less than its threshold says nothing.
        loaded = usual > np.nan_to_num(self._thresholds, nan=np.inf)
        wrong = loaded & (np.abs(cosine) > _MIN_COSINE) & ((np.abs(scale) < _LOW) | (np.abs(scale) > _HIGH))
        if np.count_nonzero(wrong) < 2 or 2 * np.count_nonzero(wrong) <= np.count_nonzero(loaded):
            return ""
        told = ", ".join(f"{self._names[j]} {scale[j]:.3g}" for j in np.flatnonzero(wrong))
        return f"the signal follows the predicted torque, but is so many times as large: {told}; currents for torques?"

    def _of_currents(self) -> str:
        with np.errstate(invalid="ignore"):
            high = np.flatnonzero(self._least > _MANY_THRESHOLDS * self._thresholds)
        if high.size < 2:
            return ""
        told = ", ".join(self._names[j] for j in high)
        return (
            f"residuals stay above {_MANY_THRESHOLDS:g} times their thresholds for {_WINDOW_S:g} s: {told}; "
            "torques for currents, or an undeclared payload?"
        )
