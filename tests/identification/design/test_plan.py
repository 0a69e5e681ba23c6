"""The plan of the protocol: limits, floor and gravity checked by other means than those that made it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.trajectory.trajectory import load_motion
from bumpstop.collision.trajectory.trajectory_file import read_rows
from bumpstop.identification.design.clearance import Clearance, usable_joint_range
from bumpstop.identification.design.gravity_pose import Unobservable, find_gravity_pose
from bumpstop.identification.design.plan import IdentificationPlan, ProtocolSettings, plan_identification
from bumpstop.identification.design.plan_file import load_plan, save_plan
from bumpstop.identification.design.timed_path import TimedPath
from bumpstop.identification.design.trajectory_files import joint_trajectory, trajectory_csv

SHORT = ProtocolSettings(repeats=1, ramp_repeats=1, holds=1, hold_s=4.0)
EARTH = (0.0, 0.0, -9.80665)


@pytest.fixture(scope="module")
def plans() -> dict[str, IdentificationPlan]:
    return {name: plan_identification(bs.Robot.load(name), SHORT) for name in ("ur10e", "sia5d", "panda")}


def every_5_ms(path: TimedPath) -> tuple[np.ndarray, ...]:
    return path.at(np.arange(0.0, path.duration, 0.005))


@pytest.mark.parametrize("name", ["ur10e", "sia5d", "panda"])
def test_trajectories_keep_to_limits_and_floor(name: str, plans: dict[str, IdentificationPlan]) -> None:
    """Sampled every 5 ms, with differences of the positions as the second route to speed and acceleration."""
    plan = plans[name]
    robot = plan.robot
    assert plan.experiments
    for experiment in plan.experiments:
        q, qd, qdd = every_5_ms(plan.path(experiment))
        assert ((q >= robot.lower) & (q <= robot.upper)).all()
        assert (np.abs(qd) <= robot.velocity * (1 + 1e-9)).all()
        assert np.abs(qdd).max() <= SHORT.acceleration * (1 + 1e-9)
        # The mean speed over a step differs from the speed by at most half a step's acceleration.
        assert np.abs(np.diff(q, axis=0) / 0.005 - qd[:-1]).max() <= 0.0025 * SHORT.acceleration * 1.01
        assert np.abs(np.diff(qd, axis=0)).max() <= 0.005 * SHORT.acceleration * 1.001
        for joint in robot.joints[2:]:
            assert robot.pose(q[::10], joint.link)[:, 2, 3].min() > 0.08
        assert robot.pose(q[::10])[:, 2, 3].min() > 0.08


@pytest.mark.parametrize("name", ["ur10e", "sia5d", "panda"])
@pytest.mark.parametrize("shares", [(0.05, 0.08), (0.1, 0.25)])
def test_nothing_is_faster_than_the_fastest_speed_asked_for(
    name: str, shares: tuple[float, ...], plans: dict[str, IdentificationPlan]
) -> None:
    """Neither ramps nor ways between strokes nor swings: whoever asks for slow strokes means all that the arm does."""
    plan = plans[name]
    slow = replace(plan, settings=replace(SHORT, speed_shares=shares), experiments=tuple(
        replace(one, speeds=tuple(share * plan.robot.joints[one.joint].velocity for share in shares))
        for one in plan.experiments
    ))  # fmt: skip
    for experiment in slow.experiments:
        _, qd, _ = every_5_ms(slow.path(experiment))
        assert (np.abs(qd) <= shares[-1] * plan.robot.velocity * (1 + 1e-9)).all()
        assert np.abs(qd[:, experiment.joint]).max() > 0.99 * shares[-1] * plan.robot.joints[experiment.joint].velocity


@pytest.mark.parametrize("name", ["ur10e", "sia5d", "panda"])
def test_gravity_turns_round_inside_the_stroke(name: str, plans: dict[str, IdentificationPlan]) -> None:
    """Newton-Euler over the stroke: the torque falls through zero once, as far as on the other side."""
    for experiment in plans[name].experiments:
        pose = np.repeat(experiment.pose[None], 101, axis=0)
        pose[:, experiment.joint] = np.linspace(experiment.low, experiment.high, 101)
        still = np.zeros_like(pose)
        torque = bs.model.inverse_dynamics(plans[name].robot, pose, still, still)[:, experiment.joint]
        assert abs(torque[50]) < 1e-6 * np.abs(torque).max()
        assert torque[0] * torque[-1] < 0
        assert min(abs(torque[0]), abs(torque[-1])) >= SHORT.min_torque
        np.testing.assert_allclose([torque[0], torque[-1]], [experiment.torque_low, experiment.torque_high])


def test_the_pose_is_the_best_of_a_finer_search(plans: dict[str, IdentificationPlan]) -> None:
    """Random poses, judged by Newton-Euler on a grid, find no joint torque on both sides that is much larger."""
    plan = plans["sia5d"]
    robot = plan.robot
    rng = np.random.default_rng(5)
    for experiment in plan.experiments[:2]:
        best = 0.0
        for _ in range(300):
            pose = np.repeat(rng.uniform(robot.lower, robot.upper)[None], 61, axis=0)
            pose[:, experiment.joint] = np.linspace(robot.lower[experiment.joint], robot.upper[experiment.joint], 61)
            torque = bs.model.gravity_torque(robot, pose)[:, experiment.joint]
            best = max(best, min(torque.max(), -torque.min()))
        assert min(abs(experiment.torque_low), abs(experiment.torque_high)) > 0.9 * best


def test_joints_that_gravity_cannot_show_are_named(plans: dict[str, IdentificationPlan]) -> None:
    for name, joints in (("sia5d", ["joint_s", "joint_t"]), ("ur10e", ["shoulder_pan_joint", "wrist_3_joint"])):
        unobservable = plans[name].unobservable
        assert [lost.name for lost in unobservable] == joints
        assert "vertical" in unobservable[0].reason
        assert "tilted base" in unobservable[0].remedy
        assert "near its axis" in unobservable[1].reason
        assert "load" in unobservable[1].remedy


def test_tilted_base_and_load_show_them() -> None:
    tilted = ProtocolSettings(gravity=(0.0, 6.93, -6.93), load_kg=3.0, load_m=(0.1, 0.0, 0.05), floor=None)
    plan = plan_identification(bs.Robot.load("ur10e"), tilted)
    assert {0, 5} <= {experiment.joint for experiment in plan.experiments}


def test_load_is_what_another_physics_weighs() -> None:
    """The loaded arm's gravity torque is the bare arm's plus J' m g at the load."""
    robot = bs.Robot.load("ur5e")
    plan = IdentificationPlan(
        robot=robot,
        settings=ProtocolSettings(load_kg=2.0, load_m=(0.1, 0.0, 0.05)),
        home=np.zeros(6),
        experiments=(),
    )
    q = np.random.default_rng(1).uniform(-2, 2, size=(20, 6))
    jacobian = robot.jacobian(q, None, (0.1, 0.0, 0.05))[:, 2]
    expected = bs.model.gravity_torque(robot, q) + 2.0 * 9.80665 * jacobian
    np.testing.assert_allclose(bs.model.gravity_torque(plan.loaded, q), expected, rtol=1e-9, atol=1e-9)


