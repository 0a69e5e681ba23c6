"""Poses in which gravity loads one joint both ways while it turns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.identification.design.clearance import Clearance, usable_joint_range
from bumpstop.model import gravity_torque

if TYPE_CHECKING:
    from bumpstop.model import Robot

_POSES = 4000  # of the other joints that are tried
_STRAIGHT = 0.4  # share of joints at zero
_LATTICE = math.radians(15)  # people read and type whole angles
_NEARLY = 0.03  # share of the best torque
_CHUNKS = 40  # of poses looked at together for clearance, best first
_ALONG = 25  # places along a stroke
_SEED = 11


@dataclass(frozen=True, eq=False)
class GravityPose:
    """A stroke of one joint over which its gravity torque changes sign.

    Attributes:
        joint: that moves, from 0.
        pose: of all joints (n,), the moved one where its gravity torque is zero [rad or m].
        low, high: ends of the stroke [rad].
        torque_low, torque_high: gravity torque there [Nm].
        clearance: least distance along the stroke to the floor or between parts of the arm [m].
    """

    joint: int
    pose: FloatArray
    low: float
    high: float
    torque_low: float
    torque_high: float
    clearance: float


@dataclass(frozen=True)
class Unobservable:
    """A joint whose map from current to torque the protocol cannot show.

    Attributes:
        joint: its number, from 0.
        name: of the joint.
        reason: why.
        remedy: what would make it visible.
    """

    joint: int
    name: str
    reason: str
    remedy: str


def find_gravity_pose(
    robot: Robot,
    joint: int,
    clearance: Clearance,
    *,
    gravity: tuple[float, float, float],
    half_stroke: float = math.pi / 2,
    min_torque: float = 0.5,
    margin: float = math.radians(5),
) -> GravityPose | Unobservable:
    """Search the pose of the other joints in which gravity loads a joint most on both sides of a stroke.

    Turning one joint alone, its gravity torque is a sine of its position, R sin(q - q0): two positions tell amplitude
    and zero of every pose. Poses on a lattice of 15 degrees are drawn with a fixed seed and taken in the order of the
    smaller of the torques at both ends; the first that is clear of the floor and of itself all along the stroke is it.

    Args:
        robot: with inertia.
        joint: from 0.
        clearance: what to keep clear of.
        gravity: acceleration of free fall in the base frame [m/s2].
        half_stroke: most to go on each side of the zero [rad].
        min_torque: wanted at both ends [Nm].
        margin: to the joint limits [rad].
    """
    name = robot.joints[joint].name
    if robot.joints[joint].kind == "prismatic":
        return Unobservable(
            joint,
            name,
            "it slides: the weight it carries does not change along its stroke",
            "weigh it with known loads",
        )
    low, high = usable_joint_range(robot, margin)
    poses = _lattice(robot, low, high)
    at_zero, at_quarter = poses.copy(), poses.copy()
    at_zero[:, joint], at_quarter[:, joint] = 0.0, math.pi / 2
    level, rise = (gravity_torque(robot, q, gravity=gravity)[:, joint] for q in (at_zero, at_quarter))
    amplitude = np.hypot(level, rise)
    if amplitude.max() < min_torque:
        return Unobservable(joint, name, *_why(robot, joint, poses, gravity, float(amplitude.max()), min_torque))
    zero = np.arctan2(-level, rise)  # level = -R sin(q0), rise = R cos(q0)
    best = np.zeros(len(poses))
    where, half = np.zeros(len(poses)), np.zeros(len(poses))
    for turn in range(math.floor(low[joint] / math.pi) - 1, math.ceil(high[joint] / math.pi) + 2):
        centre = zero + turn * math.pi
        room = np.minimum(np.minimum(centre - low[joint], high[joint] - centre), half_stroke)
        score = np.where(room > 0, amplitude * np.sin(np.maximum(room, 0.0)), 0.0)
        better = score > best
        best, where, half = (np.where(better, new, old) for new, old in ((score, best), (centre, where), (room, half)))
    # Of poses nearly as good the one that turns the other joints least.
    others = np.delete(np.abs(poses), joint, axis=1).sum(axis=1)
    order = np.lexsort((others, -np.floor(best / (_NEARLY * max(float(best.max()), 1e-12)))))
    for some in np.array_split(order[best[order] >= min_torque], _CHUNKS):
        strokes = np.repeat(poses[some], _ALONG, axis=0)
        share = np.tile(np.linspace(-1, 1, _ALONG), some.size)
        strokes[:, joint] = np.repeat(where[some], _ALONG) + np.repeat(half[some], _ALONG) * share
        least = clearance.least(strokes).reshape(-1, _ALONG).min(axis=1) if some.size else np.empty(0)
        for number in np.flatnonzero(least > 0)[:1]:
            stroke = strokes[number * _ALONG : (number + 1) * _ALONG]
            torque = gravity_torque(robot, stroke[[0, -1]], gravity=gravity)[:, joint]
            ends = (float(stroke[0, joint]), float(stroke[-1, joint]))
            pose = poses[some[number]].copy()
            pose[joint] = where[some[number]]
            return GravityPose(joint, pose, *ends, float(torque[0]), float(torque[1]), float(least[number]))
    if best.max() < min_torque:
        return Unobservable(
            joint,
            name,
            f"within its limits gravity gives it at most {best.max():.2g} Nm on both sides",
            "a known load off its axis, or another mounting",
        )
    return Unobservable(
        joint,
        name,
        "no stroke that gravity loads on both sides is clear of the floor and of the arm itself",
        "a higher base, or a smaller capsule radius if the links are slimmer",
    )


def _lattice(robot: Robot, low: FloatArray, high: FloatArray) -> FloatArray:
    rng = np.random.default_rng(_SEED)
    poses = rng.uniform(low, high, size=(_POSES, robot.dof))
    poses[rng.random(poses.shape) < _STRAIGHT] = 0.0
    revolute = [joint.kind == "revolute" for joint in robot.joints]
    rounded = np.round(poses / _LATTICE) * _LATTICE
    return np.clip(np.where(revolute, rounded, poses), low, high)


def _why(
    robot: Robot, joint: int, poses: FloatArray, gravity: tuple[float, float, float], most: float, least: float
) -> tuple[str, str]:
    axes = robot.jacobian(poses, robot.joints[joint].link)[:, 3:, joint]
    down = np.asarray(gravity) / max(float(np.linalg.norm(gravity)), 1e-12)
    if float(np.linalg.norm(np.cross(axes, down), axis=1).max()) < 1e-6:
        return (
            "its axis is vertical in every pose: gravity gives it no torque",
            "a tilted base (and gravity told as it then is)",
        )
    return (
        f"gravity gives it at most {most:.2g} Nm (wanted {least:g}): what it carries lies near its axis",
        "a known load mounted off its axis",
    )
