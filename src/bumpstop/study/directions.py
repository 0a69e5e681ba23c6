"""Directions in space: drawn, or spread evenly."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError

DirectionSampling = Literal["sphere", "polar", "scenario"]
"""``sphere``: even over the sphere. ``polar``: even polar angle and azimuth, which crowd at the poles (Schroeder's
distribution). ``scenario``: always that of the scenario."""


# A tip slower than this stands still, or only turns [m/s].
STANDS = 1e-6


def draw_directions(sampling: DirectionSampling, own: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Unit vectors at random.

    Args:
        sampling: by which.
        own: the scenario's direction (3,).
        count: how many.
        rng: source of chance.

    Returns:
        (count, 3).
    """
    if sampling == "scenario":
        return np.tile(own, (count, 1))
    azimuth = rng.uniform(-math.pi, math.pi, count)
    if sampling == "polar":
        return _vectors(rng.uniform(0, math.pi, count), azimuth)
    return _vectors(np.arccos(rng.uniform(-1, 1, count)), azimuth)


def spread_directions(sampling: DirectionSampling, own: FloatArray, count: int) -> FloatArray:
    """Unit vectors on a spiral from pole to pole, golden angles apart: as even as asked for.

    Args, returns: as :func:`draw_directions`.
    """
    if sampling == "scenario":
        return np.tile(own, (count, 1))
    share: FloatArray = (np.arange(count, dtype=np.float64) + 0.5) / count
    azimuth: FloatArray = np.arange(count, dtype=np.float64) * (math.pi * (3 - math.sqrt(5)))
    polar: FloatArray = math.pi * share if sampling == "polar" else np.arccos(1 - 2 * share)
    return _vectors(polar, azimuth)


def nearest_moving(velocity: FloatArray) -> npt.NDArray[np.int64]:
    """Number of the row itself (rows,) where the tip moves with ``velocity`` (rows, 3), else of the nearest that does.

    Raises:
        InputError: the tip moves at no row.
    """
    moves = np.flatnonzero(np.linalg.norm(velocity, axis=1) > STANDS)
    if not moves.size:
        raise InputError("motion.file", "the tip does not move", "wanted a trajectory that moves it")
    rows = np.arange(len(velocity))
    after = np.searchsorted(moves, rows).clip(max=moves.size - 1)
    before = (after - 1).clip(min=0)
    return np.asarray(moves[np.where(np.abs(rows - moves[before]) <= np.abs(moves[after] - rows), before, after)])


def directions_of(velocity: FloatArray) -> FloatArray:
    """Unit vectors along velocities of the tip (rows, 3); where it stands, as at the nearest row where it moves."""
    nearest = velocity[nearest_moving(velocity)]
    return np.asarray(nearest / np.linalg.norm(nearest, axis=1)[:, None])


def cone_directions(direction: FloatArray, angle: float, count: int) -> list[FloatArray]:
    """The axis (N, 3), then directions in the cone of this half angle [rad] about it."""
    axis = np.where(np.abs(direction[:, [0]]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    side = np.cross(direction, axis)
    side /= np.linalg.norm(side, axis=1)[:, None]
    other = np.cross(direction, side)
    found = [direction]
    if angle <= 0:
        return found
    # Even over the cap of the sphere, by a spiral of golden angles that ends on the rim.
    for k in range(count):
        height = 1 - (1 - math.cos(angle)) * (k + 1) / count
        turn = k * math.pi * (3 - math.sqrt(5))
        radius = math.sqrt(max(0.0, 1 - height**2))
        found.append(height * direction + radius * (math.cos(turn) * side + math.sin(turn) * other))
    return found


def tilted(direction: FloatArray, axis: FloatArray, angle: float, step: float, count: int, turn: float) -> FloatArray:
    """Directions (N, count, 3) at an angle ``step`` [rad] from others (N, 3), evenly about them, the first at ``turn``.

    Those that would leave the cone of half angle ``angle`` [rad] about ``axis`` (N, 3) stand on its rim.
    """
    beside = np.where(np.abs(direction[:, [0]]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    side = np.cross(direction, beside)
    side /= np.linalg.norm(side, axis=1)[:, None]
    other = np.cross(direction, side)
    about = turn + np.arange(count) * (2 * math.pi / count)
    across = np.cos(about)[:, None] * side[:, None] + np.sin(about)[:, None] * other[:, None]
    found = math.cos(step) * direction[:, None] + math.sin(step) * across
    height = np.einsum("nki,ni->nk", found, axis)[:, :, None]
    outward = found - height * axis[:, None]
    outward /= np.maximum(np.linalg.norm(outward, axis=2, keepdims=True), 1e-300)
    rim = math.cos(angle) * axis[:, None] + math.sin(angle) * outward
    return np.asarray(np.where(height < math.cos(angle), rim, found))


def _vectors(polar: FloatArray, azimuth: FloatArray) -> FloatArray:
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)
