"""Robots: what is checked when one is made, the built-in ones, robot files and names."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bumpstop.errors import InputError
from bumpstop.model import Joint, Robot, robot_from_dict, robots, rotation_from_rpy


def joint(**changes: Any) -> Joint:
    return Joint(**{"name": "elbow", "link": "forearm", **changes})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": "fixed"}, r"^joint 'elbow' kind: 'fixed' is no kind of joint; valid: revolute, prismatic$"),
        ({"axis": (0.0, 0.0, 2.0)}, r"^joint 'elbow' axis: .* has length 2; wanted a unit vector$"),
        ({"axis": (0.0, 0.0, 0.0)}, r"^joint 'elbow' axis: .* has length 0; "),
        ({"axis": (0.0, 1.0)}, r"^joint 'elbow' axis: has shape \(2,\); wanted \(3,\)$"),
        ({"axis": (0.0, math.nan, 1.0)}, r"^joint 'elbow' axis\[1\]: is nan; "),
        ({"origin": (0.0, 0.0)}, r"^joint 'elbow' origin: has shape \(2,\)"),
        ({"origin": (0.0, math.inf, 0.0)}, r"^joint 'elbow' origin\[1\]: is inf; "),
        ({"origin": "abc"}, r"^joint 'elbow' origin: values of type"),
        ({"rotation": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))}, r"^joint 'elbow' rotation: has shape \(2, 3\)"),
        ({"rotation": np.diag([1.0, 1.0, -1.0])}, r"^joint 'elbow' rotation: is not a rotation matrix$"),
        ({"rotation": np.diag([1.0, 1.0, 1.001])}, r"^joint 'elbow' rotation: is not a rotation matrix$"),
        ({"lower": 1.0, "upper": 1.0}, r"^joint 'elbow' limits: lower 1\.0 is not below upper 1\.0$"),
        ({"lower": math.nan}, r"^joint 'elbow' limits: lower nan is not below"),
        ({"upper": math.nan}, r"^joint 'elbow' limits: .* is not below upper nan"),
        ({"velocity": 0.0}, r"^joint 'elbow' velocity: 0\.0 is not a positive limit$"),
        ({"velocity": -1.0}, r"^joint 'elbow' velocity: -1\.0 "),
        ({"velocity": math.nan}, r"^joint 'elbow' velocity: nan "),
    ],
)
def test_joints_that_cannot_be(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        joint(**changes)


def test_joint_limits_may_be_absent() -> None:
    assert joint().lower == -math.inf
    assert joint().upper == math.inf
    assert joint().velocity == math.inf


def robot(joints: tuple[Joint, ...], **changes: Any) -> Robot:
    return Robot(**{"name": "arm", "joints": joints, **changes})


def test_robots_that_cannot_be() -> None:
    with pytest.raises(InputError, match=r"^joints: 0 of them; wanted 1 to 16$"):
        robot(())
    many = tuple(joint(name=f"j{i}", link=f"l{i}") for i in range(17))
    with pytest.raises(InputError, match=r"^joints: 17 of them; wanted 1 to 16$"):
        robot(many)
    with pytest.raises(InputError, match=r"^joint names: 'elbow' occurs twice$"):
        robot((joint(link="a"), joint(link="b")))
    with pytest.raises(InputError, match=r"^link names: 'forearm' occurs twice$"):
        robot((joint(name="a"), joint(name="b")))
    with pytest.raises(InputError, match=r"^tip_origin\[2\]: is nan"):
        robot((joint(),), tip_origin=(0.0, 0.0, math.nan))
    with pytest.raises(InputError, match=r"^tip_origin: has shape \(2,\)"):
        robot((joint(),), tip_origin=(0.0, 0.0))


def test_robots_do_not_change() -> None:
    arm = Robot.load("sia5d")
    with pytest.raises(dataclasses.FrozenInstanceError):
        arm.name = "other"  # type: ignore[misc]
    with pytest.raises(dataclasses.FrozenInstanceError):
        arm.joints[0].lower = 0.0  # type: ignore[misc]
    arm.lower[0] = 7.0
    assert arm.lower[0] == -math.pi
    assert Robot.load("sia5d") is arm


def test_builtin_robots() -> None:
    assert robots() == ("sia5d", "ur10e")
    for name in robots():
        arm = Robot.load(name)
        assert arm.name == name
        assert arm.title
        assert arm.source
        assert arm.note
        assert (arm.lower < 0).all()
        assert (arm.upper > 0).all()
        assert np.isfinite([*arm.lower, *arm.upper, *arm.velocity]).all()
    sia5d, ur10e = Robot.load("sia5d"), Robot.load("ur10e")
    assert (sia5d.dof, sia5d.payload_kg) == (7, 5.0)
    assert (ur10e.dof, ur10e.payload_kg) == (6, 12.5)
    np.testing.assert_allclose(np.rad2deg(sia5d.velocity), [200, 200, 200, 200, 200, 230, 350])
    np.testing.assert_allclose(np.rad2deg(sia5d.lower), [-180, -110, -170, -90, -180, -110, -180])
    np.testing.assert_allclose(np.rad2deg(sia5d.upper), [180, 110, 170, 115, 180, 110, 180])
    np.testing.assert_allclose(np.rad2deg(ur10e.velocity), [120, 120, 180, 180, 180, 180])
    np.testing.assert_allclose(np.rad2deg(ur10e.upper), [360] * 6)


def test_nothing_reaches_farther_than_the_span() -> None:
    rng = np.random.default_rng(1)
    for name in robots():
        arm = Robot.load(name)
        q = rng.uniform(arm.lower, arm.upper, (2000, arm.dof))
        shoulder = arm.pose(q, arm.joints[1].link)[:, :3, 3]
        distance = np.linalg.norm(arm.pose(q)[:, :3, 3] - shoulder, axis=1)
        assert 0.7 * arm.span < distance.max() < arm.span + 1e-12


def test_span_counts_what_a_slide_travels() -> None:
    arm = robot(
        (
            joint(name="a", link="a"),
            joint(name="b", link="b", axis=(1.0, 0.0, 0.0)),
            joint(name="c", link="c", kind="prismatic", lower=0.0, upper=2.0),
        ),
        tip_origin=(0.0, 0.0, 0.1),
    )
    assert np.linalg.norm(arm.pose([0.0, 0.0, 2.0])[:3, 3]) <= arm.span


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("sia5", r"^robot: there is no built-in robot 'sia5'; did you mean 'sia5d'\?$"),
        ("UR10e", r"^robot: there is no built-in robot 'UR10e'; did you mean 'ur10e'\?$"),
        ("", r"^robot: there is no built-in robot ''; valid: sia5d, ur10e$"),
        ("../data/sia5d", r"^robot: there is no built-in robot '\.\./data/sia5d'; "),
    ],
)
def test_unknown_robot(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Robot.load(name)


def test_links_are_found_by_name() -> None:
    arm = Robot.load("sia5d")
    assert arm.frame("link_u", (0.1, 0.2, 0.3))[0] == 3
    assert arm.frame("link_u", (0.1, 0.2, 0.3))[1].tolist() == [0.1, 0.2, 0.3]
    for tip in (None, "tool0"):
        number, point = arm.frame(tip, (0.1, 0.0, 0.0))
        assert number == 6
        np.testing.assert_allclose(point, [0.111, 0.0, 0.0], rtol=1e-15)
    with pytest.raises(InputError, match=r"^link: sia5d has no link 'link_w'; did you mean 'link_"):
        arm.frame("link_w")
    with pytest.raises(InputError, match=r"^link: sia5d has no link 'gripper'; valid: link_s, .*, link_t, tool0$"):
        arm.pose(np.zeros(7), "gripper")


FILE: dict[str, Any] = {
    "name": "gantry",
    "tip": {"name": "nozzle", "origin_m": [0, 0, -0.1]},
    "joint": [
        {
            "name": "x",
            "link": "carriage",
            "kind": "prismatic",
            "origin_m": [0.0, 0.0, 2.0],
            "axis": [1, 0, 0],
            "lower_m": -1,
            "upper_m": 1.5,
            "velocity_m_s": 0.5,
        },
        {
            "name": "c",
            "link": "wrist",
            "origin_m": [0.0, 0.25, 0.0],
            "rpy_deg": [10, 20, 30],
            "axis": [0, 0, 1],
            "lower_deg": -90,
            "upper_deg": 180,
            "velocity_deg_s": 360,
        },
    ],
}


def test_robot_file() -> None:
    arm = robot_from_dict(FILE)
    assert (arm.name, arm.tip_name, arm.tip_origin) == ("gantry", "nozzle", (0.0, 0.0, -0.1))
    assert (arm.title, arm.source, arm.note, arm.payload_kg) == ("", "", "", None)
    assert [j.kind for j in arm.joints] == ["prismatic", "revolute"]
    assert [j.link for j in arm.joints] == ["carriage", "wrist"]
    np.testing.assert_allclose(arm.lower, [-1.0, -math.pi / 2])
    np.testing.assert_allclose(arm.upper, [1.5, math.pi])
    np.testing.assert_allclose(arm.velocity, [0.5, 2 * math.pi])
    tilt = Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_matrix()
    pose = arm.pose([0.7, 0.0])
    np.testing.assert_allclose(pose[:3, :3], tilt, rtol=0, atol=1e-15)
    np.testing.assert_allclose(pose[:3, 3], np.array([0.7, 0.25, 2.0]) - 0.1 * tilt[:, 2], rtol=0, atol=1e-15)


def test_bad_figures_in_a_robot_file_are_named() -> None:
    with pytest.raises(InputError, match=r"^joint 'x' axis: .* has length 2"):
        robot_from_dict({**FILE, "joint": [{**FILE["joint"][0], "axis": [2, 0, 0]}]})
    with pytest.raises(InputError, match=r"^joint 'c' limits: "):
        robot_from_dict({**FILE, "joint": [{**FILE["joint"][1], "lower_deg": 200}]})


def test_roll_pitch_and_yaw() -> None:
    for angles in np.random.default_rng(2).uniform(-math.pi, math.pi, (50, 3)):
        expected = Rotation.from_euler("xyz", angles).as_matrix()
        np.testing.assert_allclose(rotation_from_rpy(*angles), expected, rtol=0, atol=1e-15)
