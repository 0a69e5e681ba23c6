"""Force and pressure of clamped contact: the body cannot get away and answers as a linear spring."""

from __future__ import annotations

from typing import TYPE_CHECKING, overload

from bumpstop.errors import InputError

# numpy is imported where it is used, so that naming a limit table costs no array library.
if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]


@overload
def clamped_force(stiffness_N_m: float, compression_m: float) -> float: ...
@overload
def clamped_force(stiffness_N_m: FloatArray, compression_m: float | FloatArray) -> FloatArray: ...
@overload
def clamped_force(stiffness_N_m: float, compression_m: FloatArray) -> FloatArray: ...
def clamped_force(stiffness_N_m: float | FloatArray, compression_m: float | FloatArray) -> float | FloatArray:
    """Contact force F = K max(0, x), Schroeder's eq 6.1 without tension [N].

    Args:
        stiffness_N_m: stiffness K of the body [N/m], finite and above 0. Tables give N/mm; the
            ``stiffness_N_m`` of :class:`~bumpstop.contact.ContactLimits` is already converted.
        compression_m: how far the body is compressed, x [m]; negative while the arm has not reached it.

    Returns:
        Force [N], 0 without compression; a float for floats, else an array of the common (broadcast) shape.
        A NaN compression gives a NaN force, never 0.

    Raises:
        InputError: a stiffness that is not finite and above 0.
    """
    import numpy as np

    stiffness = _at_least("contact.stiffness_N_m", stiffness_N_m, 0.0, exclusive=True)
    # np.maximum keeps NaN, where Python's max(0.0, nan) would answer 0: a force that was never computed.
    force = stiffness * np.maximum(compression_m, 0.0)
    return float(force) if np.ndim(force) == 0 else force


@overload
def pressure_N_cm2(force_N: float, area_cm2: float, peak_factor: float = 1.0) -> float: ...
@overload
def pressure_N_cm2(force_N: FloatArray, area_cm2: float | FloatArray, peak_factor: float = 1.0) -> FloatArray: ...
@overload
def pressure_N_cm2(force_N: float, area_cm2: FloatArray, peak_factor: float = 1.0) -> FloatArray: ...
def pressure_N_cm2(
    force_N: float | FloatArray, area_cm2: float | FloatArray, peak_factor: float = 1.0
) -> float | FloatArray:
    """Highest pressure in the contact, p = peak_factor F / area [N/cm2].

    With a factor of 1 it is the stress of Schroeder's section 6.1.3, force over area.

    Args:
        force_N: contact force F [N].
        area_cm2: contact area [cm2], finite and above 0.
        peak_factor: highest over mean pressure [1], finite and at least 1; 1 is evenly spread pressure.

    Returns:
        Pressure [N/cm2]; a float for floats, else an array of the common (broadcast) shape. A NaN force gives
        a NaN pressure, an infinite force an infinite one.

    Raises:
        InputError: an area or a peak factor outside those ranges.
    """
    import numpy as np

    area = _at_least("contact.area_cm2", area_cm2, 0.0, exclusive=True)
    factor = _at_least("contact.peak_factor", peak_factor, 1.0, exclusive=False)
    pressure = factor * np.asarray(force_N, dtype=float) / area
    return float(pressure) if np.ndim(pressure) == 0 else pressure


def _at_least(field: str, value: float | FloatArray, bound: float, *, exclusive: bool) -> FloatArray:
    """The value as an array, every element finite and above (or at) the bound."""
    import numpy as np

    values = np.asarray(value, dtype=float)
    good = np.isfinite(values) & ((values > bound) if exclusive else (values >= bound))
    if not np.all(good):
        first = float(values[~good].flat[0])
        raise InputError(
            field, f"{first!r} cannot be used", f"finite and {'above' if exclusive else 'at least'} {bound:g}"
        )
    return values
