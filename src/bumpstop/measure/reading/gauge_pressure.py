"""Pressure that a gauge recorded beside the force: its zero, its sign and its range."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.measure.reading.gauge_fault import GaugeFault

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.measure.reading.gauge_curve import GaugeCurve

_MIN_BASELINE = 5
# A zero that is off by more than a share of the highest pressure, and by more than this, is taken away [N/cm2].
_OFFSET_SHARE, _MIN_OFFSET = 0.01, 0.5
# Limits of the body end at some hundreds; films and foils of collisions show no more [N/cm2].
MAX_PRESSURE_N_CM2 = 2000.0


def corrected_pressure(curve: GaugeCurve, free: int) -> tuple[FloatArray | None, list[GaugeFault]]:
    """Pressure from zero on, pressing positive [N/cm2], with what was changed or is wrong.

    Args:
        curve: as recorded.
        free: how many samples it begins with before contact; 0: the zero is not known.
    """
    if curve.pressure is None:
        return None, []
    pressure, name = curve.pressure, curve.columns[2]
    at_rest = pressure[:free][np.isfinite(pressure[:free])]
    zero = float(np.median(at_rest)) if at_rest.size >= _MIN_BASELINE else 0.0
    known = pressure[np.isfinite(pressure)] - zero
    if not known.size:
        return pressure, []
    if known.size > 1 and not np.ptp(known):
        text = (
            f"Column {name!r} is {known[0] + zero:.4g} N/cm² all the time: no pressure was recorded, the force counts."
        )
        return None, [GaugeFault("no_pressure", 1, text)]
    lowest, highest = float(known.min()), float(known.max())
    found = []
    if abs(zero) > max(_MIN_OFFSET, _OFFSET_SHARE * max(-lowest, highest)):
        pressure = pressure - zero
        text = f"Column {name!r} shows {zero:.3g} N/cm² before contact: that was taken away."
        found.append(GaugeFault("shifted", 1, text, repaired=True))
    if -lowest > highest:
        pressure, highest = -pressure, -lowest
        text = f"The pressure of column {name!r} is negative: it was turned over."
        found.append(GaugeFault("inverted", 1, text, repaired=True))
    if highest > MAX_PRESSURE_N_CM2:
        text = (
            f"A pressure of {highest:.4g} N/cm² is none of a gauge of collisions: the unit of pressure, "
            f"{curve.units[2]!r}, is wrong; the force counts all the same."
        )
        found.append(GaugeFault("wrong_unit", 1, text))
    return pressure, found
