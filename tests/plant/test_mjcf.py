"""The robot that MuJoCo gets is the robot we have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from bumpstop.errors import InputError
from bumpstop.model import Joint, LinkInertia, Robot, inverse_dynamics, mass_matrix, robots
from bumpstop.plant import PlantObject, mjcf
from model.dynamics_cases import general_arm, mujoco_model, with_inertia

GRAVITY = (0.3, -0.2, -9.80665)
URDF = """<robot name="two"><link name="base"/>
<joint name="a" type="revolute"><origin xyz="0 0 0.4" rpy="0.3 -0.7 1.1"/><parent link="base"/><child link="one"/>
<axis xyz="0 0.6 0.8"/><limit lower="-2" upper="2" velocity="2" effort="1"/></joint>
<link name="one"><inertial><origin xyz="0.1 0.02 0.05" rpy="0.2 0.1 0"/><mass value="3"/>
<inertia ixx="0.03" ixy="0.001" ixz="0.002" iyy="0.04" iyz="-0.001" izz="0.02"/></inertial></link>
<joint name="b" type="prismatic"><origin xyz="0.2 0 0"/><parent link="one"/><child link="two"/><axis xyz="1 0 0"/>
<limit lower="-0.5" upper="0.5" velocity="2" effort="1"/></joint>
<link name="two"><inertial><mass value="1.5"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.015"/>
</inertial></link></robot>"""


def arms(folder: Path) -> list[Robot]:
    path = folder / "two.urdf"
    path.write_text(URDF, encoding="utf-8")
    rng = np.random.default_rng(7)
    return [*(with_inertia(Robot.load(name), rng) for name in robots()), general_arm(), Robot.from_urdf(path)]


def test_mass_matrix_and_bias_are_ours(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    for robot in arms(tmp_path):
        model = mujoco.MjModel.from_xml_string(mjcf(robot, gravity=GRAVITY))
        data = mujoco.MjData(model)
        for _ in range(3):
            q, qd = rng.uniform(-1, 1, robot.dof), rng.normal(size=robot.dof)
            data.qpos[:], data.qvel[:] = q, qd
            mujoco.mj_forward(model, data)
            columns = np.zeros((robot.dof, robot.dof))
            for column, unit in zip(columns, np.eye(robot.dof), strict=True):
                mujoco.mj_mulM(model, data, column, unit)
            ours = mass_matrix(robot, q)
            assert np.abs(columns - ours).max() <= 1e-10 * np.abs(ours).max(), robot.name
            bias = inverse_dynamics(robot, q, qd, np.zeros(robot.dof), gravity=GRAVITY)
            assert np.abs(data.qfrc_bias - bias).max() <= 1e-10 * np.abs(bias).max(), robot.name
            np.testing.assert_allclose(data.site("tip").xpos, robot.pose(q)[:3, 3], atol=1e-12)
            np.testing.assert_allclose(data.site("tip").xmat.reshape(3, 3), robot.pose(q)[:3, :3], atol=1e-12)


def test_the_text_says_what_the_tests_of_dynamics_build() -> None:
    # Another hand wrote that one, through MuJoCo's own specification.
    robot = general_arm()
    text, built = mujoco.MjModel.from_xml_string(mjcf(robot)), mujoco_model(robot, np.array([0, 0, -9.80665]))
    for name in ("body_mass", "body_pos", "body_ipos", "body_inertia"):
        ours = getattr(text, name)[1 : 1 + robot.dof]
        np.testing.assert_allclose(ours, getattr(built, name)[1 : 1 + robot.dof], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(text.dof_armature, built.dof_armature)


def test_half_turns_keep_their_rotation() -> None:
    # The quaternion of a half turn has no part to divide by but its largest.
    turns = [np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1]), np.diag([-1.0, -1, 1]), np.eye(3)]
    angle = np.pi - 1e-7
    turns.append(np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]))
    link = LinkInertia(mass=1.0, center=(0.0, 0.0, 0.1), tensor=((0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)))
    for turn in turns:
        joint = Joint(name="j", link="l", rotation=tuple(map(tuple, turn.tolist())), inertia=link)
        robot = Robot(name="r", joints=(joint,), tip_rotation=tuple(map(tuple, turn.tolist())))
        model = mujoco.MjModel.from_xml_string(mjcf(robot))
        data = mujoco.MjData(model)
        data.qpos[0] = 0.4
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.site("tip").xmat.reshape(3, 3), robot.pose([0.4])[:3, :3], atol=1e-14)


def test_gears_that_give_add_a_twist() -> None:
    robot = with_inertia(Robot.load("ur5e"), np.random.default_rng(1))
    model = mujoco.MjModel.from_xml_string(mjcf(robot, joint_stiffness=[1e4, np.inf, 1e4, 1e4, np.inf, 1e4]))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(2)
    q, twist = rng.uniform(-1, 1, 6), np.array([0.1, 0, -0.2, 0.3, 0, 0.1])
    for joint, motor, more in zip(robot.joints, q, twist, strict=True):
        data.joint(joint.name).qpos[0] = motor
        if more:
            data.joint(f"{joint.name}:twist").qpos[0] = more
    mujoco.mj_forward(model, data)
    assert model.nv == 10
    np.testing.assert_allclose(data.site("tip").xpos, robot.pose(q + twist)[:3, 3], atol=1e-12)


@pytest.mark.parametrize("normal", [(0, 0, -1), (0, 2, 0), (1, 1, -1)])
def test_faces_stand_where_they_are_put(normal: tuple[float, float, float]) -> None:
    robot = with_inertia(Robot.load("ur5e"), np.random.default_rng(1))
    thing = PlantObject.of("plexiglas", position=(0.5, 0.1, 0.3), normal=normal)
    model = mujoco.MjModel.from_xml_string(mjcf(robot, objects=[thing], contact_radius=0.01))
    data = mujoco.MjData(model)
    data.joint(thing.geom).qpos[0] = 0.002
    mujoco.mj_forward(model, data)
    unit = np.array(normal) / np.linalg.norm(normal)
    # A ball of 10 mm about the place touches; the plate is 20 mm thick, and pushed in by 2 mm.
    np.testing.assert_allclose(data.geom(thing.geom).xpos, [0.5, 0.1, 0.3] + (0.01 + 0.01 + 0.002) * unit, atol=1e-12)
    np.testing.assert_allclose(data.geom(thing.geom).xmat.reshape(3, 3)[:, 2], unit, atol=1e-12)
    assert model.joint(thing.geom).stiffness[0] == 19100


def test_names_are_escaped() -> None:
    link = LinkInertia(mass=1.0, tensor=((0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)))
    robot = Robot(name='a"<&b', joints=(Joint(name='j"&<', link="<l&", inertia=link),))
    model = mujoco.MjModel.from_xml_string(mjcf(robot))
    assert model.joint(0).name == 'j"&<'
    assert model.body(1).name == "<l&"


def test_names_of_objects_are_escaped() -> None:
    thing = PlantObject.of("foam", position=(0.5, 0.1, 0.3), normal=(0, 0, -1), name='cup & "<saucer>"')
    model = mujoco.MjModel.from_xml_string(mjcf(Robot.load("ur5e"), objects=[thing]))
    assert [model.geom(int(geom)).name for geom in model.pair_geom2] == [thing.geom]


def test_links_without_inertia_or_with_one_that_nothing_has() -> None:
    robot = general_arm()
    unpadded = replace(robot, joints=(*robot.joints[:2], replace(robot.joints[2], inertia=None), *robot.joints[3:]))
    with pytest.raises(InputError, match="no inertia of link 'l2' is known"):
        mjcf(unpadded)
    odd = LinkInertia(mass=1.0, tensor=((1.0, 0, 0), (0, 0.1, 0), (0, 0, 0.1)))
    with pytest.raises(InputError, match=r"link 'l0' has principal moments of inertia 0\.1, 0\.1 and 1 kg m2"):
        mjcf(replace(robot, joints=(replace(robot.joints[0], inertia=odd), *robot.joints[1:])))
