"""What an arm carries: declared, or found from joint torques."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import as_float_array, as_number
from bumpstop.errors import InputError
from bumpstop.model.inertia import LinkInertia, Vector3, merged, vector3

if TYPE_CHECKING:
    from bumpstop.model import Robot


_MAX_MASS, _MAX_DISTANCE = 1e5, 100.0  # [kg], [m]; what an arm carries is far from both


@dataclass(frozen=True)
class Payload:
    """A point mass at the tip.

    Attributes:
        mass: [kg].
        center: of mass in the frame of the tip [m].
    """

    mass: float
    center: Vector3 = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", _checked(self.mass, self.center))


def _checked(mass: float, center: npt.ArrayLike) -> Vector3:
    if not 0 <= as_number(mass, "payload.mass") <= _MAX_MASS:
        raise InputError("payload.mass", f"is {mass} kg", f"wanted 0 to {_MAX_MASS:g}")
    offset = as_float_array(center, "payload.center", (3,))
    if np.abs(offset).max() > _MAX_DISTANCE:
        raise InputError("payload.center", f"is {offset.tolist()} m", f"wanted at most {_MAX_DISTANCE:g} either way")
    return vector3(offset)


def with_payload(robot: Robot, mass: float, center: npt.ArrayLike = (0.0, 0.0, 0.0)) -> Robot:
    """The robot with a point mass fixed to its tip.

    Args:
        robot: with an inertia of its last link.
        mass: of the payload [kg].
        center: of mass in the frame of the tip [m].

    Raises:
        InputError: a mass or a place that no payload has, or a last link of unknown inertia.
    """
    offset = _checked(mass, center)
    last = robot.joints[-1]
    if last.inertia is None:
        raise InputError("robot", f"{robot.name}: no inertia of link {last.link!r} is known", "dynamics needs it")
    load = LinkInertia(mass=mass, center=offset).moved(robot.tip_origin, np.asarray(robot.tip_rotation))
    carried = replace(last, inertia=merged([last.inertia, load]))
    return replace(robot, joints=(*robot.joints[:-1], carried))
