"""Shapes of an arm: a capsule along every link, and a drum about every joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray

if TYPE_CHECKING:
    from bumpstop.model import Robot

# Of the longest link: radius of the first capsule; the last has half of it.
_RADIUS_SHARE, _MIN_RADIUS_M, _MAX_RADIUS_M = 0.16, 0.012, 0.09
_MIN_LENGTH_M = 1e-6
_SECTIONS = 20
_BASE = -1


@dataclass(frozen=True, eq=False)
class LinkShape:
    """A mesh that is fixed to a link.

    Attributes:
        link: number of the link, from 0; -1 is the base.
        vertices: (V, 3) in the frame of the link [m].
        faces: (F, 3) vertices of every triangle.
        colour: red, green and blue, 0 to 255.
    """

    link: int
    vertices: FloatArray
    faces: npt.NDArray[np.int64]
    colour: tuple[int, int, int] = (200, 205, 212)

    def hit(self, origin: FloatArray, direction: FloatArray) -> float | None:
        """How far along a ray its nearest triangle stands, in lengths of ``direction``; None: the ray misses it.

        Möller and Trumbore (1997), all triangles at once.

        Args:
            origin: of the ray in the frame of the link (3,) [m].
            direction: of the ray in that frame (3,).
        """
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        across, up = b - a, c - a
        normal = np.cross(direction, up)
        volume = np.einsum("ij,ij->i", across, normal)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.einsum("ij,ij->i", origin - a, normal) / volume
            q = np.cross(origin - a, across)
            v = (q @ direction) / volume
            distance = np.einsum("ij,ij->i", up, q) / volume
            met = (np.abs(volume) > 1e-15) & (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
        return float(distance[met].min()) if met.any() else None


def arm_shapes(robot: Robot) -> list[LinkShape]:
    """Capsules along the lines between joints and drums about turning joints, from the kinematics alone.

    Args:
        robot: the arm.

    Returns:
        At most one mesh for the base and one for every link, each in the frame of its link.
    """
    ends = [np.asarray(joint.origin) for joint in robot.joints] + [np.asarray(robot.tip_origin)]
    lengths = [float(np.linalg.norm(end)) for end in ends]
    widest = min(max(_RADIUS_SHARE * max(lengths), _MIN_RADIUS_M), _MAX_RADIUS_M)
    radii = np.linspace(widest, widest / 2, robot.dof + 1)
    shapes = []
    for link in range(_BASE, robot.dof):
        # What the next joint is carried by belongs to this link.
        end, radius = ends[link + 1], float(radii[link + 1])
        parts = [capsule(np.zeros(3), end, radius)] if lengths[link + 1] > _MIN_LENGTH_M else []
        if link == _BASE:
            parts.append(_drum(np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.6 * radius, 0.5 * radius))
        elif robot.joints[link].kind == "revolute":
            axis = np.asarray(robot.joints[link].axis, dtype=np.float64)
            parts.append(_drum(np.zeros(3), axis, 1.15 * radius, 2.4 * radius))
        if link + 1 < robot.dof and robot.joints[link + 1].kind == "prismatic":
            parts.append(_rail(robot, link + 1, radius))
        shapes.append(_joined(link, parts))
    return [shape for shape in shapes if len(shape.faces)]


def _rail(robot: Robot, joint: int, radius: float) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """What a sliding joint slides along, in the frame of the link that carries it."""
    slide = robot.joints[joint]
    along = np.asarray(slide.rotation) @ np.asarray(slide.axis)
    low, high = (float(np.clip(limit, -1.0, 1.0)) for limit in (slide.lower, slide.upper))
    return capsule(np.asarray(slide.origin) + low * along, np.asarray(slide.origin) + high * along, radius / 2)


def _joined(link: int, parts: list[tuple[FloatArray, npt.NDArray[np.int64]]]) -> LinkShape:
    vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    for points, triangles in parts:
        vertices.append(points)
        faces.append(triangles + count)
        count += len(points)
    orange = link == _BASE
    return LinkShape(
        link, np.concatenate(vertices), np.concatenate(faces), (120, 126, 134) if orange else (206, 210, 216)
    )


def capsule(
    start: FloatArray, end: FloatArray, radius: float, sections: int = _SECTIONS
) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """A mesh of a capsule: vertices (V, 3) and faces (F, 3).

    Args:
        start: of its axis (3,) [m].
        end: of its axis (3,) [m].
        radius: [m].
        sections: corners of its round.
    """
    length = float(np.linalg.norm(end - start))
    rings = [(radius * np.cos(a), radius * np.sin(a)) for a in np.linspace(-np.pi / 2, 0, 6)[1:]]
    profile = [(r, z) for r, z in rings] + [(r, length - z) for r, z in reversed(rings)]
    return _turned(profile, (-radius, length + radius), start, (end - start) / max(length, _MIN_LENGTH_M), sections)


def _drum(
    centre: FloatArray, axis: FloatArray, radius: float, height: float
) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    axis = axis / np.linalg.norm(axis)
    edge = 0.12 * height
    half = height / 2
    profile = [(radius - edge, -half), (radius, -half + edge), (radius, half - edge), (radius - edge, half)]
    return _turned(profile, (-half, half), centre, axis)


def _turned(
    profile: list[tuple[float, float]],
    ends: tuple[float, float],
    start: FloatArray,
    axis: FloatArray,
    sections: int = _SECTIONS,
) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """A body of revolution: rings of radius and height, and the two points that close it."""
    side = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    angle = np.linspace(0, 2 * np.pi, sections, endpoint=False)
    circle = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * other
    points = [start + height * axis + radius * circle for radius, height in profile]
    vertices = np.concatenate([*points, [start + ends[0] * axis], [start + ends[1] * axis]])
    n, rings = sections, len(profile)
    i, j = np.arange(n), (np.arange(n) + 1) % n
    faces = []
    for ring in range(rings - 1):
        low, high = ring * n, (ring + 1) * n
        faces += [np.stack([low + i, low + j, high + j], axis=1), np.stack([low + i, high + j, high + i], axis=1)]
    bottom, top, last = rings * n, rings * n + 1, (rings - 1) * n
    faces += [np.stack([np.full(n, bottom), j, i], axis=1), np.stack([np.full(n, top), last + i, last + j], axis=1)]
    return vertices, np.concatenate(faces)
