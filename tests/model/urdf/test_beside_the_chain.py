"""URDF files that hold more than the arm: faults, antennas, other robots and grippers beside the chain."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bumpstop.errors import InputError
from bumpstop.model.joint import rotation_from_rpy
from model.urdf_cases import ARM, changed, read

ANTENNA = (
    '<link name="antenna">{inertial}</link><joint name="stick" type="{kind}"><parent link="{parent}"/>'
    '<child link="antenna"/>{limit}</joint></robot>'
)
NO_MASS = '<inertial><mass value="-1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def antenna(parent: str, inertial: str = "", kind: str = "fixed", limit: str = "") -> str:
    return ARM.replace("</robot>", ANTENNA.format(parent=parent, inertial=inertial, kind=kind, limit=limit))


@pytest.mark.parametrize(
    ("inertial", "kind", "limit", "fault"),
    [
        (NO_MASS, "fixed", "", "link 'antenna' mass: "),
        ("<inertial/>", "fixed", "", "link 'antenna' inertial: has no <mass>"),
        ("", "revolute", "", "joint 'stick' limit: is missing"),
        ("", "bendy", "", "joint 'stick' type: 'bendy' is no kind of joint"),
        ("", "fixed", '<origin xyz="0 0"/>', "joint 'stick' origin xyz: '0 0' has 2 values"),
    ],
)
def test_a_fault_on_the_base_does_not_refuse_the_arm(
    inertial: str, kind: str, limit: str, fault: str, tmp_path: Path
) -> None:
    arm = read(antenna("base", inertial, kind, limit), tmp_path, tip="tool")
    assert [joint.name for joint in arm.joints] == ["turn", "push", "roll"]
    (said,) = [warning for warning in arm.warnings if "fault" in warning]
    assert said.startswith("Beside the chain, the file has a fault that is passed over: ")
    assert fault in said


def test_the_same_fault_on_a_moving_link_refuses_it(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="link 'antenna' mass: "):
        read(antenna("wrist", NO_MASS), tmp_path, tip="tool")
    with pytest.raises(InputError, match="joint 'roll' type: 'bendy' is no kind"):
        read(changed(('name="roll" type="continuous"', 'name="roll" type="bendy"')), tmp_path, tip="tool")


def test_of_two_robots_in_a_file_that_of_the_tip_is_read(tmp_path: Path) -> None:
    text = changed(('<link name="base"/>', '<link name="base"/><link name="table"/>'))
    for names in ({"tip": "tool"}, {"base": "base"}):
        arm = read(text, tmp_path, **names)
        assert (arm.dof, arm.tip_name) == (3, "tool")
    with pytest.raises(InputError, match=r"has 2 links without a parent: 'base', 'table'; wanted one root, or"):
        read(text, tmp_path)


FINGER = (
    '<link name="{link}"/><joint name="{name}" type="prismatic">{mimic}<parent link="tool"/><child link="{link}"/>'
    '<limit lower="0" upper="{travel}" velocity="1"/></joint>'
)


def finger(name: str, link: str, mimic: str = "", travel: float = 0.04) -> str:
    return FINGER.format(name=name, link=link, mimic=mimic, travel=travel)


def test_a_gripper_at_the_end_is_named(tmp_path: Path) -> None:
    arm = read(ARM.replace("</robot>", finger("grip", "pad") + "</robot>"), tmp_path)
    assert [joint.name for joint in arm.joints] == ["turn", "push", "roll", "grip"]
    assert any("ends with 'grip', which looks like a gripper's joint" in warning for warning in arm.warnings)
    assert any("Give tip = 'tool'" in warning for warning in arm.warnings)
    # A long axis is an axis of the arm, unless its name says otherwise.
    long = read(ARM.replace("</robot>", finger("lift", "fork", travel=0.5) + "</robot>"), tmp_path)
    assert not any("gripper" in warning for warning in long.warnings)


def test_two_fingers_offer_the_link_before_them(tmp_path: Path) -> None:
    both = finger("left_finger", "left") + finger("right_finger", "right", '<mimic joint="left_finger"/>')
    with pytest.raises(InputError, match="give 'tool' to end the chain before the gripper"):
        read(ARM.replace("</robot>", both + "</robot>"), tmp_path)


CONTROLLER = (
    '<link name="cell"/><joint name="stand" type="fixed"><parent link="cell"/><child link="{stood}"/></joint>'
    '<joint name="count" type="fixed"><origin xyz="{xyz}" rpy="{rpy}"/><parent link="cell"/><child link="{counts}"/>'
    "</joint></robot>"
)


def test_the_controller_s_base_beside_the_arm_is_a_base(tmp_path: Path) -> None:
    """Files of ROS-Industrial have it as a link with nothing below it; it was refused, whatever tip was given."""
    text = ARM.replace('"base"', '"foot"').replace('<link name="foot"/>', '<link name="foot"/><link name="base"/>')
    turned = text.replace("</robot>", CONTROLLER.format(stood="foot", counts="base", xyz="0.2 0 0.1", rpy="0 0 3"))
    q = np.array([0.3, 0.2, -0.4])
    in_root = read(turned, tmp_path, base="cell", tip="tool")
    for tip in ("tool", None):
        in_base = read(turned, tmp_path, base="base", tip=tip)
        X = np.eye(4)
        X[:3, :3], X[:3, 3] = rotation_from_rpy(0, 0, 3), (0.2, 0, 0.1)
        np.testing.assert_allclose(X @ in_base.pose(q), in_root.pose(q), atol=1e-12)
        assert in_base.frames == in_root.frames
    with pytest.raises(InputError, match="'upper' is not below 'slide'"):
        read(turned, tmp_path, base="camera", tip="upper")


@pytest.mark.parametrize(
    ("xyz", "rpy", "begins"),
    [
        ("0 0 0", "0 0 3.141592653589793", "Velocities, normals and a program's poses are taken in 'cell', against"),
        ("0 0 0.8", "0 0 0", "A program's poses are taken in 'cell', against which 'base' is shifted, by custom the"),
        ("0 0 0", "0 0 0", ""),
    ],
)
def test_a_controller_s_base_that_is_not_that_of_the_chain_is_told(
    xyz: str, rpy: str, begins: str, tmp_path: Path
) -> None:
    """Of a UR the two are turned by half a turn: poses of its programs were taken on the other side of the arm."""
    text = ARM.replace('"base"', '"foot"').replace('<link name="foot"/>', '<link name="foot"/><link name="base"/>')
    text = text.replace("</robot>", CONTROLLER.format(stood="foot", counts="base", xyz=xyz, rpy=rpy))
    found = [warning for warning in read(text, tmp_path, tip="tool").doubts if "poses" in warning]
    assert [warning.startswith(begins) for warning in found] == ([True] if begins else [])
    for base in ("cell", "base"):  # who names it has chosen
        assert not any("poses" in warning for warning in read(text, tmp_path, base=base, tip="tool").warnings)
