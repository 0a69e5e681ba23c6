"""The point at which the force of an event is given, in words: the same of a detector and of its file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

# Points closer than this are one [m]: a file's are turned into the computing frame and back.
_SAME_POINT = 1e-9


def contact_place(
    links: Sequence[str], link: int, point: npt.ArrayLike, tip_name: str, tip_origin: npt.ArrayLike
) -> str:
    """The name of the tip or of a link, or the point of a link.

    Args:
        links: (n,) names.
        link: number of the link, the first is 0.
        point: (3,) in its frame [m].
        tip_name: of the frame fixed to the last link.
        tip_origin: (3,) in the last link's frame [m].
    """
    x = np.asarray(point, dtype=np.float64)
    if link == len(links) - 1 and np.abs(x - np.asarray(tip_origin)).max() < _SAME_POINT:
        return tip_name
    if np.abs(x).max() < _SAME_POINT:
        return links[link]
    # Without the signs of zeros, and without what is only rounding.
    shown = " ".join(f"{value:.6g}" for value in np.round(x, 9) + 0.0)
    return f"point {shown} m of {links[link]}"
