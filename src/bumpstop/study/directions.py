"""Directions in space: drawn, or spread evenly."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from bumpstop.arrays import FloatArray

DirectionLaw = Literal["sphere", "polar", "scenario"]
"""``sphere``: even over the sphere. ``polar``: even polar angle and azimuth, which crowd at the poles (the source's
law). ``scenario``: always that of the scenario."""


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


def _vectors(polar: FloatArray, azimuth: FloatArray) -> FloatArray:
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)
