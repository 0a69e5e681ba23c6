"""The forces at a point of the arm that no threshold detects, as a solid to scale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.detection.sensitivity import undetectable_forces

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionProblem

# Corners farther away than this [N] are cut off: no picture holds them.
MAX_FORCE_N = 2000.0


@dataclass(frozen=True, eq=False)
class ForcePolytope:
    """Forces that the arm may exert undetected.

    Attributes:
        vertices: (V, 3) corners in the base frame [N].
        faces: (F, 3) triangles of the hull.
        farthest: (3,) the corner farthest from zero, of all that are detectable [N].
        largest_N: its size; infinite where some direction is not detectable at all.
        cut: it goes beyond :data:`MAX_FORCE_N` and is cut off there.
    """

    vertices: FloatArray
    faces: npt.NDArray[np.int64]
    farthest: FloatArray
    largest_N: float
    cut: bool


def force_polytope(problem: CollisionProblem, q: FloatArray) -> ForcePolytope:
    """The polytope ``{ f : |(J_v' f)_j + mu_j| <= theta_j }`` of the contact point, see :mod:`.sensitivity`.

    Args:
        problem: whose thresholds and contact point count.
        q: pose (dof,) [rad or m].
    """
    from scipy.spatial import ConvexHull, HalfspaceIntersection

    contact, theta, mean = problem.scenario.contact, problem.thresholds, problem.noise_mean
    mean = np.clip(mean, -0.999 * theta, 0.999 * theta)
    found = undetectable_forces(problem.robot, q, theta, link=contact.link, point=contact.point_m, noise_mean=mean)
    J = problem.robot.jacobian(q, contact.link, contact.point_m)[:3]
    monitored = np.isfinite(theta)
    rows, high, low = J[:, monitored].T, (theta - mean)[monitored], (theta + mean)[monitored]
    box = np.eye(3)
    normals = np.concatenate([rows, -rows, box, -box])
    offsets = np.concatenate([high, low, np.full(6, MAX_FORCE_N)])
    # A joint that no force turns sets no face.
    real = np.linalg.norm(normals, axis=1) > 1e-9
    corners = HalfspaceIntersection(np.column_stack([normals, -offsets])[real], np.zeros(3)).intersections
    corners = np.unique(np.round(corners, 6), axis=0)
    hull = ConvexHull(corners)
    # The hull's triangles turn either way; outward is away from zero, which is inside.
    faces = np.array(hull.simplices, dtype=np.int64)
    a, b, c = (corners[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) < 0
    faces[inward] = faces[inward][:, ::-1]
    cut = bool((np.abs(corners) > MAX_FORCE_N - 1e-3).any())
    return ForcePolytope(corners, faces, np.asarray(found.largest_vector), float(found.largest), cut)
