"""Colours of numbers that keep their order in grey and with any kind of colour vision."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray

# Viridis (Smith and van der Walt 2015) at seven places.
_VIRIDIS = np.array(
    [(68, 1, 84), (70, 50, 127), (54, 92, 141), (39, 127, 142), (31, 161, 135), (122, 209, 81), (253, 231, 37)],
    dtype=np.float64,
)
_UNKNOWN = (150, 150, 150)


def colours_of(values: FloatArray, low: float | None = None, high: float | None = None) -> npt.NDArray[np.uint8]:
    """A colour for every number (N, 3), red, green and blue; dark is low, grey is none.

    Args:
        values: (N,); NaN has no colour, infinity the highest.
        low: number of the darkest colour; None: the lowest of all.
        high: number of the brightest; None: the highest finite one.
    """
    finite = values[np.isfinite(values)]
    least = low if low is not None else float(finite.min(initial=np.inf))
    most = high if high is not None else float(finite.max(initial=-np.inf))
    span = most - least
    share = np.clip((values - least) / span, 0.0, 1.0) if span > 0 else np.where(np.isnan(values), np.nan, 0.5)
    place = np.nan_to_num(share) * (len(_VIRIDIS) - 1)
    colours = np.stack([np.interp(place, np.arange(len(_VIRIDIS)), _VIRIDIS[:, k]) for k in range(3)], axis=1)
    colours[np.isnan(values)] = _UNKNOWN
    return np.asarray(np.rint(colours), dtype=np.uint8)
