"""Motions of moves against closed forms, and of recordings against what was recorded."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bumpstop.arrays import FloatArray
from bumpstop.collision.trajectory.trajectory import Trajectory
from bumpstop.program.cell import write_trajectory
from bumpstop.program.motion.kinematics import tool_line, transform
from bumpstop.program.motion.timing import RAMP_S, PathMotion
from bumpstop.program.safe_speed import greatest_factor
from bumpstop.program.trajectories.recorded import read_recorded
from bumpstop.program.trajectories.trajectory_segment import TrajectorySegment, find_segments
from bumpstop.program.worst_onset import _crest
from program.corpora import bell, cell, segments

FAR, HIGH = "[0.9, -1.57, 1.57, -1.57, -1.57, 0]", "[0.9, -1.2, 1.4, -1.77, -1.57, 0]"


def dense(motion: Trajectory) -> tuple[FloatArray, FloatArray, FloatArray]:
    t = np.linspace(0, motion.duration, 4001)
    return t, motion.at(t), motion.at(t, 1)


def test_a_joint_move_takes_the_time_of_the_closed_form() -> None:
    (segment,) = segments(f"movej({FAR}, a=1.2, v=0.5)")
    motion = segment.at(1.0)
    # Distance over speed, a ramp up and down, and the ramp of the acceleration.
    assert motion.duration == pytest.approx(0.9 / 0.5 + 0.5 / 1.2 + RAMP_S, abs=2e-3)
    _, q, qd = dense(motion)
    assert np.abs(qd[:, 0]).max() == pytest.approx(0.5, rel=1e-3)
    assert np.allclose(q[:, 1:], q[0, 1:], atol=1e-3)
    assert np.abs(qd[[0, -1]]).max() < 1e-15
    assert segment.at(0.5).duration == pytest.approx(0.9 / 0.25 + 0.25 / 1.2 + RAMP_S, abs=2e-3)


def test_a_linear_move_stays_on_its_line_at_its_speed() -> None:
    (segment,) = segments("movel(p[-0.45, -0.45, 0.45, 3.1, 0.2, 0.1], a=2, v=0.2)")
    robot, motion = cell().robot, segment.at(1.0)
    t, q, _ = dense(motion)
    poses = robot.pose(q)
    x, begin = poses[:, :3, 3], poses[0, :3, 3]
    way = np.array([-0.45, -0.45, 0.45]) - begin
    along = (x - begin) @ way / np.linalg.norm(way)
    off = x - begin - along[:, None] * way / np.linalg.norm(way)
    assert np.abs(off).max() < 1e-5
    assert np.allclose(poses[-1], transform((-0.45, -0.45, 0.45, 3.1, 0.2, 0.1)), atol=1e-8)
    speed = np.gradient(along, t)
    assert speed.max() == pytest.approx(0.2, rel=2e-3)


@pytest.mark.parametrize("speed", [1.0, 3.0])
def test_a_short_line_speeds_up_as_it_is_told_however_fast_it_is_asked_to_go(speed: float) -> None:
    """At the speed that is asked for joints would be at their limits; none gets there."""
    (line,) = segments(f"movel(p[-0.45, -0.45, 0.45, 3.1, 0.2, 0.1], a=0.5, v={speed})")
    way = float(np.linalg.norm(np.diff(cell().robot.pose(line.at(1.0).position[[0, -1]])[:, :3, 3], axis=0)))
    # From rest to rest with ramps that are rounded: a quarter of the square is what they leave.
    peak = math.sqrt(0.5 * way + (0.5 * RAMP_S / 2) ** 2) - 0.5 * RAMP_S / 2
    assert cell().tool_speed(line.at(1.0)) == pytest.approx(peak, rel=3e-3)


def test_a_move_of_a_given_time_takes_it() -> None:
    text = f"movej({FAR}, t=3)\nmovel(p[-0.45, -0.45, 0.45, 3.1, 0.2, 0.1], a=9, v=9, t=2.5)"
    for segment, time in zip(segments(text), (3.0, 2.5), strict=True):
        for factor in (1.0, 0.5, 1.25):
            assert segment.at(factor).duration == pytest.approx(time / factor, rel=1e-3)
    _, _, qd = dense(segments(text)[0].at(1.0))
    # Nobody says how it speeds up: no motion of that way and time that speeds up evenly gets faster.
    assert np.abs(qd[:, 0]).max() == pytest.approx(2 * 0.9 / 3.0, rel=2e-2)
    (slot,) = segments(text)[1].places()
    assert slot.edit(segments(text)[1].new_value(slot, 0.3)).text == "8.334"
    assert segments(text)[1].max_factor(100.0) <= 2.5 / 0.2


def test_lines_that_the_arm_cannot_follow() -> None:
    q0 = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])
    found = tool_line(cell().robot, q0, transform((3.0, 0, 0, 0, 0, 0)), np.eye(4))
    assert isinstance(found, str)
    assert "cannot follow it beyond" in found


def test_a_blended_corner_is_cut_and_passed_at_speed() -> None:
    (one,) = segments(f"movej({FAR}, v=0.5, r=0.05)\nmovej({HIGH}, v=0.5)")
    stops = segments(f"movej({FAR}, v=0.5)\nmovej({HIGH}, v=0.5)")
    t, q, qd = dense(one.at(1.0))
    corner = stops[0].at(1.0).position[-1]
    nearest = int(np.abs(q - corner).max(axis=1).argmin())
    distance = np.linalg.norm(cell().robot.pose(q[nearest])[:3, 3] - cell().robot.pose(corner)[:3, 3])
    assert 0 < distance < 0.05
    assert 0.2 < t[nearest] / t[-1] < 0.95
    assert np.abs(qd[nearest]).max() > 0.2
    assert one.at(1.0).duration < sum(segment.at(1.0).duration for segment in stops)
    assert one.line_at(0.1, one.at(1.0)) == 1
    assert one.line_at(one.at(1.0).duration, one.at(1.0)) == 2


@pytest.mark.parametrize("ends", ["", "halt\n"])
def test_the_last_move_goes_to_its_end_whatever_its_blend(ends: str) -> None:
    """There is nothing to go over into; its way from where a blend would begin was not judged."""
    exact, blended = (segments(f"movej({FAR}, v=0.5, r=0.1)\nmovej({HIGH}, v=0.5{r})\n{ends}") for r in ("", ", r=0.3"))
    assert len(blended) == 1
    assert (blended[0].at(1.0).position == exact[0].at(1.0).position).all()
    assert blended[0].at(1.0).position[-1] == pytest.approx([0.9, -1.2, 1.4, -1.77, -1.57, 0])


def test_nothing_is_faster_than_its_greatest_factor() -> None:
    (segment,) = segments(f"movej({FAR}, a=60, v=0.5)")
    joints = segment.max_factor(100.0)
    assert joints * 0.5 == pytest.approx(0.98 * math.radians(120), rel=1e-6)
    assert segment.at(2 * joints).duration == pytest.approx(segment.at(joints).duration, rel=1e-3)
    (slow,) = segments(f"movej({FAR}, a=1, v=0.5)")
    most = slow.max_factor(100.0)
    assert 1 < most < joints
    assert slow.at(most).duration == pytest.approx(slow.at(1.5 * most).duration, rel=0.05)
    tool = segment.max_factor(0.6)
    assert cell().tool_speed(segment.at(tool)) == pytest.approx(0.6, rel=0.01)


def test_a_motion_has_limited_jerk_and_an_inverse() -> None:
    motion = PathMotion(2.0, 3.0)
    t = np.linspace(0, motion.duration, 3001)
    u, speed, acceleration = motion.at(t)
    assert speed[[0, -1]] == pytest.approx(0.0, abs=1e-9)
    assert speed.max() <= 1 + 1e-9
    assert np.abs(np.gradient(acceleration, t)).max() <= 1.001 * 3.0 / RAMP_S
    assert np.allclose(motion.times(u[::100])[1:-1], t[::100][1:-1], atol=1e-9)


@pytest.mark.parametrize("rounding", range(-4, 5))
def test_a_motion_of_two_ramps_and_no_more_is_found(rounding: int) -> None:
    """Acceleration and speed are reached at one moment: ``movel`` of 5 mm with a=1, v=0.05, and all with t=0.2."""
    length = 2 * RAMP_S * (1 + rounding * 2.0**-53)
    for acceleration in (1 / RAMP_S, 1 / (length - RAMP_S)):
        motion = PathMotion(length, acceleration)
        assert (motion.duration, motion.top) == pytest.approx((4 * RAMP_S, 1.0), rel=1e-6)


def recorded_moves(t: FloatArray) -> FloatArray:
    """Rest until 0.5 s, away in 1.2 s, back at once in 1 s, rest for 0.8 s, aside in 1.5 s."""
    home = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])
    away, aside = home + np.array([0.4, 0.2, 0, 0, 0, 0]), home + np.array([-0.5, 0, 0.1, 0, 0, 0.3])
    q = bell(home, away, 1.2, t - 0.5)
    back, third = t > 1.7, t > 3.5
    q[back] = bell(away, home, 1.0, t[back] - 1.7)
    q[third] = bell(home, aside, 1.5, t[third] - 3.5)
    return q


def test_segments_of_a_recording_are_found_where_it_rests_or_turns(tmp_path: Path) -> None:
    t = np.arange(0, 5.5, 0.004)
    q = recorded_moves(t) + np.random.default_rng(1).normal(0, 2e-5, (len(t), 6))
    file = tmp_path / "log.csv"
    write_trajectory(file, Trajectory(t, q))
    program = read_recorded(file, cell())
    ends = [(program.time[s.rows[0]], program.time[s.rows[1]]) for s in program.segments]
    for found, planted in zip(ends, [(0.5, 1.7), (1.7, 2.7), (3.5, 5.0)], strict=True):
        assert np.allclose(found, planted, atol=0.13)
    # As it is: the same path in the same time; and its rests are kept.
    rows = np.loadtxt(program.written({}).decode().splitlines(), delimiter=",", skiprows=1)
    kept = np.interp(rows[:, 0], t, q[:, 0])
    assert np.abs(rows[:, 1] - kept).max() < 2e-3
    slower = np.loadtxt(
        program.written(dict.fromkeys(program.segments, 0.5)).decode().splitlines(), delimiter=",", skiprows=1
    )
    assert slower[-1, 0] > rows[-1, 0] + 0.8
    assert np.allclose(slower[-1, 1:7], rows[-1, 1:7], atol=1e-12)


def test_a_segment_timed_anew_follows_the_same_path_from_rest_to_rest() -> None:
    t = np.linspace(0, 1.2, 31)
    home = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])
    q = bell(home, home + np.array([0.5, 0.2, -0.1, 0, 0.3, 0]), 1.2, t)
    assert find_segments(t, q, None) == [(0, 30)]
    segment = TrajectorySegment(
        "s", range(1, 32), (0, 30), cell().robot, t, q, None, cell().joint_acceleration, dense=True
    )
    peak = np.abs(segment.given.at(np.linspace(0, 1.2, 2001), 1)).max(axis=0)
    for factor in (0.3, 0.8):
        times, position, rate = dense(segment.at(factor))
        share = (position[:, 0] - home[0]) / 0.5
        assert np.abs(position - (home + share[:, None] * (q[-1] - q[0]))).max() < 1e-4
        assert np.abs(rate).max(axis=0) == pytest.approx(factor * peak, rel=0.02, abs=1e-6)
        assert np.abs(rate[[0, -1]]).max() < 1e-9
        assert (np.diff(share) > -1e-6).all()
        assert times[-1] == segment.at(factor).duration
    # On a way so short no factor makes the arm faster than this one.
    most = segment.max_factor(100.0)
    fastest = np.abs(dense(segment.at(3 * most))[2]).max()
    assert 1 < most < 1.4
    assert np.abs(dense(segment.at(most))[2]).max() == pytest.approx(fastest, rel=0.03)
    sparse = replace(segment, dense=False)
    assert (sparse.at(0.5).position == q).all()
    # Of a recording it is not known whether it rests at its ends; a message does.
    assert sparse.at(0.5).duration == pytest.approx(segment.at(0.5).duration, rel=1e-4)


def with_speeds(knots: list[tuple[float, float]]) -> TrajectorySegment:
    """A turn of joint 1 whose speed [rad/s] goes straight from knot to knot (s, rad/s)."""
    at, speeds = (np.array(column) for column in zip(*knots, strict=True))
    fine = np.linspace(0.0, at[-1], 20001)
    speed = np.interp(fine, at, speeds)
    turned = np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(fine)))
    t = np.linspace(0.0, at[-1], 101)
    q = np.tile([0.0, -1.57, 1.57, -1.57, -1.57, 0.0], (101, 1))
    q[:, 0] += np.interp(t, fine, turned)
    rate = np.zeros_like(q)
    rate[:, 0] = np.interp(t, at, speeds)
    limits = cell().joint_acceleration
    return TrajectorySegment("s", range(1, 102), (0, 100), cell().robot, t, q, rate, limits, dense=False)


CREEPS = [(0, 0), (0.1, 0.05), (3, 0.05), (3.4, 0.8), (4.9, 0.8), (5.3, 0)]
DIPS = [(0, 0), (0.2, 0.3), (1, 0.3), (1.1, 0.05), (1.5, 0.05), (1.6, 0.3), (2.4, 0.3), (2.6, 0)]


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("factor", [0.3, 0.9, 1.2])
def test_a_slow_begin_or_end_keeps_its_share_of_the_speed(factor: float, backwards: bool) -> None:
    """As an approach: it was taken for getting going, and passed fourteen times as fast in a program slowed down."""
    knots = [(5.3 - t, v) for t, v in reversed(CREEPS)] if backwards else CREEPS
    segment = with_speeds([(float(t), float(v)) for t, v in knots])
    _, q, rate = dense(segment.at(factor))
    turned = np.abs(q[:, 0] - q[-1 if backwards else 0, 0])
    slow = (turned > 0.01) & (turned < 0.14)
    assert slow.sum() > 1000
    assert rate[slow, 0].max() == pytest.approx(0.05 * factor, rel=0.01)


def test_a_begin_that_gets_slower_on_the_way_keeps_its_share_of_the_speed() -> None:
    segment = with_speeds([(0, 0), (0.3, 0.45), (0.4, 0.3), (0.6, 0.8), (2, 0.8), (2.4, 0)])
    motion = segment.at(0.9)
    t = np.linspace(0, motion.duration, 4001)
    turned = motion.at(t)[:, 0]
    # Where the file is slowest, after 0.0675 rad and 0.0375 rad.
    assert motion.at(t, 1)[np.abs(turned - 0.105) < 1e-3, 0].max() == pytest.approx(0.27, rel=0.05)


@pytest.mark.parametrize("knots", [CREEPS, DIPS])
def test_a_speed_that_changes_on_the_way_is_raised_within_the_accelerations(knots: list[tuple[float, float]]) -> None:
    segment, allowed = with_speeds(knots), cell().joint_acceleration
    most = greatest_factor(segment, cell(), 2.0)
    assert most > 1.2
    assert (np.abs(segment.at(most).at(np.linspace(0, segment.at(most).duration, 4001), 2)) < 1.1 * allowed).all()


def test_short_quick_motions_and_slow_ones_are_segments_whole() -> None:
    """A dip of a hundredth of a radian in 60 ms, a slow motion before a quick one, and one that creeps."""
    home = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])
    dip, slow = np.array([0, 0.0095, 0.0095, 0, 0, 0]), np.array([0.3, 0, 0, 0, 0, 0])
    parts = [(slow, 8.0, 21), (0 * dip, 0.5, 3), (dip, 0.06, 13), (0 * dip, 0.5, 3), (4 * slow, 1.2, 21)]
    t, q = np.zeros(1), home[None]
    for way, duration, rows in parts:
        own = np.linspace(0, duration, rows)[1:]
        q = np.concatenate([q, bell(q[-1], q[-1] + way, duration, own)])
        t = np.concatenate([t, t[-1] + own])
    qd = np.gradient(q, t, axis=0)
    qd[[0, 20, 22, 34, 36, 56]] = 0.0
    assert find_segments(t, q, qd) == [(0, 20), (22, 34), (36, 56)]
    t = np.linspace(0, 60, 7501)
    creeping = home + 0.0005 * t[:, None] * (np.arange(6) == 1)
    assert find_segments(t, creeping, None) == [(0, 7500)]
    assert find_segments(t, 0 * creeping, None) == []


def test_contact_without_bound_is_the_hardest() -> None:
    with_bound = _crest(lambda t: np.sin(t), np.arange(4), 1.0)
    assert with_bound[1:] == pytest.approx((math.pi / 2, 1.0), abs=1e-4)
    for begin in (1.0, 1.7):
        _, time, height = _crest(lambda t, begin=begin: np.where(t > begin, np.inf, t), np.arange(4), 1.0)  # type: ignore[misc]
        assert time > begin
        assert height == math.inf
    # Found between the times that are looked at first.
    narrow = _crest(lambda t: np.where(np.abs(t - 1.503) < 2e-3, np.inf, 2 - np.abs(t - 1.5)), np.arange(4), 1.0)
    assert narrow[2] == math.inf
    assert abs(narrow[1] - 1.503) < 3e-3


@pytest.mark.parametrize("radius", [0.005, 0.05, 0.2])
def test_a_corner_at_the_joints_limits_keeps_to_them(radius: float) -> None:
    """A spline through samples swings beyond the rates between them, where these change within a few of them."""
    there, back = "[1.5,-1.5,1.57,-1.4,-1.57,0.3]", "[0.6,-1.2,0.9,-1.4,-1.57,0.3]"
    first = "movej([0.5,-1.5,1.57,-1.4,-1.57,0.3])\n"
    *_, corner = segments(f"{first}movej({there},a=15,v=6,r={radius})\nmovej({back},a=15,v=6)\n")
    motion = corner.at(1.0)
    share = np.abs(motion.extremes(1)[1]) / cell().robot.velocity
    assert 0.97 < share.max() <= 1
    cell().problem(motion)
    # Where no limit is near nothing is slowed down, and rows are as far apart as ever.
    *_, slow = segments(f"{first}movej({there},a=5,v=1,r={radius})\nmovej({back},a=5,v=1)\n")
    assert np.diff(slow.at(1.0).time).max() > 0.019
