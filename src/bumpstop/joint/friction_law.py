"""Friction laws of a joint: how the current that friction takes depends on the rate and the load."""

from __future__ import annotations

import math
from typing import Literal

FrictionLaw = Literal["power", "stribeck", "load_dependent"]
"""``"power"``: sgn(qd) D abs(qd)^F (eq 2.27). ``"stribeck"``: sgn(qd) (coulomb + stribeck exp(-(qd /
stribeck_speed)^2)) + viscous qd. ``"load_dependent"``: sgn(qd) (coulomb + load abs(i)) + viscous qd, i as
measured."""

OF_FRICTION = {
    "power": ("D", "F"),
    "stribeck": ("coulomb", "viscous", "stribeck", "stribeck_speed"),
    "load_dependent": ("coulomb", "viscous", "load"),
}
"""Parameters of each law: D [current at 1 rad/s] and F [1], or coulomb [current], viscous [current s/rad], stribeck
[current], stribeck_speed [rad/s] and load [1]."""
FRICTION_BOUNDS = {
    "D": (0.0, math.inf),
    "F": (0.0, 3.0),
    "coulomb": (0.0, math.inf),
    "viscous": (0.0, math.inf),
    "stribeck": (0.0, math.inf),
    "stribeck_speed": (1e-6, math.inf),
    "load": (0.0, 0.99),
}
"""What a parameter may be."""
