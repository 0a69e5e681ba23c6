"""Limits and angles of joints that are probably of another unit: a URDF has radians and metres, and their rates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bumpstop.model.urdf.reader import UrdfJoint

_WHOLE_TURN = 1.01 * 2 * np.pi  # [rad]
_TURNS = 2  # beyond so many to a side, limits are more likely degrees
_MAX_TRAVEL_M = 100.0  # no rail of an arm is as long
# The fastest wrists on sale turn at 50 rad/s, the slowest joints at 50 deg/s; slides keep below 20 m/s.
_MAX_RAD_S, _MAX_M_S = 50.0, 20.0


def limit_doubts(chain: Sequence[UrdfJoint]) -> list[str]:
    """A sentence, with the joints, for each kind of finite figure that looks like one of another unit."""
    most = _TURNS * 2 * np.pi
    turning = [joint for joint in chain if joint.kind in ("revolute", "continuous")]
    sliding = [joint for joint in chain if joint.kind == "prismatic"]
    found = (
        (
            "Origins turned by more than a whole turn, taken as radians; degrees?",
            [f"{joint.name!r} ({joint.largest_angle:.4g})" for joint in chain if joint.largest_angle > _WHOLE_TURN],
        ),
        (
            f"Limits of more than {_TURNS} turns to a side, taken as radians; degrees?",
            [_range(joint) for joint in turning if joint.kind == "revolute" and _far(joint) > most],
        ),
        (
            f"Limits of more than {_MAX_TRAVEL_M:g} m, taken as metres; millimetres?",
            [_range(joint) for joint in sliding if np.inf > _far(joint) > _MAX_TRAVEL_M],
        ),
        (
            f"Speed limits of more than {_MAX_RAD_S:g} rad/s, taken as rad/s; degrees per second?",
            [_speed(joint) for joint in turning if np.inf > joint.velocity > _MAX_RAD_S],
        ),
        (
            f"Speed limits of more than {_MAX_M_S:g} m/s, taken as m/s; millimetres per second?",
            [_speed(joint) for joint in sliding if np.inf > joint.velocity > _MAX_M_S],
        ),
    )
    return [
        f"{doubt} {'Joint' if len(joints) == 1 else 'Joints'} {', '.join(joints)}." for doubt, joints in found if joints
    ]


def _far(joint: UrdfJoint) -> float:
    return max(-joint.lower, joint.upper)


def _range(joint: UrdfJoint) -> str:
    return f"{joint.name!r} ({joint.lower:.4g} to {joint.upper:.4g})"


def _speed(joint: UrdfJoint) -> str:
    return f"{joint.name!r} ({joint.velocity:.4g})"
