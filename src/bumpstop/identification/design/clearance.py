"""How far a pose keeps an arm from the floor and from itself, each link a capsule."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray

if TYPE_CHECKING:
    from bumpstop.model import Robot

# Links joined by a chain shorter than this many radii touch by design.
_JOINED = 4.0
_SEED = 7


@dataclass(frozen=True)
class Clearance:
    """Capsules round the straight lines from joint to joint and on to the tip.

    This is no collision check: the true shape of the links, cables and tools is not known.

    Attributes:
        robot: the chain.
        floor: height of a horizontal floor in the base frame [m]; None: there is none.
        radius: of every capsule [m].
    """

    robot: Robot
    floor: float | None = 0.0
    radius: float = 0.08

    def least(self, q: FloatArray) -> FloatArray:
        """The least distance of each pose (N, n) to the floor or between two parts of the arm [m]: (N,)."""
        points = self._points(q)
        gaps = [np.full(len(q), np.inf)]
        if self.floor is not None and self._lifted.any():
            gaps.append(points[:, self._lifted, 2].min(axis=1) - self.radius - self.floor)
        for first, second in self._pairs:
            ends = (points[:, first], points[:, first + 1], points[:, second], points[:, second + 1])
            gaps.append(_segment_distance(*ends) - 2 * self.radius)
        least: FloatArray = np.min(gaps, axis=0)
        return least

    def _points(self, q: FloatArray) -> FloatArray:
        """Base, joint origins and tip (N, n + 2, 3)."""
        points = np.zeros((len(q), self.robot.dof + 2, 3))
        for place, link in enumerate([*(joint.link for joint in self.robot.joints), None], start=1):
            points[:, place] = self.robot.pose(q, link)[:, :3, 3]
        return points

    @cached_property
    def _lifted(self) -> np.ndarray:
        """Which points some joint raises or lowers; the others stand where the arm is mounted."""
        height = self._points(_some_poses(self.robot, 32))[:, :, 2]
        return np.asarray(np.ptp(height, axis=0) > 1e-9)

    @cached_property
    def _pairs(self) -> list[tuple[int, int]]:
        points = self._points(_some_poses(self.robot, 1))[0]
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        count = len(lengths)
        return [
            (a, b)
            for a in range(count)
            for b in range(a + 2, count)
            if lengths[a] > 0 and lengths[b] > 0 and lengths[a + 1 : b].sum() > _JOINED * self.radius
        ]


def usable_joint_range(robot: Robot, margin: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Lower and upper joint positions a plan may use (n,): the limits less a margin [rad or m].

    A joint that turns uses half a turn at most to either side of zero, or where that leaves less than half of what its
    limits allow, a turn nearest to zero within them.
    """
    revolute = np.array([joint.kind == "revolute" for joint in robot.joints])
    lower = np.where(revolute, np.maximum(robot.lower, -np.pi), np.where(np.isfinite(robot.lower), robot.lower, 0.0))
    upper = np.where(revolute, np.minimum(robot.upper, np.pi), np.where(np.isfinite(robot.upper), robot.upper, 0.0))
    for j in np.flatnonzero(revolute & (upper - lower < 0.5 * np.minimum(robot.upper - robot.lower, 2 * np.pi))):
        least, most = robot.lower[j], robot.upper[j]
        lower[j], upper[j] = (
            (least, min(most, least + 2 * np.pi)) if least > -most else (max(least, most - 2 * np.pi), most)
        )
    inner = np.minimum(np.where(revolute, margin, 0.05 * (upper - lower)), 0.45 * (upper - lower))
    return lower + inner, upper - inner


def _some_poses(robot: Robot, count: int) -> FloatArray:
    lower, upper = usable_joint_range(robot)
    return np.random.default_rng(_SEED).uniform(lower, upper, size=(count, robot.dof))


def _segment_distance(a0: FloatArray, a1: FloatArray, b0: FloatArray, b1: FloatArray) -> FloatArray:
    """Least distances between segments, row by row; each argument (N, 3). After Ericson, 2005, section 5.1.9."""
    along_a, along_b, between = a1 - a0, b1 - b0, a0 - b0
    a, e = (np.maximum((x * x).sum(axis=1), 1e-12) for x in (along_a, along_b))
    b, c, f = ((x * y).sum(axis=1) for x, y in ((along_a, along_b), (along_a, between), (along_b, between)))
    spread = a * e - b * b
    s = np.where(spread > 1e-12 * a * e, np.clip((b * f - c * e) / np.maximum(spread, 1e-300), 0, 1), 0.0)
    t = np.clip((b * s + f) / e, 0, 1)
    s = np.clip((b * t - c) / a, 0, 1)
    distance: FloatArray = np.linalg.norm(between + s[:, None] * along_a - t[:, None] * along_b, axis=1)
    return distance
