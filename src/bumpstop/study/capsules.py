"""Self-collision of an arm whose links are capsules about the lines between its joints."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray

if TYPE_CHECKING:
    from bumpstop.model import Robot

# Lines shorter than this are no links.
_SHORTEST_M = 1e-6


def chain_points(robot: Robot, q: FloatArray) -> FloatArray:
    """Base origin, every joint's place and the tip, in the base frame.

    Args:
        robot: the arm.
        q: joint positions (N, dof) [rad or m].

    Returns:
        (N, dof + 2, 3) [m].
    """
    places = [np.zeros((len(q), 3))]
    places += [robot.pose(q, joint.link)[:, :3, 3] for joint in robot.joints]
    places.append(robot.pose(q)[:, :3, 3])
    return np.stack(places, axis=1)


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
    points = chain_points(robot, q)
    begins, ends = points[:, :-1], points[:, 1:]
    lengths = np.linalg.norm(ends - begins, axis=2)
    hit = np.zeros(len(q), dtype=np.bool_)
    for i, j in itertools.combinations(range(lengths.shape[1]), 2):
        between = lengths[:, i + 1 : j].sum(axis=1)
        apart = (between >= 2 * radius) & (lengths[:, i] > _SHORTEST_M) & (lengths[:, j] > _SHORTEST_M)
        if apart.any():
            gap = segment_distance(begins[apart, i], ends[apart, i], begins[apart, j], ends[apart, j])
            hit[apart] |= gap < 2 * radius
    return hit


def segment_distance(p: FloatArray, p_end: FloatArray, r: FloatArray, r_end: FloatArray) -> FloatArray:
    """Shortest distance between line segments, row by row.

    Either the lines' nearest points lie inside both segments, or one of them is an end.

    Args:
        p: begins of the first segments (N, 3) [m].
        p_end: their ends; no segment is a point.
        r: begins of the second segments (N, 3) [m].
        r_end: their ends.

    Returns:
        (N,) [m].
    """
    u, v, w = p_end - p, r_end - r, p - r
    uu, uv, vv, uw, vw = (np.einsum("ij,ij->i", a, b) for a, b in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    candidates = [
        _point_to_segment(p, r, r_end),
        _point_to_segment(p_end, r, r_end),
        _point_to_segment(r, p, p_end),
        _point_to_segment(r_end, p, p_end),
    ]
    determinant = uu * vv - uv**2
    crossing = determinant > 1e-12 * uu * vv
    safe = np.where(crossing, determinant, 1.0)
    s, t = (uv * vw - vv * uw) / safe, (uu * vw - uv * uw) / safe
    inside = crossing & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    lines = np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1)
    return np.asarray(np.minimum(np.min(candidates, axis=0), np.where(inside, lines, np.inf)))


def _point_to_segment(point: FloatArray, begin: FloatArray, end: FloatArray) -> FloatArray:
    along = end - begin
    share = np.einsum("ij,ij->i", point - begin, along) / np.einsum("ij,ij->i", along, along)
    return np.asarray(np.linalg.norm(point - begin - np.clip(share, 0, 1)[:, None] * along, axis=1))
