"""Cases of uncertain inputs, and how far each input by itself moves the result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class UncertainCase:
    """One case of the inputs.

    Attributes:
        name: ``"central"``, ``"confident"`` or ``"worst"``.
        p_over: probability that one contact exceeds the force or the pressure limit; NaN without limits.
        false_alarm: probability of an alarm before contact.
        utilisation: share of the limit that the force exceeded with the accepted probability uses; without limits that
            force [N].
        figures: of the inputs at a point that stands for the case (inputs,).
    """

    name: str
    p_over: float
    false_alarm: float
    utilisation: float
    figures: FloatArray


@dataclass(frozen=True, eq=False)
class TornadoBar:
    """How far one input moves the result by itself, all others in the central case.

    Attributes:
        key: of the input.
        low, high: its values; factors where it is relative.
        utilisation_low, utilisation_high: what they come to.
        p_over_low, p_over_high: the same as probabilities over the limits; NaN without limits.
        assumed: nobody measured the input.
        relative: ``low`` and ``high`` are factors.
    """

    key: str
    low: float
    high: float
    utilisation_low: float
    utilisation_high: float
    p_over_low: float
    p_over_high: float
    assumed: bool
    relative: bool

    @property
    def swing(self) -> float:
        """Absolute difference of both ends in utilisation."""
        low, high = self.utilisation_low, self.utilisation_high
        return 0.0 if low == high else abs(high - low)
