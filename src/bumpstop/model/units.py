"""Units of joints in words: what turns has rad and Nm, what slides has m and N."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bumpstop.model.joint import Joint


def unit_of(*joints: Joint, turning: str = "Nm", sliding: str = "N") -> str:
    """The unit of one quantity of some joints.

    Args:
        joints: one or more.
        turning: its unit where a joint turns.
        sliding: its unit where a joint slides.

    Returns:
        ``Nm`` or ``N``; ``Nm (N)`` where some of the joints turn and others slide.
    """
    kinds = {joint.kind for joint in joints}
    if kinds == {"prismatic"}:
        return sliding
    return f"{turning} ({sliding})" if "prismatic" in kinds else turning


def one_unit(units: Sequence[str]) -> str:
    """Units of one quantity of several joints as :func:`unit_of` tells them together: ``Nm (N)`` for ``Nm`` and ``N``.

    Args:
        units: of each joint; one or more, and no more than two different ones, of which the longer is of what turns.
    """
    turning, *sliding = sorted(set(units), key=len, reverse=True)
    return f"{turning} ({sliding[0]})" if sliding else turning
