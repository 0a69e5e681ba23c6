"""Joint paths to poses: the tool on a straight line or an arc, followed from where the arm stands."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bumpstop.arrays import FloatArray
    from bumpstop.model import Robot

# Samples of a line: so far apart at most, and so many at most.
_STEP_M, _STEP_RAD, _MIN_SAMPLES, _MAX_SAMPLES = 0.005, 0.03, 12, 400
# A sample is found when the pose is this near [m and rad]; joints that turn more from one sample to the next jump.
_CLOSE, _ITERATIONS, _MAX_JUMP = 1e-9, 30, 0.5
# A turn this near to half of one goes either way round, as digits and encoders have it [rad].
_HALF_TURN = 1e-3
# Three points lie on a line where their triangle is this flat.
_FLAT = 1e-6
# Postures of an arm are looked for from so many places, each joint so far from where it stands [rad]; one is another or
# nearer where it is by more than this [rad].
_SEEDS, _SPREAD, _APART = 24, 2.0, 1e-3
# Within so much of each joint [rad] a posture is the one that was recorded with a pose, of the same arm.
_BESIDE = 0.1
# Damping of the least squares as a share of the distance that is left: none at the end.
_DAMPING = 0.05


def transform(pose: Sequence[float]) -> FloatArray:
    """Translation [m] and rotation vector [rad], six numbers, as a 4 x 4 transform."""
    from scipy.spatial.transform import Rotation

    X = np.eye(4)
    X[:3, 3] = pose[:3]
    X[:3, :3] = Rotation.from_rotvec(pose[3:6]).as_matrix()
    return X


def tool_positions(robot: Robot, q: FloatArray, tool: FloatArray) -> FloatArray:
    """Where the tool is (N, 3) [m] at joint positions (N, dof); ``tool`` is its pose in the tip, (4, 4)."""
    return robot.pose(q, point=tool[:3, 3])[:, :3, 3]


def joint_line(q0: FloatArray, q1: FloatArray) -> FloatArray:
    """Samples (N, dof) of a straight line from one joint position to another."""
    n = int(np.clip(math.ceil(float(np.abs(q1 - q0).max()) / _STEP_RAD), _MIN_SAMPLES, _MAX_SAMPLES))
    return np.asarray(q0 + np.linspace(0, 1, n + 1)[:, None] * (q1 - q0))


def tool_line(robot: Robot, q0: FloatArray, target: FloatArray, tool: FloatArray) -> FloatArray | str:
    """Joint positions (N, dof) while the tool goes straight from where it is to a pose; or why it cannot.

    The tool turns about one axis, evenly. Each sample is the nearest solution to the one before it, by damped least
    squares, so that an arm with more joints than six takes the least turning.

    Args:
        robot: with six joints or more.
        q0: joint positions at the begin (dof,).
        target: pose of the tool in the base (4, 4).
        tool: its pose in the tip (4, 4).
    """
    begin = robot.pose(q0) @ tool
    way = target[:3, 3] - begin[:3, 3]
    return _followed(robot, q0, target, tool, float(np.linalg.norm(way)), lambda s: begin[:3, 3] + s[:, None] * way)


def tool_arc(robot: Robot, q0: FloatArray, via: FloatArray, target: FloatArray, tool: FloatArray) -> FloatArray | str:
    """Joint positions (N, dof) while the tool goes on the circle through three points; or why it cannot.

    Arguments and orientations are as of a line; ``via`` is the second point, in the base (3,) [m].
    """
    begin = (robot.pose(q0) @ tool)[:3, 3]
    first, last = via - begin, target[:3, 3] - begin
    normal = np.cross(first, last)
    if not float(np.linalg.norm(normal)) > _FLAT * max(float(first @ first), float(last @ last)):
        return "the three points of its arc lie on a line"
    # The centre of the circle through the begin, as the origin, and two points.
    centre = np.cross((first @ first) * last - (last @ last) * first, normal) / (2 * normal @ normal)
    normal /= np.linalg.norm(normal)
    x, radius = -centre, float(np.linalg.norm(centre))
    y = np.cross(normal, x)
    angle = math.atan2(float((last - centre) @ y), float((last - centre) @ x)) % (2 * math.pi)

    def place(s: FloatArray) -> FloatArray:
        return np.asarray(begin + centre + np.outer(np.cos(angle * s), x) + np.outer(np.sin(angle * s), y))

    return _followed(robot, q0, target, tool, radius * angle, place)


def solution_near(robot: Robot, near: FloatArray, target: FloatArray, tool: FloatArray) -> FloatArray | str:
    """Joint positions (dof,) at which the tool has a pose, the nearest to others (dof,); or why they are not known."""
    q = _solve(robot, near, target, tool) if robot.dof == len(near) == 6 else None
    beside = q is not None and bool((np.abs(q - near) < _BESIDE).all())
    return q if q is not None and beside else "the posture that is written beside its target is not one of its pose"


def other_posture(robot: Robot, q0: FloatArray, q1: FloatArray, within: Sequence[tuple[int, float, float]]) -> str:
    """Why a joint move to a pose may end in another posture than one that reaches it; empty where nothing says so.

    A controller goes to the posture that is written beside the pose, or to the nearest. Which is nearest of an arm of
    more than six joints is not known.

    Args:
        robot: the arm.
        q0: joint positions at the begin (dof,).
        q1: those at the pose (dof,).
        within: least and greatest position of joints, by number from 0, of the posture that is written [rad].
    """
    if any(j < robot.dof and not low - _APART <= q1[j] <= high + _APART for j, low, high in within):
        return "the posture that is written beside its target is another one than the arm gets to"
    if robot.dof != 6:
        return ""
    target, near = robot.pose(q1), float(np.linalg.norm(q1 - q0)) - _APART
    turns = np.array([2 * math.pi * (joint.kind != "prismatic") for joint in robot.joints])
    seeds = np.random.default_rng(0).uniform(-_SPREAD, _SPREAD, (_SEEDS, 6))
    for q in (q1, *(_solve(robot, q0 + seed, target, np.eye(4)) for seed in seeds)):
        if q is not None:
            beside = q - turns * np.round((q - q0) / (2 * math.pi))
            inside = bool(((beside >= robot.lower) & (beside <= robot.upper)).all())
            if inside and float(np.linalg.norm(beside - q0)) < near:
                return "the arm has a nearer posture for its target than on its line there"
    return ""


def _followed(
    robot: Robot, q0: FloatArray, target: FloatArray, tool: FloatArray, length: float,
    place: Callable[[FloatArray], FloatArray],
) -> FloatArray | str:  # fmt: skip
    """Joint positions along a curve of a length [m], given by its places (N, 3) [m] at shares of it (N,)."""
    from scipy.spatial.transform import Rotation

    if robot.dof < 6:
        return f"{robot.name} has {robot.dof} joints, which reach no pose"
    begin = (robot.pose(q0) @ tool)[:3, :3]
    turn = Rotation.from_matrix(begin.T @ target[:3, :3]).as_rotvec()
    size = max(length / _STEP_M, float(np.linalg.norm(turn)) / _STEP_RAD)
    n = int(np.clip(math.ceil(size), _MIN_SAMPLES, _MAX_SAMPLES))
    share = np.linspace(0, 1, n + 1)
    turned, places = Rotation.from_rotvec(share[:, None] * turn).as_matrix(), place(share)
    rows = [q0]
    for i in range(1, n + 1):
        wanted = np.eye(4)
        wanted[:3, 3] = places[i]
        wanted[:3, :3] = begin @ turned[i]
        # Where the joints went they go on first: half the iterations are saved.
        guess = 2 * rows[-1] - rows[-2] if len(rows) > 1 else rows[-1]
        q = _solve(robot, guess, wanted, tool)
        if q is None:
            return f"the arm cannot follow it beyond {i - 1} of {n} parts of the way"
        if float(np.abs(q - rows[-1]).max()) > _MAX_JUMP:
            return f"joints jump after {i - 1} of {n} parts of the way, at a singularity"
        rows.append(q)
    if float(np.linalg.norm(turn)) > math.pi - _HALF_TURN:
        return "the tool turns by half a turn, and which way round is not known"
    return np.array(rows)


def _solve(robot: Robot, q: FloatArray, wanted: FloatArray, tool: FloatArray) -> FloatArray | None:
    """The joint positions beside ``q`` at which the tool has a pose; None where none is found."""
    from scipy.spatial.transform import Rotation

    q = q.copy()
    for _ in range(_ITERATIONS):
        pose = robot.pose(q) @ tool
        error = np.concatenate(
            [wanted[:3, 3] - pose[:3, 3], Rotation.from_matrix(wanted[:3, :3] @ pose[:3, :3].T).as_rotvec()]
        )
        left = float(np.linalg.norm(error))
        if left < _CLOSE:
            return q
        J = robot.jacobian(q, point=tool[:3, 3])
        damping = (_DAMPING * min(left, 1.0)) ** 2
        q += J.T @ np.linalg.solve(J @ J.T + damping * np.eye(6), error)
        if not np.isfinite(q).all():
            return None
    return None
