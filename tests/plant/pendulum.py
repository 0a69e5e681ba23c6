"""An arm of one joint, of which everything is known on paper, and motions for it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bumpstop.collision.trajectory.trajectory import Trajectory
from bumpstop.model import Joint, LinkInertia, Robot
from bumpstop.plant import Command, along

MASS, CENTRE, ABOUT_CENTRE, LENGTH = 2.0, 0.3, 0.02, 0.5
INERTIA = ABOUT_CENTRE + MASS * CENTRE**2
GRAVITY = 9.80665
NONE = (0.0, 0.0, 0.0)
Floats = npt.NDArray[np.float64]


def pendulum(*, rotor: float = 0.0, kind: str = "revolute") -> Robot:
    """One joint about y with a heavy link along x; +q turns it down."""
    tensor = ((0.001, 0, 0), (0, ABOUT_CENTRE, 0), (0, 0, ABOUT_CENTRE))
    link = LinkInertia(mass=MASS, center=(CENTRE, 0, 0), tensor=tensor)
    joint = Joint(
        name="j",
        link="l",
        axis=(0, 1, 0) if kind == "revolute" else (0, 0, 1),
        kind=kind,  # type: ignore[arg-type]
        inertia=link,
        rotor_inertia=rotor,
        lower=-3,
        upper=3,
        velocity=20,
    )
    return Robot(name="pendulum", joints=(joint,), tip_origin=(LENGTH, 0, 0))


def still(q: float = 0.0, seconds: float = 0.5) -> Command:
    return along(Trajectory(np.array([0.0, 0.1]), np.full((2, 1), q)), pendulum(), hold=seconds - 0.1)


def swing(way: float, seconds: float) -> Command:
    """From rest to rest, with a hundred rows."""
    u = np.linspace(0, 1, 101)
    rows = (way * u**3 * (10 - 15 * u + 6 * u * u))[:, None]
    return along(Trajectory(u * seconds, rows), pendulum())


def steady(rate: float, seconds: float) -> Command:
    t = np.linspace(0, seconds, 51)
    return along(Trajectory(t, (rate * t)[:, None]), pendulum())


def without_end(q: Floats, qd: Floats) -> Command:
    def react(*_: object) -> Command:
        raise AssertionError

    return Command(q, qd, react)
