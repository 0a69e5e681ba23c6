"""The figures of the built-in robots, typed a second time from where they come."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from bumpstop.model import Robot, robots

Floats = npt.NDArray[np.float64]
PI = math.pi

UR10_CENTERS = [
    *([0.021, 0, 0.027], [0.38, 0, 0.158], [0.24, 0, 0.068]),
    *([0, 0.007, 0.018], [0, 0.007, 0.018], [0, 0, -0.026]),
]
# a, d; masses and centres of mass in the frame behind each joint's parameters; payload, speeds in deg/s.
UR: dict[str, dict[str, Any]] = {
    "ur3e": {
        "a": [0, -0.24355, -0.2132, 0, 0, 0],
        "d": [0.15185, 0, 0, 0.13105, 0.08535, 0.0921],
        "mass": [1.98, 3.4445, 1.437, 0.871, 0.805, 0.261],
        "center": [[0, -0.02, 0], [0.13, 0, 0.1157], [0.05, 0, 0.0238], [0, 0, 0.01], [0, 0, 0.01], [0, 0, -0.02]],
        "payload": 3.0,
        "speed": [180, 180, 180, 360, 360, 360],
    },
    "ur5e": {
        "a": [0, -0.425, -0.3922, 0, 0, 0],
        "d": [0.1625, 0, 0, 0.1333, 0.0997, 0.0996],
        "mass": [3.761, 8.058, 2.846, 1.37, 1.3, 0.365],
        "center": [
            [0, -0.02561, 0.00193],
            [0.2125, 0, 0.11336],
            [0.15, 0, 0.0265],
            [0, -0.0018, 0.01634],
            [0, 0.0018, 0.01634],
            [0, 0, -0.001159],
        ],
        "payload": 5.0,
        "speed": [180] * 6,
    },
    "ur10": {
        "a": [0, -0.612, -0.5723, 0, 0, 0],
        "d": [0.1273, 0, 0, 0.163941, 0.1157, 0.0922],
        "mass": [7.1, 12.7, 4.27, 2.0, 2.0, 0.365],
        "center": UR10_CENTERS,
        "payload": 10.0,
        "speed": [120, 120, 180, 180, 180, 180],
    },
    "ur10e": {
        "a": [0, -0.6127, -0.57155, 0, 0, 0],
        "d": [0.1807, 0, 0, 0.17415, 0.11985, 0.11655],
        "mass": [7.369, 13.051, 3.989, 2.1, 1.98, 0.615],
        "center": UR10_CENTERS,
        "payload": 12.5,
        "speed": [120, 120, 180, 180, 180, 180],
    },
}
UR_ALPHA = [PI / 2, 0, 0, PI / 2, -PI / 2, 0]


def about_x(angle: float) -> Floats:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


def about_z(angle: float) -> Floats:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def along(x: float, z: float) -> Floats:
    move = np.eye(4)
    move[:3, 3] = x, 0, z
    return move


def poses(robot: Robot) -> Floats:
    return np.random.default_rng(5).uniform(robot.lower, robot.upper, (20, robot.dof))


@pytest.mark.parametrize("name", UR)
def test_universal_robots_by_denavit_and_hartenberg(name: str) -> None:
    facts, robot = UR[name], Robot.load(name)
    assert robot.payload_kg == facts["payload"]
    np.testing.assert_allclose(np.rad2deg(robot.velocity), facts["speed"])
    np.testing.assert_allclose(np.rad2deg(robot.upper), [360] * 6)
    assert robot.inertia_status == "published"
    for q in poses(robot):
        x = np.eye(4)
        for j, joint in enumerate(robot.joints):
            x = x @ about_z(q[j]) @ along(facts["a"][j], facts["d"][j]) @ about_x(UR_ALPHA[j])
            assert joint.inertia is not None
            assert joint.inertia.mass == facts["mass"][j]
            center = (x @ [*facts["center"][j], 1])[:3]
            found = robot.pose(q, joint.link, joint.inertia.center)[:3, 3]
            np.testing.assert_allclose(found, center, rtol=0, atol=1e-8)
        np.testing.assert_allclose(robot.pose(q)[:3, 3], x[:3, 3], rtol=0, atol=1e-12)


def test_panda_by_denavit_and_hartenberg() -> None:
    robot = Robot.load("panda")
    # Craig's convention: a and alpha come before the joint.
    a, d = [0, 0, 0, 0.0825, -0.0825, 0, 0.088], [0.333, 0, 0.316, 0, 0.384, 0, 0]
    alpha = [0, -PI / 2, PI / 2, PI / 2, -PI / 2, PI / 2, PI / 2]
    for q in poses(robot):
        x = np.eye(4)
        for j in range(7):
            x = x @ along(a[j], 0) @ about_x(alpha[j]) @ about_z(q[j]) @ along(0, d[j])
            found = robot.pose(q, robot.joints[j].link)
            np.testing.assert_allclose(found, x, rtol=0, atol=1e-12)
        np.testing.assert_allclose(robot.pose(q), x @ along(0, 0.107), rtol=0, atol=1e-12)
    # Limits of the interface [rad], cut to a thousandth of a degree.
    upper = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
    lower = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
    np.testing.assert_allclose(robot.upper, upper, rtol=0, atol=2e-5)
    np.testing.assert_allclose(robot.lower, lower, rtol=0, atol=2e-5)
    np.testing.assert_allclose(robot.velocity, [2.175] * 4 + [2.61] * 3, rtol=0, atol=2e-5)
    masses = [4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522]
    assert [joint.inertia.mass for joint in robot.joints if joint.inertia] == masses
    assert (robot.payload_kg, robot.inertia_status) == (3.0, "published")
    assert "Gaz" in robot.inertia_source


def test_iiwa_stands_as_its_data_sheet_says() -> None:
    robot = Robot.load("iiwa14")
    # Heights of shoulder, elbow and wrist, and of the flange, with the arm straight up.
    heights = [360, 780, 1180, 1306]
    found = [robot.pose(np.zeros(7), link)[:3, 3] * 1e3 for link in ("iiwa_link_2", "iiwa_link_4", "iiwa_link_6", None)]
    np.testing.assert_allclose(found, [[0, 0, height] for height in heights], rtol=0, atol=1e-9)
    np.testing.assert_allclose(robot.pose(np.zeros(7))[:3, :3], np.eye(3), rtol=0, atol=1e-12)
    # Joints 2 and 6 lean the arm forward, joint 4 bends it the other way.
    assert robot.pose([0, 0.5, 0, 0, 0, 0, 0])[0, 3] > 0.3
    assert robot.pose([0, 0, 0, 0.5, 0, 0, 0])[0, 3] < -0.1
    assert robot.pose([0, 0, 0, 0, 0, 0.5, 0])[0, 3] > 0.05
    np.testing.assert_allclose(np.rad2deg(robot.upper), [170, 120, 170, 120, 170, 120, 175])
    np.testing.assert_allclose(np.rad2deg(robot.velocity), [85, 85, 100, 75, 130, 135, 135])
    assert robot.payload_kg == 14.0
    assert sum(joint.inertia.mass for joint in robot.joints if joint.inertia) == pytest.approx(17.5)


def test_the_inertia_of_the_sia5d_is_an_assumption_and_says_so() -> None:
    robot = Robot.load("sia5d")
    assert robot.inertia_status == "assumed"
    assert "assumption" in robot.note
    masses = [joint.inertia.mass for joint in robot.joints if joint.inertia]
    # With the base the split makes the 30 kg of the data sheet, but for its own rounding.
    assert sum(masses) + 10.23 == pytest.approx(30.0, abs=0.02)
    # Rods from a joint to the next: their centre is half way.
    for joint, following in zip(robot.joints, robot.joints[1:], strict=False):
        assert joint.inertia is not None
        if any(following.origin) and joint.name != "joint_s":
            np.testing.assert_allclose(joint.inertia.center, np.array(following.origin) / 2, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", robots())
def test_inertia_is_complete_and_can_be(name: str) -> None:
    robot = Robot.load(name)
    assert robot.inertia_status in ("published", "assumed")
    assert robot.inertia_source
    for joint in robot.joints:
        assert joint.inertia is not None
        assert joint.inertia.mass > 0
        assert not joint.inertia.breaks_triangle
        # No centre lies outside the arm, and no link turns more reluctantly than a ring of its reach.
        assert np.linalg.norm(joint.inertia.center) < 0.5
        assert np.linalg.eigvalsh(np.array(joint.inertia.tensor))[2] < joint.inertia.mass * 0.5**2


# Joint torque limits [Nm]: the makers' "max. joint torques" (UR), brochure LBR iiwa p. 30, interface limits (Panda).
TORQUE_LIMITS = {
    "iiwa14": [320, 320, 176, 176, 110, 40, 40],
    "panda": [87, 87, 87, 87, 12, 12, 12],
    "ur10": [330, 330, 150, 56, 56, 56],
    "ur10e": [330, 330, 150, 56, 56, 56],
    "ur3e": [56, 56, 28, 12, 12, 12],
    "ur5e": [150, 150, 150, 28, 28, 28],
}


@pytest.mark.parametrize("name", robots())
def test_drive_trains(name: str) -> None:
    drive_train = Robot.load(name).drive_train
    published = {quantity for quantity, status in drive_train.status.items() if status == "published"}
    assert published == ({"torque_limit"} if name in TORQUE_LIMITS else set())
    np.testing.assert_array_equal(drive_train.torque_limit, TORQUE_LIMITS.get(name, [math.inf] * 7))
    assert all(drive_train.source.values())


def test_the_rotors_of_the_panda_are_those_of_its_successor() -> None:
    drive_train = Robot.load("panda").drive_train
    # Franka's reflected inertia of the FR3 [kg m2], as the Drake project has it.
    np.testing.assert_array_equal(drive_train.rotor_inertia, [0.605721456] * 2 + [0.462474144] * 2 + [0.205544064] * 3)
    assert drive_train.status["rotor_inertia"] == "assumed"
    assert "FR3" in drive_train.source["rotor_inertia"]
