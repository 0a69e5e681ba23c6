"""The motions of Schroeder's validation: pick and place, two through the whole workspace, and pressing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.collision.trajectory.trajectory import Trajectory
from bumpstop.errors import InputError
from bumpstop.plant.command import COMMAND_STEP, Command, PlantReaction, along, line

if TYPE_CHECKING:
    from bumpstop.model import Robot

# Schroeder 2013, figure 3.4: accelerations peak 0.25, 1.25, 3.25 and 4.25 s into the motion.
_LEG_S, _BACK_S, _RAMP_S = 1.5, 3.0, 0.5
_MOVES = 8
_OF_RANGE = 0.8  # of each joint's range
_GATHERING_S = 2.0
_MIN_HEIGHT_M = 0.1  # of joint origins and tip [m]
# Of the fastest the joint may go: the two motions differ in speed.
_SPEED_SHARES = {1: (0.15, 0.45), 2: (0.25, 0.6)}
_ENDLESS = np.pi  # no joint turns farther to either side [rad]; the least a joint without limits has


def pick_and_place(robot: Robot, q: npt.ArrayLike, offset: Sequence[float] = (0.12, 0.0, -0.12)) -> Command:
    """Out along a straight line and back, as in section 3.1: 4.5 s, accelerations like a sine of half a second.

    Args:
        robot: the arm.
        q: start pose (dof,) [rad or m].
        offset: of the far end from the start, base frame (3,) [m]; the tool keeps its orientation.

    Raises:
        InputError: the line leaves the arm's reach or its limits.
    """
    pose, way = as_float_array(q, "pose", (robot.dof,)), as_float_array(offset, "offset", (3,))
    t = np.arange(0.0, 5.0 + 1e-9, 10 * COMMAND_STEP)
    share = _leg(t) - _leg(t - _BACK_S)
    begin = robot.pose(pose)[:3, 3]
    q_now = pose.copy()
    rows = []
    rank = min(6, robot.dof)
    for s in share:
        # Two steps of Newton's method: a row is a centimetre at most from the last.
        for _ in range(3):
            error = np.zeros(6)
            error[:3] = begin + s * way - robot.pose(q_now)[:3, 3]
            jacobian = robot.jacobian(q_now)
            error[3:] = _turn(robot.pose(pose)[:3, :3] @ robot.pose(q_now)[:3, :3].T)
            used = 6 if rank == 6 else 3
            q_now = q_now + np.linalg.lstsq(jacobian[:used], error[:used], rcond=1e-6)[0]
        if np.linalg.norm(begin + s * way - robot.pose(q_now)[:3, 3]) > 1e-6:
            raise InputError("motion.offset_mm", "leaves the reach of the arm", "give a shorter one, or another pose")
        rows.append(q_now.copy())
    return along(_checked(Trajectory(t, np.array(rows)), robot), robot)


def workspace(robot: Robot, number: int, moves: int = _MOVES) -> Command:
    """All joints at once, between poses spread over the workspace, at various speeds, as in section 3.1.

    Poses are points of a Halton sequence in 80 % of the joints' ranges, from and to the middle. Between poses every
    joint follows a polynomial of degree five, as long as its share of the fastest speed asks; poses are left out where
    a joint's origin or the tip would come below 0.1 m on the way.

    Args:
        robot: the arm.
        number: 1, or 2: other poses, and faster.
        moves: how many moves.

    Raises:
        InputError: there is no motion of that number, or too few poses are clear of the floor.
    """
    from scipy.stats import qmc

    if number not in _SPEED_SHARES:
        raise InputError("motion.kind", f"there is no workspace motion {number}", "valid: 1, 2")
    n = robot.dof
    low = np.where(np.isfinite(robot.lower), robot.lower, -_ENDLESS)
    high = np.where(np.isfinite(robot.upper), robot.upper, _ENDLESS)
    middle, half = (low + high) / 2, _OF_RANGE * np.minimum((high - low) / 2, _ENDLESS)
    fastest = np.where(np.isfinite(robot.velocity), robot.velocity, 1.0)
    points = qmc.Halton(n, scramble=False).random(4000)[1 + 1000 * (number - 1) :]
    slow, quick = _SPEED_SHARES[number]
    candidates = (middle, *(middle + half * (2 * u - 1) for u in points))
    start = next((q for q in candidates if _clear(robot, q[None])), middle)
    poses, times, at = [start], [0.0], 0
    for u in points:
        target = start if len(poses) == moves else middle + half * (2 * u - 1)
        if np.array_equal(target, poses[-1]):  # where the middle is too low the start is one of the points
            continue
        ways = poses[-1] + _smooth(np.linspace(0, 1, 21))[:, None] * (target - poses[-1])
        if not _clear(robot, ways):
            continue
        pace = slow + (quick - slow) * ((len(poses) * 0.618034) % 1.0)
        # The polynomial's fastest is 15/8 of the mean.
        times.append(times[-1] + max(0.4, float(np.max(1.875 * np.abs(target - poses[-1]) / (pace * fastest)))))
        poses.append(target)
        at += 1
        if at == moves:
            break
    if at < moves:
        problem = f"{robot.name} finds {at} of {moves} moves clear of the floor"
        raise InputError("robot", problem, "give a trajectory file")
    t = np.append(np.arange(0.0, times[-1], 10 * COMMAND_STEP), times[-1])
    move = np.clip(np.searchsorted(times, t, side="right") - 1, 0, moves - 1)
    begin, end = np.array(times)[move], np.array(times)[move + 1]
    share = _smooth((t - begin) / (end - begin))
    rows = np.array(poses)
    return along(_checked(Trajectory(t, rows[move] + share[:, None] * (rows[move + 1] - rows[move])), robot), robot)


def press(
    robot: Robot,
    q: npt.ArrayLike,
    velocity: Sequence[float],
    *,
    way: float,
    joint_acceleration: float | Sequence[float] = 4.5,
    held_joints: Sequence[int] = (),
) -> Command:
    """Go along a line from rest and come back, as in section 3.2.

    A reaction that reverses moves the tip back along the line; one that begins on the way back lets it go on there.

    Args:
        robot: the arm.
        q: start pose (dof,) [rad or m].
        velocity: of the tip, base frame (3,) [m/s].
        way: how far before it turns round [m]; turning takes a little more.
        joint_acceleration: limits of the joints [rad/s2].
        held_joints: that do not move, from 1.

    Raises:
        InputError: as :func:`~bumpstop.plant.line`.
    """
    speed = float(np.linalg.norm(as_float_array(velocity, "velocity", (3,))))
    if speed <= 0 or way <= 0:
        raise InputError("motion", f"presses {way:g} m at {speed:g} m/s", "wanted a way and a speed above 0")
    seconds = way / speed
    there = line(
        robot,
        q,
        velocity,
        # Gathering speed takes time, too; what is too long is cut off.
        duration=seconds + _GATHERING_S,
        start="rest",
        joint_acceleration=joint_acceleration,
        held_joints=held_joints,
    )
    tip = robot.pose(there.q)[:, :3, 3]
    gone = (tip - tip[0]) @ np.asarray(velocity) / speed
    far = np.flatnonzero(gone >= way)
    if not far.size:
        why = there.notes[0] if there.notes else "the joints do not gather that speed."
        problem = f"{1e3 * way:g} mm are not reached: {why}"
        raise InputError("motion.way_mm", problem, f"it gets {1e3 * gone.max():.4g} mm")
    last = int(far[0])
    turn = PlantReaction(kind="reverse", joint_acceleration=joint_acceleration)
    back = there.reaction(last, turn, rest=seconds)

    def go_on(count: int) -> tuple[FloatArray, FloatArray]:
        # One more, as a way of half a millisecond more may be rounded to fewer.
        farther = there.reaction(last, turn, rest=seconds + (count + 1) * COMMAND_STEP)
        beyond = slice(len(back.q), len(back.q) + count)
        return farther.q[beyond], farther.qd[beyond]

    q, qd = np.concatenate([there.q[:last], back.q]), np.concatenate([there.qd[:last], back.qd])
    # From where it then is, on the way in and on the way back.
    return Command(q, qd, there.react, go_on=go_on)


def _leg(t: FloatArray) -> FloatArray:
    """Share of the way at a time: it speeds up for half a second, goes on, and slows down, its acceleration a sine."""

    def ramp(x: FloatArray) -> FloatArray:
        x = np.clip(x, 0.0, _RAMP_S)
        turns = 2 * np.pi * x / _RAMP_S
        return np.asarray(x * x / (2 * _RAMP_S) + (np.cos(turns) - 1) * _RAMP_S / (4 * np.pi**2))

    steady = np.clip(t - _RAMP_S, 0.0, _LEG_S - 2 * _RAMP_S)
    slowing = np.clip(t - _LEG_S + _RAMP_S, 0.0, _RAMP_S)
    way = ramp(t) + steady + slowing - ramp(slowing)
    return np.asarray(way / (_LEG_S - _RAMP_S))


def _smooth(u: FloatArray) -> FloatArray:
    return np.asarray(u**3 * (10 - 15 * u + 6 * u * u))


def _turn(rotation: FloatArray) -> FloatArray:
    """Rotation vector of a small rotation [rad]."""
    return 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )


def _clear(robot: Robot, q: FloatArray) -> bool:
    """Joint origins beyond the second, and the tip, are above the floor in all poses."""
    lowest = robot.pose(q)[:, 2, 3].min()
    for joint in robot.joints[2:]:
        lowest = min(lowest, robot.pose(q, joint.link)[:, 2, 3].min())
    return bool(lowest > _MIN_HEIGHT_M)


def _checked(trajectory: Trajectory, robot: Robot) -> Trajectory:
    outside = np.argwhere(robot.beyond_limits(trajectory.position))
    if len(outside):
        row, j = (int(x) for x in outside[0])
        problem = f"takes joint {j + 1} to {trajectory.position[row, j]:.4g}, outside its limits"
        raise InputError("motion", problem, "give another pose")
    over = np.argwhere(np.abs(trajectory.at(trajectory.time, 1)) > robot.velocity)
    if len(over):
        raise InputError("motion", f"moves joint {int(over[0][1]) + 1} faster than it can", "give a shorter way")
    return trajectory