def test_what_leaves_no_way_is_said() -> None:
    robot = bs.Robot.load("ur5e")
    found = find_gravity_pose(robot, 1, Clearance(robot, floor=0.6), gravity=EARTH)
    assert isinstance(found, Unobservable)
    assert "clear of the floor" in found.reason
    with pytest.raises(bs.InputError, match="no pose of ur5e is clear"):
        plan_identification(robot, ProtocolSettings(floor=3.0))


@pytest.mark.parametrize(
    ("limits", "usable"),
    [
        ((3.3, 6.1), (3.3, 6.1)),
        ((-6.1, -3.3), (-6.1, -3.3)),
        ((3.0, 6.1), (3.0, 6.1)),
        ((2.0, 20.0), (2.0, 2.0 + 2 * np.pi)),
        ((-20.0, -2.0), (-2.0 - 2 * np.pi, -2.0)),
        ((-2.0, 2.5), (-2.0, 2.5)),
        ((-0.02, 3.75), (-0.02, np.pi)),  # most of it lies within half a turn
        ((-2 * np.pi, 2 * np.pi), (-np.pi, np.pi)),
        ((-np.inf, np.inf), (-np.pi, np.pi)),
    ],
)
def test_ranges_beyond_half_a_turn_are_used(limits: tuple[float, float], usable: tuple[float, float]) -> None:
    robot = bs.Robot.load("ur5e")
    third = replace(robot.joints[2], lower=limits[0], upper=limits[1])
    low, high = usable_joint_range(replace(robot, joints=(*robot.joints[:2], third, *robot.joints[3:])))
    np.testing.assert_allclose((low[2], high[2]), usable)


