"""Figures of the joints, each with its standard error, and which of them are identified."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray

# A figure known worse than by this share is not called identified.
MAX_ERROR = 0.3


@dataclass(frozen=True, eq=False)
class JointValues:
    """One quantity of every joint.

    Attributes:
        values: (dof,); nan where the joint showed nothing.
        errors: (dof,) standard errors; infinite where the joint showed nothing.
        reasons: (dof,) why a joint has no figure; empty where it has.
    """

    values: FloatArray
    errors: FloatArray
    reasons: tuple[str, ...]

    @property
    def identified(self) -> npt.NDArray[np.bool_]:
        """(dof,) joints with a figure."""
        return np.array([not reason for reason in self.reasons])


def judged(values: FloatArray, errors: FloatArray, reasons: list[str]) -> JointValues:
    """Figures (dof,), of which those that are not positive or known worse than by 30 % get a reason."""
    told = list(reasons)
    for j, reason in enumerate(reasons):
        if reason:
            continue
        if not (np.isfinite(values[j]) and values[j] > 0):
            told[j] = "it comes out as zero or less"
        elif not errors[j] <= MAX_ERROR * values[j]:
            told[j] = f"its standard error is {100 * errors[j] / values[j]:.0f} %, more than {100 * MAX_ERROR:.0f} %"
    shown = np.array([not reason for reason in told])
    return JointValues(np.where(shown, values, np.nan), np.where(shown, errors, np.inf), tuple(told))
