"""Where joints stand still: friction then holds them, and their torque says little of the arm."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray

# A joint that moves by less than this [rad or m] in so many seconds rests. A reversal of a planned motion is shorter.
_TRAVEL, _REST_S = 5e-4, 0.3
# Rows at rest stay out of a joint's fit where it moves in this share of all rows at least; else they are all there is,
# and the joint is not scored.
MIN_MOVING = 0.1


def resting(q: FloatArray, rate_hz: float) -> npt.NDArray[np.bool_]:
    """Rows (N, n) at which a joint rests: of a time of 0.3 s about them in which it moves by less than 5e-4.

    Args:
        q: (N, n) recorded positions, unfiltered [rad or m].
        rate_hz: rows a second.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    window = max(3, round(_REST_S * rate_hz) | 1)
    span = maximum_filter1d(q, window, axis=0, mode="nearest") - minimum_filter1d(q, window, axis=0, mode="nearest")
    quiet = span < _TRAVEL
    # What the windows that rest hold, up to their ends.
    found: npt.NDArray[np.bool_] = maximum_filter1d(quiet.view(np.uint8), window, axis=0, mode="constant") > 0
    return found


def used_rows(rests: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Rows (N, n) that each joint is fitted to: those at which it moves; all where it hardly ever does."""
    hardly = (~rests).mean(axis=0) < MIN_MOVING
    used: npt.NDArray[np.bool_] = ~rests | hardly
    return used