def test_a_joint_beyond_half_a_turn_is_planned() -> None:
    """The elbow counted from a turn before: the same arm, and the same stroke a turn farther."""
    robot = bs.Robot.load("ur5e")
    settings = replace(SHORT, floor=None)

    def plan(turn: float) -> IdentificationPlan:
        elbow = replace(robot.joints[2], lower=turn - 2.5, upper=turn + 2.5)
        return plan_identification(replace(robot, joints=(*robot.joints[:2], elbow, *robot.joints[3:])), settings)

    plain, turned = plan(0.0), plan(4 * np.pi)
    assert [one.joint for one in turned.experiments] == [one.joint for one in plain.experiments]
    for experiment in turned.experiments:
        q, _, _ = every_5_ms(turned.path(experiment))
        assert (np.abs(q[:, 2] - 4 * np.pi) < 2.5).all()
    one, other = plain.experiments[1], turned.experiments[1]
    assert one.joint == 2
    assert other.high - other.low == pytest.approx(one.high - one.low, abs=0.3)


def test_capsules_keep_the_distance_that_mujoco_finds() -> None:
    """Least distances between capsules, against MuJoCo's geometry."""
    rng = np.random.default_rng(2)
    from bumpstop.identification.design.clearance import _segment_distance

    for _ in range(20):
        a0, a1, b0, b1 = rng.uniform(-1, 1, size=(4, 3))
        text = " ".join(
            f'<geom type="capsule" size="0.01" fromto="{" ".join(map(str, [*p, *q]))}"/>'
            for p, q in ((a0, a1), (b0, b1))
        )
        model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{text}</worldbody></mujoco>")
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        apart = mujoco.mj_geomDistance(model, data, 0, 1, 10.0, None) + 0.02
        ours = _segment_distance(a0[None], a1[None], b0[None], b1[None])[0]
        assert ours == pytest.approx(apart, abs=1e-5)


def test_files_repeat_the_plan(tmp_path: Path, plans: dict[str, IdentificationPlan]) -> None:
    plan = plans["ur10e"]
    file = tmp_path / "plan.toml"
    save_plan(plan, file, robot={"robot": "ur10e"})
    again = load_plan(file)
    assert again.settings == plan.settings
    assert again.unobservable == plan.unobservable
    for one, other in zip(plan.experiments, again.experiments, strict=True):
        a, b = plan.path(one), again.path(other)
        np.testing.assert_allclose(a.q, b.q, atol=1e-9)
        np.testing.assert_allclose(a.t, b.t, atol=1e-6)


@pytest.mark.parametrize(("intervals", "times"), [(3.0, [0, 0.1, 0.2, 0.3]), (3.5, [0, 0.1, 0.2, 0.3, 0.35])])
def test_an_even_rate_ends_with_the_path_and_names_no_time_twice(intervals: float, times: list[float]) -> None:
    """Three tenths, as sums of tenths have it, are more than 0.3 by a rounding."""
    corners = np.array([0.0, 0.1 * intervals])
    path = TimedPath(corners, np.array([[0.0], [1.0]]), np.zeros((2, 1)), np.zeros((2, 1)))
    even = path.sampled(10.0)
    np.testing.assert_allclose(even.t, times, rtol=1e-12)
    assert (even.t[-1], even.q[-1, 0]) == (path.duration, 1.0)


