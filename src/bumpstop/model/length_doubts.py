"""Lengths of an arm that are probably of another unit: metres are wanted, and drawings have millimetres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bumpstop.model.inertia import Vector3
from bumpstop.model.joint import Joint

# The largest industrial arms reach less than 5 m, and the smallest more than 0.2 m.
MAX_LENGTH_M, MIN_LENGTH_M = 6.0, 0.1
# No length of an arm is as many times the sum of all its others.
_OUTLIER = 10.0


def length_doubts(name: str, joints: Sequence[Joint], tip_name: str, tip_origin: Vector3) -> tuple[str, ...]:
    """Why the lengths of a robot are probably of another unit.

    Args:
        name: of the robot, to speak of it.
        joints: from the base to the tip.
        tip_name: of the tip frame.
        tip_origin: of the tip in the frame of the last link [m].

    Returns:
        One sentence at most: one origin of a joint, or that of the tip, is ten times as long as all others together, or
        all of them are longer than 6 m together, or shorter than 0.1 m. How far joints slide is no length of the arm,
        and neither is what lies before the first joint that turns: it says where the arm stands. Empty: none of that,
        or no joint turns.
    """
    turning = [number for number, joint in enumerate(joints) if joint.kind == "revolute"]
    if not turning:
        return ()
    parts = {f"the origin of joint {joint.name!r}": joint.origin for joint in joints[turning[0] + 1 :]}
    parts[f"the tip {tip_name!r}"] = tip_origin
    lengths = {what: float(np.linalg.norm(origin)) for what, origin in parts.items()}
    total = sum(lengths.values())
    if total == 0:
        return ()
    longest = max(lengths, key=lambda what: lengths[what])
    others = total - lengths[longest]
    if lengths[longest] > _OUTLIER * others > 0:
        found = f"{longest} lies {lengths[longest]:.4g} m off, all other lengths of the arm are {others:.3g} m together"
    elif total > MAX_LENGTH_M:
        found = f"its links are {total:.4g} m long together, and no industrial arm is longer than {MAX_LENGTH_M:g} m"
    elif total < MIN_LENGTH_M:
        found = f"its links are {total:.2g} m long together, and no industrial arm is shorter than {MIN_LENGTH_M:g} m"
    else:
        return ()
    return (
        f"The lengths of {name} do not look like metres: {found}. Wrong levers make detection look better or worse "
        "than it is.",
    )
