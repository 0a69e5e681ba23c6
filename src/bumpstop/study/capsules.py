"""Self-collision of an arm whose links are capsules about the lines between its joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop import _native
from bumpstop.arrays import FloatArray

if TYPE_CHECKING:
    from bumpstop.model import Robot

# Lines shorter than this are no links.
_MIN_LENGTH_M = 1e-6


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
    return np.asarray(_native.self_collisions(robot.chain, np.ascontiguousarray(q), link, point, radius))


def max_link_radius(robot: Robot, q: FloatArray) -> float:
    """The largest radius [m] at which two links of an arm are still no neighbours in a pose (dof,); 0 if there is none.

    That is half the length of arm between the first link and the last.
    """
    places = [np.zeros(3), *(robot.pose(q, joint.link)[:3, 3] for joint in robot.joints), robot.pose(q)[:3, 3]]
    lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
    links = np.flatnonzero(lengths > _MIN_LENGTH_M)
    return float(lengths[links[0] + 1 : links[-1]].sum() / 2) if links.size > 1 else 0.0
