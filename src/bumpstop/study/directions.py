"""Directions in space: drawn, or spread evenly."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError

DirectionLaw = Literal["sphere", "polar", "scenario"]
"""``sphere``: even over the sphere. ``polar``: even polar angle and azimuth, which crowd at the poles (the source's
law). ``scenario``: always that of the scenario."""


# A tip slower than this stands still, or only turns [m/s].
STANDS = 1e-6


def draw_directions(law: DirectionLaw, own: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Unit vectors at random.

    Args:
        law: by which.
        own: the scenario's direction (3,).
        count: how many.
        rng: source of chance.

    Returns:
        (count, 3).
    """
    if law == "scenario":
        return np.tile(own, (count, 1))
    azimuth = rng.uniform(-math.pi, math.pi, count)
    if law == "polar":
        return _vectors(rng.uniform(0, math.pi, count), azimuth)
    return _vectors(np.arccos(rng.uniform(-1, 1, count)), azimuth)


def spread_directions(law: DirectionLaw, own: FloatArray, count: int) -> FloatArray:
    """Unit vectors on a spiral from pole to pole, golden angles apart: as even as the law is.

    Args, returns: as :func:`draw_directions`.
    """
    if law == "scenario":
        return np.tile(own, (count, 1))
    share: FloatArray = (np.arange(count, dtype=np.float64) + 0.5) / count
    azimuth: FloatArray = np.arange(count, dtype=np.float64) * (math.pi * (3 - math.sqrt(5)))
    polar: FloatArray = math.pi * share if law == "polar" else np.arccos(1 - 2 * share)
    return _vectors(polar, azimuth)


def directions_of(velocity: FloatArray) -> FloatArray:
    """Unit vectors along velocities of the tip (rows, 3); where it stands, as at the nearest row where it moves."""
    speed = np.linalg.norm(velocity, axis=1)
    moves = np.flatnonzero(speed > STANDS)
    if not moves.size:
        raise InputError("motion.file", "the tip does not move", "wanted a trajectory that moves it")
    rows = np.arange(len(speed))
    after = np.searchsorted(moves, rows).clip(max=moves.size - 1)
    before = (after - 1).clip(min=0)
    nearest = moves[np.where(np.abs(rows - moves[before]) <= np.abs(moves[after] - rows), before, after)]
    return np.asarray(velocity[nearest] / speed[nearest][:, None])


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


def _vectors(polar: FloatArray, azimuth: FloatArray) -> FloatArray:
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)
