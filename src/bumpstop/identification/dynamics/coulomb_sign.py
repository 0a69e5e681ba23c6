"""The sign of Coulomb friction: of the speed, or built up over a presliding travel after each reversal."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.identification.dynamics.regressor_columns import speeds_of

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.identification.dynamics.regressor_columns import Couplings
    from bumpstop.identification.segments.motion import UniformMotion

# The sign begins anew behind a step in time of so many usual ones, and where time runs back: another segment.
_GAP_STEPS = 10.0


def coulomb_signs(
    motion: UniformMotion, couplings: Couplings, sign_speed: FloatArray, presliding: FloatArray | None = None
) -> FloatArray:
    """What Coulomb friction is multiplied by (N, n + shared motors), from -1 to 1.

    tanh(v / sign_speed) of the speed v; or, with a presliding travel d, a state z that follows the travel x (Dahl 1968,
    with exponent 1), dz/dx = (1 - sgn(v) z) / d, exactly where the speed is a straight line from row to row. It begins
    at tanh(v / sign_speed), as what went before is not known; some travels d later that is forgotten.

    Args:
        motion: on an even grid; segments may follow one another.
        couplings: joints that share a motor.
        sign_speed: (n + shared motors,) speed over which the sign turns; of shared motors, the mean of their joints'
            where there are only (n,) [rad/s or m/s].
        presliding: (n + shared motors,) travel over which it turns instead [rad or m]; NaN: by the speed; None: all do.
    """
    speeds = speeds_of(motion, couplings)
    scales = sign_speed
    if sign_speed.size < speeds.shape[1]:
        shared = [np.mean([sign_speed[j] for j, _ in group]) for group in couplings]
        scales = np.array([*sign_speed, *shared])
    signs: FloatArray = np.tanh(speeds / scales)
    if presliding is None:
        return signs
    steps = np.diff(motion.t)
    usual = float(np.median(steps)) if steps.size else 0.0
    breaks = np.flatnonzero((steps <= 0) | (steps > _GAP_STEPS * usual)) + 1
    for number in np.flatnonzero(np.isfinite(presliding)):
        speed = speeds[:, number]
        for start, stop in pairwise([0, *breaks.tolist(), motion.t.size]):
            own = slice(start, stop)
            way = _ways(speed[own], steps[start : stop - 1]) / presliding[number]
            signs[own, number] = _built_up(float(signs[start, number]), way.ravel())[::2]
    return signs


def _ways(speed: FloatArray, steps: FloatArray) -> FloatArray:
    """Ways (N - 1, 2) of each interval up to where the speed (N,) turns and from there on; halves where it does not.

    The speed is a straight line over the interval.
    """
    before, after = speed[:-1], speed[1:]
    half = 0.25 * (before + after) * steps
    with np.errstate(divide="ignore", invalid="ignore"):
        share = before / (before - after)
        turned = 0.5 * np.stack([before * share, after * (1 - share)], axis=1) * steps[:, None]
    return np.where((before * after < 0)[:, None], turned, half[:, None])


def _built_up(first: float, way: FloatArray) -> FloatArray:
    """The state (N,) from its first value on, by the way (N - 1,) of each interval as a share of the travel."""
    found = np.empty(way.size + 1)
    found[0] = first
    # As long as the way goes one direction, one exponential holds.
    turns = np.flatnonzero(np.diff(np.sign(way))) + 1
    for start, stop in pairwise([0, *turns.tolist(), way.size]):
        own = way[start:stop]
        towards = np.sign(own[:1])
        found[start + 1 : stop + 1] = towards + (found[start] - towards) * np.exp(-np.abs(own).cumsum())
    return found
