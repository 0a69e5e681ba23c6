"""The farthest vertex by brute force: walk outward on the polytope's surface from many directions.

It shares nothing with the library: no coordinates are changed, no edges are enumerated. From the point where a
direction leaves the polytope it goes on along the face as far as the distance grows, then along the edge, then from
vertex to neighbouring vertex until none is farther. Every step shoots a ray at the faces.
"""

from __future__ import annotations

from itertools import combinations, product

import numpy as np

from bumpstop.arrays import FloatArray

_TINY = 1e-300


def farthest(normals: FloatArray, low: FloatArray, high: FloatArray, starts: FloatArray) -> FloatArray:
    """Largest |f| with low <= normals f <= high, found from all starting directions.

    Args:
        normals: (B, n, 3), of rank 3.
        low, high: (B, n), around zero.
        starts: (S, 3) unit vectors.

    Returns:
        (B,)
    """
    batch, n, _ = normals.shape
    count = len(starts)
    a = np.repeat(np.concatenate([normals, -normals], axis=1), count, axis=0)
    b = np.repeat(np.concatenate([high, -low], axis=1), count, axis=0)
    f = np.zeros((batch * count, 3))
    active = np.zeros((batch * count, 2 * n), dtype=bool)
    rows = np.arange(batch * count)

    def shoot(f: FloatArray, along: FloatArray, held: np.ndarray) -> tuple[FloatArray, np.ndarray]:
        slope = np.einsum("bjk,bk->bj", a, along)
        room = b - np.einsum("bjk,bk->bj", a, f)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.where((slope > 0) & ~held, np.maximum(room, 0) / np.maximum(slope, _TINY), np.inf)
        hit = t.argmin(axis=1)
        return t[rows, hit], hit

    # To the surface, then along the face, then along the edge.
    t, first = shoot(f, np.tile(starts, (batch, 1)), active)
    f = t[:, None] * np.tile(starts, (batch, 1))
    active[rows, first] = True
    face = a[rows, first]
    away = f - face * (np.sum(f * face, axis=1) / np.sum(face * face, axis=1))[:, None]
    t, second = shoot(f, away, active)
    f = f + np.where(np.isfinite(t), t, 0)[:, None] * away
    active[rows, second] = True
    edge = np.cross(face, a[rows, second])
    edge /= np.maximum(np.linalg.norm(edge, axis=1), _TINY)[:, None]
    edge *= np.where(np.sum(f * edge, axis=1) < 0, -1.0, 1.0)[:, None]
    t, third = shoot(f, edge, active)
    f = f + np.where(np.isfinite(t), t, 0)[:, None] * edge
    corner = np.stack([first, second, third], axis=1)
    # From vertex to vertex.
    for _ in range(4 * n):
        best = np.linalg.norm(f, axis=1)
        moved = np.zeros(len(f), dtype=bool)
        chosen_f, chosen_corner = f.copy(), corner.copy()
        for leave in range(3):
            i, j = corner[:, (leave + 1) % 3], corner[:, (leave + 2) % 3]
            edge = np.cross(a[rows, i], a[rows, j])
            edge /= np.maximum(np.linalg.norm(edge, axis=1), _TINY)[:, None]
            edge *= np.where(np.sum(edge * a[rows, corner[:, leave]], axis=1) > 0, -1.0, 1.0)[:, None]
            held = np.zeros_like(active)
            held[rows, i] = held[rows, j] = held[rows, corner[:, leave]] = True
            t, hit = shoot(f, edge, held)
            new = f + np.where(np.isfinite(t), t, 0)[:, None] * edge
            size = np.linalg.norm(new, axis=1)
            better = size > best * (1 + 1e-13)
            best = np.where(better, size, best)
            chosen_f[better] = new[better]
            chosen_corner[better, leave] = hit[better]
            moved |= better
        if not moved.any():
            break
        # Steps of zero length around a vertex where more than three faces meet are not followed.
        f, corner = chosen_f, chosen_corner
    size = np.linalg.norm(f, axis=1).reshape(batch, count)
    best_start = np.arange(batch) * count + size.argmax(axis=1)
    return _sharpened(a[best_start], b[best_start], corner[best_start], size.max(axis=1))


def _sharpened(a: FloatArray, b: FloatArray, corner: np.ndarray, size: FloatArray) -> FloatArray:
    """Distance of the vertices where the three faces of a corner meet, by Cramer's rule in long double.

    Walking there adds up roundings times the condition of the faces: 2e-9 of the length where that is 1e8.
    """
    rows = np.arange(len(a))[:, None]
    faces, bound = a[rows, corner].astype(np.longdouble), b[rows, corner].astype(np.longdouble)
    normals = [np.cross(faces[:, (k + 1) % 3], faces[:, (k + 2) % 3]) for k in range(3)]
    volume = np.sum(faces[:, 0] * normals[0], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = sum(bound[:, k, None] * normals[k] for k in range(3)) / volume[:, None]
        sharp = np.sqrt(np.sum(vertex * vertex, axis=1)).astype(np.float64)
    # Faces that do not meet in one point are no corner: there the search ended at the start of an edge.
    return np.where(np.abs(sharp / size - 1) < 1e-6, sharp, size)


def enumerated(normals: FloatArray, low: FloatArray, high: FloatArray) -> float:
    """Largest |f| over all points where three faces (n, 3) meet and that no other face cuts off, in long double."""
    faces = normals.astype(np.longdouble)
    slack = 1e-9 * np.maximum(high, -low)
    best = 0.0
    for corner in combinations(range(len(faces)), 3):
        a, b, c = faces[list(corner)]
        across = np.array([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
        volume = a @ across[0]
        if volume == 0:
            continue
        for bounds in product(*((low[j], high[j]) for j in corner)):
            f = np.array(bounds, dtype=np.longdouble) @ across / volume
            torque = faces @ f
            if (torque <= high + slack).all() and (torque >= low - slack).all():
                best = max(best, float(np.sqrt(f @ f)))
    return best


def directions(count: int) -> FloatArray:
    """Unit vectors spread evenly (a Fibonacci spiral)."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)
