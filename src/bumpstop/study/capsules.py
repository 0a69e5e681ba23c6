"""Self-collision of an arm whose links are capsules about the lines between its joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.kernels import core

if TYPE_CHECKING:
    from bumpstop.model import Robot


def self_collision(robot: Robot, q: FloatArray, radius: float) -> npt.NDArray[np.bool_]:
    """Whether two links of one radius touch.

    A link is the line from one joint to the next, from the base's origin to the tip, with ``radius`` about it. Links
    with less than two radii of arm between them are neighbours: they overlap in every pose and are kept apart by the
    joint limits, not by this test. Prismatic travel counts as arm.

    Args:
        robot: the arm.
        q: joint positions (N, dof) [rad or m].
        radius: of the capsules [m].

    Returns:
        (N,).
    """
    link, point = robot.frame(None)
    return np.asarray(core.self_collisions(robot.chain, np.ascontiguousarray(q), link, point, radius))
