"""Directions along which the arm may push undetected, all over its links."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.detection.sensitivity import undetectable_forces

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionProblem

# Places on every link, as shares of the way from its joint to the next.
_SHARES = (1 / 3, 2 / 3, 1.0)
_MIN_LENGTH_M = 0.02


@dataclass(frozen=True, eq=False)
class PoorDirections:
    """The direction of poorest detection at places of the arm, and every direction without any.

    Attributes:
        link: (N,) number of the link, from 0.
        point: (N, 3) in the frame of the link [m].
        place: (N, 3) the same in the base frame [m].
        direction: (N, 3) unit vectors in the base frame.
        force: (N,) largest force along the direction that stays undetected [N]; infinite where none is detected.
    """

    link: npt.NDArray[np.int64]
    point: FloatArray
    place: FloatArray
    direction: FloatArray
    force: FloatArray


def poor_directions(problem: CollisionProblem, q: FloatArray) -> PoorDirections:
    """Search the arm with :func:`bumpstop.detection.sensitivity.undetectable_forces`.

    A place has one row for every direction that turns no monitored joint, and one for the largest force that is
    undetected although it turns some; none where no joint is monitored by which it could be turned.

    Args:
        problem: whose thresholds count.
        q: pose (dof,) [rad or m].
    """
    robot, theta = problem.robot, problem.thresholds
    mean = np.clip(problem.noise_mean, -0.999 * theta, 0.999 * theta)
    ends = [*(np.asarray(joint.origin) for joint in robot.joints[1:]), np.asarray(robot.tip_origin)]
    rows: list[tuple[int, FloatArray, FloatArray, FloatArray, float]] = []
    for number, (joint, end) in enumerate(zip(robot.joints, ends, strict=True)):
        for share in _SHARES if np.linalg.norm(end) > _MIN_LENGTH_M else (1.0,):
            point = share * end
            found = undetectable_forces(robot, q, theta, link=joint.link, point=point, noise_mean=mean)
            place = robot.pose(q, joint.link, point)[:3, 3]
            rows += [(number, point, place, axis, np.inf) for axis in found.null_space]
            force = float(found.largest_detectable)
            if force > 0:
                rows.append((number, point, place, np.asarray(found.largest_vector) / force, force))
    columns = list(zip(*rows, strict=True))
    return PoorDirections(np.array(columns[0], dtype=np.int64), *(np.array(column) for column in columns[1:]))