def test_trajectory_files_are_read_back_as_the_same_motion(
    tmp_path: Path, plans: dict[str, IdentificationPlan]
) -> None:
    plan = plans["ur10e"]
    path = plan.path(plan.experiments[0])
    names = [joint.name for joint in plan.robot.joints]
    (tmp_path / "joint.csv").write_text(trajectory_csv(path, 50.0))
    (tmp_path / "joint.json").write_text(joint_trajectory(path, names))
    for name in ("joint.csv", "joint.json"):
        rows = read_rows(tmp_path / name, plan.robot)
        q, qd, _ = path.at(rows.time)
        np.testing.assert_allclose(rows.position, q, atol=1e-7)
        np.testing.assert_allclose(rows.velocity, qd, atol=1e-6)
        assert rows.time[-1] == pytest.approx(path.duration, abs=1e-6)


@pytest.mark.parametrize(("name", "rate"), [("ur10e", 20.0), ("ur10e", 500.0), ("panda", 50.0), ("iiwa14", 50.0)])
def test_planned_rows_are_within_limits_as_they_are_read(name: str, rate: float, tmp_path: Path) -> None:
    """Strokes at all of a joint's speed: a curve through the rows may pass what they keep."""
    robot = bs.Robot.load(name)
    plan = plan_identification(robot, ProtocolSettings(speed_shares=(0.5, 1.0), repeats=1, ramp_repeats=1, holds=0))
    for experiment in plan.experiments:
        (tmp_path / "joint.csv").write_text(trajectory_csv(plan.path(experiment), rate))
        assert load_motion(tmp_path / "joint.csv", robot).duration < 120


def test_damaged_plans_are_refused(tmp_path: Path, plans: dict[str, IdentificationPlan]) -> None:
    file = tmp_path / "plan.toml"
    save_plan(plans["ur10e"], file, robot={"robot": "ur10e"})
    sound = file.read_text()
    for spoil, message in (
        (lambda text: text.replace("identification_plan", "other"), "is no plan"),
        (lambda text: text.replace("repeats = 1", "repeat = 1", 1), "unknown key 'repeat'"),
        (lambda text: text.replace("hold_s = 4.0", "hold_s = nan"), "finite"),
        (lambda text: text.replace("joint = 2", "joint = 9", 1), "9 is none of ur10e"),
        (lambda text: text.replace("low_deg = -", "low_deg = -9", 1), "low_deg"),
        (lambda text: text.replace("speeds_deg_s = [", "speeds_deg_s = [900, ", 1), "at most 120"),
        (lambda text: text.replace("too_fast_percent = [", f"too_fast_percent = [{10**400}, ", 1), "too_fast_percent"),
        (lambda text: text.replace("home = [", "home = [1000, ", 1), "home"),
        (lambda text: text.replace("pose = [0.0", "pose = [999.0", 1), "outside its limits"),
        (lambda text: text.replace("swing_deg", "swing", 1), "unknown key 'swing'"),
        (lambda text: text.replace("-9.80665", "-1.0", 1), "gravity: is 1 m/s2 in all"),
        (lambda text: text[:60], "not valid TOML|has no key"),
    ):
        file.write_text(spoil(sound))
        with pytest.raises(bs.InputError, match=message):
            load_plan(file)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"speed_shares": (0.1, 1.2)}, "at most 1"),
        ({"repeats": 0}, "repeats"),
        ({"acceleration": float("nan")}, "acceleration"),
        ({"floor": float("inf")}, "floor"),
        ({"gravity": (0.0, 0.0, 0.0)}, "gravity: is 0 m/s2 in all; wanted X,Y,Z of 9.7 to 9.9 in all"),
        ({"gravity": (0.0, 0.0, -1.0)}, "gravity: is 1 m/s2 in all"),
        ({"gravity": (0.0, 0.0, -980.0)}, "gravity: is 980 m/s2 in all"),
        ({"gravity": (0.0, float("nan"), -9.8)}, "gravity: is nan m/s2 in all"),
        ({"load_m": (0.0, float("nan"), 0.1)}, "load_m: is not finite"),
    ],
)
def test_settings_that_make_no_sense(settings: dict[str, object], message: str) -> None:
    with pytest.raises(bs.InputError, match=message):
        ProtocolSettings(**settings)  # type: ignore[arg-type]
