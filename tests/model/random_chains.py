"""Random serial chains with the placements that break kinematics, and positions inside their limits."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from bumpstop.model import Joint, Robot, rotation_from_rpy

Floats = npt.NDArray[np.float64]


def unit(v: npt.ArrayLike) -> tuple[float, float, float]:
    x, y, z = (np.asarray(v) / np.linalg.norm(v)).tolist()
    return x, y, z


def skew(v: npt.ArrayLike) -> Floats:
    x, y, z = np.asarray(v)
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def turn(axis: npt.ArrayLike, angle: complex) -> npt.NDArray[np.complex128]:
    """Rotation about a unit vector (Rodrigues), analytic in the angle."""
    k = skew(axis)
    rotation: npt.NDArray[np.complex128] = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k)
    return rotation


def rows(matrix: npt.ArrayLike) -> tuple[tuple[float, float, float], ...]:
    return tuple(tuple(row) for row in np.asarray(matrix).tolist())


def random_robot(rng: np.random.Generator) -> Robot:
    """A chain of 1 to 12 joints of either kind, with the special placements that break kinematics."""
    joints: list[Joint] = []
    for i in range(int(rng.integers(1, 13))):
        axis = unit(rng.normal(size=3))
        rotation: npt.ArrayLike = turn(unit(rng.normal(size=3)), rng.uniform(-np.pi, np.pi)).real
        style = rng.choice(["any", "coordinate", "parallel", "antiparallel", "right angle"])
        if style == "coordinate":
            axis = unit(rng.choice([-1, 1]) * np.eye(3)[rng.integers(3)])
            rotation = rotation_from_rpy(*(rng.integers(-2, 3, 3) * np.pi / 2))
        elif joints and style != "any":
            # The axis before, seen from this joint's frame.
            before = np.array(joints[-1].axis) @ rotation
            if style == "right angle":
                before = np.cross(before, rng.normal(size=3))
            axis = unit(-before if style == "antiparallel" else before)
        origin = rng.uniform(-1, 1, 3) * rng.choice([0, 1]) * rng.choice([0, 1, 1], 3)
        joints.append(
            Joint(
                name=f"joint_{i}",
                link=f"link_{i}",
                kind="prismatic" if rng.random() < 0.3 else "revolute",
                origin=tuple(origin.tolist()),
                rotation=rows(rotation),
                axis=axis,
            )
        )
    return Robot(name="random", joints=tuple(joints), tip_origin=tuple(rng.uniform(-0.3, 0.3, 3).tolist()))


@cache
def random_robots() -> tuple[Robot, ...]:
    rng = np.random.default_rng(1)
    return tuple(random_robot(rng) for _ in range(240))


def positions(robot: Robot, count: int, rng: np.random.Generator) -> Floats:
    """Joint positions inside the limits; where there are none, up to 2 turns or 2 m either way."""
    largest = np.array([2.0 if joint.kind == "prismatic" else 4 * np.pi for joint in robot.joints])
    return rng.uniform(np.maximum(robot.lower, -largest), np.minimum(robot.upper, largest), (count, robot.dof))
