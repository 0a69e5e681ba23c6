"""Robots: what is checked when one is made, the built-in ones, robot files and names."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bumpstop.errors import InputError
from bumpstop.model import Frame, Joint, Robot, robot_from_dict, robots, rotation_from_rpy


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
        ({"lower": "x"}, r"^joint 'elbow' lower: 'x' is not a number$"),
        ({"upper": None}, r"^joint 'elbow' upper: None is not a number$"),
        ({"velocity": True}, r"^joint 'elbow' velocity: True is not a number$"),
        ({"rotor_inertia": "1"}, r"^joint 'elbow' rotor_inertia: '1' is not a number$"),
        ({"rotor_inertia": -1.0}, r"^joint 'elbow' rotor_inertia: is -1.0; wanted zero or more$"),
        ({"name": 3}, r"^joint name: 3 is no name; wanted text on one line$"),
        ({"link": ""}, r"^joint 'elbow' link: '' is no name; wanted text on one line$"),
        ({"link": " "}, r"^joint 'elbow' link: ' ' is no name; wanted text on one line$"),
        ({"name": "a\nb"}, r"^joint name: 'a\\nb' is no name; wanted text on one line$"),
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
    with pytest.raises(InputError, match=r"^tip_rotation: is not a rotation matrix$"):
        robot((joint(),), tip_rotation=np.zeros((3, 3)))
    with pytest.raises(InputError, match=r"^inertia_status: 'guessed' is none; valid: published, unverified"):
        robot((joint(),), inertia_status="guessed")
    with pytest.raises(InputError, match=r"^joint 'elbow' inertia: is missing, and inertia_status is \"published\"; "):
        robot((joint(),), inertia_status="published")


def test_every_frame_can_be_named() -> None:
    for tip in ("forearm", "plate"):
        with pytest.raises(InputError, match=rf"^tip name: '{tip}' is the name of a link, too; give the tip another"):
            robot((joint(),), tip_name=tip, tip_origin=(0.0, 0.0, 0.1), frames=(Frame(name="plate", link=0),))
    with pytest.raises(InputError, match=r"^link names: 'forearm' occurs twice$"):
        robot((joint(),), frames=(Frame(name="forearm", link=0),))
    with pytest.raises(InputError, match=r"^frame 'plate' link: 1 is no link; wanted 0 to 0$"):
        robot((joint(),), frames=(Frame(name="plate", link=1),))
    # The tip may be the last link itself: there is nothing to confuse.
    assert robot((joint(),), tip_name="forearm").frame("forearm")[0] == 0


def test_axes_count_by_their_direction_alone() -> None:
    straight, long = (robot((joint(axis=(0.0, 0.0, length)), joint(name="b", link="b"))) for length in (1.0, 1 + 5e-10))
    np.testing.assert_array_equal(straight.pose([3.0, 1.0]), long.pose([3.0, 1.0]))


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
    assert robots() == ("iiwa14", "panda", "sia5d", "ur10", "ur10e", "ur3e", "ur5e")
    for name in robots():
        arm = Robot.load(name)
        assert arm.name == name
        assert arm.title
        assert arm.source
        assert arm.note
        assert (arm.lower < arm.upper).all()
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
        assert 0.65 * arm.span < distance.max() < arm.span + 1e-12


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
        ("UR10e", r"^robot: there is no built-in robot 'UR10e'; did you mean 'ur10e'"),
        ("", r"^robot: there is no built-in robot ''; valid: iiwa14, panda, sia5d, "),
        ("../data/sia5d", r"^robot: there is no built-in robot '\.\./data/sia5d'; "),
    ],
)
def test_unknown_robot(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Robot.load(name)


def test_a_point_beyond_any_arm_is_refused() -> None:
    robot = Robot.load("sia5d")
    assert robot.pose(np.zeros(7), "link_t", [100, 0, 0]).shape == (4, 4)
    with pytest.raises(InputError, match=r"^point: is 0,1e\+300,0; wanted from -100 to 100 m along each axis$"):
        robot.jacobian(np.zeros(7), point=(0, 1e300, 0))


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
    with pytest.raises(InputError, match=r"^link: sia5d has no link 3; valid: link_s, "):
        arm.frame(3)  # type: ignore[arg-type]
    # A tip may be a link itself.
    with pytest.raises(InputError, match=r"; valid: forearm$"):
        robot((joint(),), tip_name="forearm").frame("gripper")


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


INERTIA: dict[str, Any] = {"mass_kg": 2, "center_m": [0, 0.1, 0], "inertia_kg_m2": [0.3, 0.2, 0.25, 0.01, 0.02, 0.03]}


def test_inertia_in_a_robot_file() -> None:
    rotor = {"rotor_inertia_kg_m2": 0.4}
    arm = robot_from_dict({**FILE, "joint": [FILE["joint"][0], {**FILE["joint"][1], **INERTIA, **rotor}]})
    assert arm.joints[0].inertia is None
    inertia = arm.joints[1].inertia
    assert inertia is not None
    assert (inertia.mass, inertia.center, arm.joints[1].rotor_inertia) == (2.0, (0.0, 0.1, 0.0), 0.4)
    assert inertia.tensor == ((0.3, 0.01, 0.02), (0.01, 0.2, 0.03), (0.02, 0.03, 0.25))
    assert (arm.inertia_status, arm.inertia_source) == ("unknown", "")
    joints = [{**one, **INERTIA} for one in FILE["joint"]]
    arm = robot_from_dict({**FILE, "joint": joints, "inertia_status": "assumed", "inertia_source": "a guess"})
    assert (arm.inertia_status, arm.inertia_source) == ("assumed", "a guess")


def first(**changes: Any) -> dict[str, Any]:
    """The file with keys of its first joint changed, or left out (None)."""
    joint = {key: value for key, value in {**FILE["joint"][0], **changes}.items() if value is not None}
    return {**FILE, "joint": [joint, FILE["joint"][1]]}


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({**FILE, "payload": 3}, r"^payload: is not a key of a robot file; did you mean 'payload_kg'\?$"),
        ({key: value for key, value in FILE.items() if key != "name"}, r"^name: is missing$"),
        ({key: value for key, value in FILE.items() if key != "tip"}, r"^tip: is missing$"),
        ({key: value for key, value in FILE.items() if key != "joint"}, r"^joint: is missing$"),
        ({**FILE, "tip": 5}, r"^tip: 5 is not a table; wanted \[tip\]$"),
        (
            {**FILE, "tip": {"name": "t", "orign_m": [0, 0, 0]}},
            r"^tip.orign_m: is not a key .* mean 'origin_m'",
        ),
        ({**FILE, "joint": 5}, r"^joint: is not a list of tables; wanted one \[\[joint\]\]"),
        ({**FILE, "joint": [5]}, r"^joint\[1\]: is not a table; wanted \[\[joint\]\]$"),
        ({**FILE, "title": 5}, r"^title: 5 cannot be used; wanted text$"),
        ({**FILE, "payload_kg": -1}, r"^payload_kg: is -1; wanted zero or more$"),
        ({**FILE, "payload_kg": "5 kg"}, r"^payload_kg: '5 kg' is not a number$"),
        ({**FILE, "inertia_status": "sure"}, r"^inertia_status: 'sure' is none; valid: published"),
        (first(axis=None), r"^joint\[1\].axis: is missing$"),
        (first(axs=[1, 0, 0]), r"^joint\[1\].axs: is not a key of a robot file; did you mean 'axis'"),
        (first(kind="sliding"), r"^joint\[1\].kind: 'sliding' is no kind of joint; valid: revolute, prismatic$"),
        (first(kind=[]), r"^joint\[1\].kind: \[\] is no kind of joint"),
        (first(lower_deg=3), r"^joint\[1\].lower_deg: is not a key of a robot file; did you mean 'lower_m'"),
        (first(lower_m="a"), r"^joint\[1\].lower_m: 'a' is not a number$"),
        (first(lower_m=10**400), r"^joint\[1\].lower_m: is inf; wanted a finite number$"),
        (first(origin_m=[1, 2]), r"^joint\[1\].origin_m: has shape \(2,\); wanted \(3,\)$"),
        (first(rpy_deg="a"), r"^joint\[1\].rpy_deg: values of type"),
        (first(name=5), r"^joint\[1\].name: 5 cannot be used; wanted text$"),
        (first(mass_kg=2), r"^joint\[1\].inertia_kg_m2: is missing$"),
        (first(**{**INERTIA, "mass_kg": -2}), r"^joint\[1\].mass_kg: -2.0 kg; wanted zero or more$"),
        (
            first(**{**INERTIA, "inertia_kg_m2": [-1, 1, 1, 0, 0, 0]}),
            r"^joint\[1\].inertia_kg_m2: has a negative princip",
        ),
        (first(rotor_inertia_kg_m2=1), r"^joint\[1\].rotor_inertia_kg_m2: is not .* did you mean 'rotor_inertia_kg'"),
    ],
)
def test_robot_files_that_cannot_be_read(data: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        robot_from_dict(data)


def test_roll_pitch_and_yaw() -> None:
    for angles in np.random.default_rng(2).uniform(-math.pi, math.pi, (50, 3)):
        expected = Rotation.from_euler("xyz", angles).as_matrix()
        np.testing.assert_allclose(rotation_from_rpy(*angles), expected, rtol=0, atol=1e-15)


def test_a_joint_on_its_limit_is_not_beyond_it_by_rounding() -> None:
    robot = Robot.load("ur10e")
    q = np.tile(robot.upper, (5, 1))
    q[1] = np.nextafter(robot.upper, np.inf)
    q[2, 5] += 1e-8
    q[3] = robot.lower - 1e-12
    q[4, 0] = math.nan
    beyond = robot.beyond_limits(q)
    assert beyond.shape == q.shape
    assert np.argwhere(beyond).tolist() == [[2, 5], [4, 0]]
