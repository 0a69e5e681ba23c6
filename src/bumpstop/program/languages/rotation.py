"""Rotation vectors from the ways in which robot languages write orientations."""

from __future__ import annotations

import math


def from_quaternion(w: float, x: float, y: float, z: float) -> tuple[float, float, float] | None:
    """The rotation vector [rad] of a quaternion of any length; None of one that is next to zero."""
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not norm > 1e-6:
        return None
    if w < 0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    if sine < 1e-300:
        return 0.0, 0.0, 0.0
    factor = 2 * math.atan2(sine, w) / sine
    return factor * x, factor * y, factor * z


def from_euler_zyx(a: float, b: float, c: float) -> tuple[float, float, float]:
    """The rotation vector [rad] of turns about Z, the new Y and the new X [deg], as KUKA's A, B and C."""
    ca, sa, cb, sb, cc, sc = (part(math.radians(angle) / 2) for angle in (a, b, c) for part in (math.cos, math.sin))
    found = from_quaternion(
        ca * cb * cc + sa * sb * sc,
        ca * cb * sc - sa * sb * cc,
        ca * sb * cc + sa * cb * sc,
        sa * cb * cc - ca * sb * sc,
    )
    assert found is not None
    return found
