"""The door of the room: times that increase, and a row of values for each."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.errors import InputError

if TYPE_CHECKING:
    import numpy.typing as npt


def as_samples(
    t: npt.ArrayLike, values: npt.ArrayLike, field: str, least: int, why: str
) -> tuple[FloatArray, FloatArray]:
    """Check times (N,) and values (N, n).

    Args:
        t: times [s].
        values: a row for each time.
        field: name of the values in an error.
        least: fewest samples.
        why: what needs them, for the error.

    Raises:
        InputError: wrong shapes, numbers that are not finite, too few samples, times that do not increase.
    """
    times = as_float_array(t, "t", (None,))
    if len(times) < least:
        raise InputError("t", f"has {len(times)} samples", f"{why} needs at least {least}")
    rows = as_float_array(values, field, (len(times), None))
    if rows.shape[1] == 0:
        raise InputError(field, f"has shape {rows.shape}", "wanted at least one column")
    steps = np.diff(times)
    if not (steps > 0).all():
        late = int(np.argmax(~(steps > 0))) + 1
        raise InputError(
            f"t[{late}]", f"{float(times[late])} is not later than {float(times[late - 1])} before it", "times increase"
        )
    return times, rows
