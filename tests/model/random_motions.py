"""Arms with inertia in random motion, and what the library says of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from bumpstop.model import Robot, coriolis_torque, gravity_torque, inverse_dynamics, mass_matrix
from model.dynamics_cases import with_inertia
from model.random_chains import Floats, positions, random_robots

GRAVITY = np.array([1.5, -2.5, -9.3])  # along no axis


@dataclass(frozen=True)
class Motion:
    """Positions, rates and accelerations (N, dof); a wrench (N, 6) at a point of a link."""

    q: Floats
    qd: Floats
    qdd: Floats
    wrench: Floats
    link: int
    point: Floats


@dataclass(frozen=True)
class Dynamics:
    tau: Floats  # (N, dof), with gravity and the wrench
    mass: Floats  # (N, dof, dof)
    coriolis: Floats  # (N, dof)
    gravity: Floats  # (N, dof)


def random_motion(robot: Robot, count: int, rng: np.random.Generator) -> Motion:
    return Motion(
        q=positions(robot, count, rng),
        qd=rng.normal(size=(count, robot.dof)),
        qdd=3 * rng.normal(size=(count, robot.dof)),
        wrench=30 * rng.normal(size=(count, 6)),
        link=int(rng.integers(robot.dof)),
        point=rng.uniform(-0.5, 0.5, 3),
    )


def ours(robot: Robot, m: Motion) -> Dynamics:
    link = robot.joints[m.link].link
    return Dynamics(
        tau=inverse_dynamics(robot, m.q, m.qd, m.qdd, gravity=GRAVITY, wrench=m.wrench, link=link, point=m.point),
        mass=mass_matrix(robot, m.q),
        coriolis=coriolis_torque(robot, m.q, m.qd),
        gravity=gravity_torque(robot, m.q, gravity=GRAVITY),
    )


@cache
def random_arms() -> tuple[Robot, ...]:
    rng = np.random.default_rng(21)
    return tuple(with_inertia(robot, rng) for robot in random_robots())
