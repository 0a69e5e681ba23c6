"""Dynamics by other routes: Pinocchio and MuJoCo; rows and targets; and bad input."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from bumpstop import _native
from bumpstop.errors import InputError
from bumpstop.model import (
    Joint,
    LinkInertia,
    Robot,
    coriolis_torque,
    effective_mass,
    gravity_torque,
    inverse_dynamics,
    mass_matrix,
    robots,
    singular_values,
)
from model.dynamics_cases import general_arm, mujoco_model, pinocchio_model, random_inertia, with_inertia
from model.random_chains import Floats, positions
from model.random_motions import GRAVITY, Dynamics, Motion, ours, random_arms, random_motion

# --- The other routes -------------------------------------------------------------------------------------------------


def by_pinocchio(robot: Robot, m: Motion) -> Dynamics:
    return pinocchio_dynamics(pinocchio_model(robot), rotors_of(robot), m)


def pinocchio_dynamics(model: pin.Model, rotors: Floats, m: Motion) -> Dynamics:
    model.gravity.linear = GRAVITY
    data = model.createData()
    tau, mass, coriolis, gravity = [], [], [], []
    for q, qd, qdd, wrench in zip(m.q, m.qd, m.qdd, m.wrench, strict=True):
        pin.forwardKinematics(model, data, q)
        to_link = data.oMi[m.link + 1].rotation.T
        force, moment = to_link @ wrench[:3], to_link @ wrench[3:]
        outer = [pin.Force.Zero() for _ in range(model.njoints)]
        outer[m.link + 1] = pin.Force(force, moment + np.cross(m.point, force))
        tau.append(pin.rnea(model, data, q, qd, qdd, outer) + rotors * qdd)
        upper = np.triu(pin.crba(model, data, q))
        mass.append(upper + upper.T - np.diag(np.diag(upper)) + np.diag(rotors))
        gravity.append(pin.computeGeneralizedGravity(model, data, q).copy())
        coriolis.append(pin.nonLinearEffects(model, data, q, qd) - gravity[-1])
    return Dynamics(*map(np.array, (tau, mass, coriolis, gravity)))


def by_mujoco(robot: Robot, m: Motion) -> Dynamics:
    return mujoco_dynamics(mujoco_model(robot, GRAVITY), m)


def mujoco_dynamics(model: mujoco.MjModel, m: Motion) -> Dynamics:
    model.opt.gravity = GRAVITY
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT  # limits push back
    data = mujoco.MjData(model)
    dof = model.nv
    body = int(model.jnt_bodyid[m.link])

    def inverse(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, qdd
        mujoco.mj_inverse(model, data)
        result: Floats = data.qfrc_inverse.copy()
        return result

    tau, mass, coriolis, gravity = [], [], [], []
    rest = np.zeros(dof)
    for q, qd, qdd, wrench in zip(m.q, m.qd, m.qdd, m.wrench, strict=True):
        gravity.append(inverse(q, rest, rest))
        coriolis.append(inverse(q, qd, rest) - gravity[-1])
        whole, full, pushed = inverse(q, qd, qdd), np.zeros((dof, dof)), np.zeros(dof)
        for column, unit in zip(full, np.eye(dof), strict=True):
            mujoco.mj_mulM(model, data, column, unit)
        place = data.xpos[body] + data.xmat[body].reshape(3, 3) @ m.point
        mujoco.mj_applyFT(model, data, wrench[:3], wrench[3:], place, body, pushed)
        tau.append(whole - pushed)
        mass.append(full)
    return Dynamics(*map(np.array, (tau, mass, coriolis, gravity)))


def rotors_of(robot: Robot) -> Floats:
    return np.array([joint.rotor_inertia for joint in robot.joints])


def assert_same(found: Dynamics, known: Dynamics, m: Motion) -> None:
    """To 1e-10 of the largest share that any joint's torque is made of."""
    assert np.abs(found.mass - known.mass).max() <= 1e-10 * np.abs(known.mass).max()
    shares = (known.coriolis, known.gravity, np.einsum("nij,nj->ni", np.abs(known.mass), np.abs(m.qdd)), known.tau)
    scale = max(np.abs(share).max() for share in shares)
    for name in ("tau", "coriolis", "gravity"):
        one, other = getattr(found, name), getattr(known, name)
        assert one.shape == other.shape
        assert np.abs(one - other).max() <= 1e-10 * scale, name


ROUTES = {"pinocchio": by_pinocchio, "mujoco": by_mujoco}
Route = Callable[[Robot, Motion], Dynamics]


@pytest.mark.parametrize("route", ROUTES.values(), ids=ROUTES)
@pytest.mark.parametrize("name", robots())
def test_builtin_robots(name: str, route: Route) -> None:
    # Where the file of a robot has no inertia, its links get a random one.
    rng = np.random.default_rng(22)
    robot = with_inertia(Robot.load(name), rng)
    if route is by_mujoco and any(
        joint.inertia is not None and joint.inertia.breaks_triangle for joint in robot.joints
    ):
        pytest.skip("MuJoCo refuses inertia no body has")
    for _ in range(10):
        m = random_motion(robot, 50, rng)
        assert_same(ours(robot, m), route(robot, m), m)


@pytest.mark.parametrize("route", ROUTES.values(), ids=ROUTES)
def test_random_chains(route: Route) -> None:
    rng = np.random.default_rng(23)
    for robot in (general_arm(), *random_arms()):
        m = random_motion(robot, 5, rng)
        assert_same(ours(robot, m), route(robot, m), m)


@pytest.mark.parametrize("angle", [0.0, 1e-15, 1e-9, 1e-5, 1e-2, 0.7])
def test_sixteen_joints(angle: float) -> None:
    # The frames of neighbours slide along their axes to shorten the computation; a long chain must not run away.
    rng = np.random.default_rng(24)
    links = [random_inertia(rng) for _ in range(16)]
    axes = [(0.0, float(np.sin(angle)), float(np.cos(angle))), (0.0, 0.0, 1.0)]
    joints = tuple(
        Joint(name=f"j{i}", link=f"l{i}", origin=(0.1, 0.2, 0.3), axis=axes[i % 2], inertia=links[i]) for i in range(16)
    )
    robot = Robot(name="long", joints=joints)
    m = random_motion(robot, 20, rng)
    for route in ROUTES.values():
        assert_same(ours(robot, m), route(robot, m), m)


# Made by hand: inertial frames that are turned, one joint that slides, a fixed base.
URDF = """
<robot name="three">
  <link name="base"/>
  <link name="one"><inertial><origin xyz="0.1 -0.05 0.2" rpy="0.3 -0.4 0.5"/><mass value="4"/>
    <inertia ixx="0.05" iyy="0.06" izz="0.03" ixy="0.004" ixz="-0.003" iyz="0.005"/></inertial></link>
  <link name="two"><inertial><origin xyz="-0.02 0.03 0.15" rpy="-1 0.2 2"/><mass value="2.5"/>
    <inertia ixx="0.02" iyy="0.03" izz="0.015" ixy="-0.002" ixz="0.001" iyz="0.003"/></inertial></link>
  <link name="three"><inertial><origin xyz="0.05 0.01 -0.04" rpy="0.7 1.1 -0.9"/><mass value="1.2"/>
    <inertia ixx="0.004" iyy="0.005" izz="0.006" ixy="0.0003" ixz="0.0002" iyz="-0.0004"/></inertial></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="one"/>
    <origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 -0.6"/><axis xyz="0.6 0 0.8"/>
    <limit lower="-9" upper="9" effort="100" velocity="1"/></joint>
  <joint name="b" type="prismatic"><parent link="one"/><child link="two"/>
    <origin xyz="0 0.1 0.4" rpy="-0.2 0.9 1.4"/><axis xyz="0 -0.8 0.6"/>
    <limit lower="-1" upper="1" effort="100" velocity="1"/></joint>
  <joint name="c" type="revolute"><parent link="two"/><child link="three"/>
    <origin xyz="0.3 0 -0.1" rpy="1.2 -0.7 0.1"/><axis xyz="1 0 0"/>
    <limit lower="-9" upper="9" effort="100" velocity="1"/></joint>
</robot>
"""


def test_a_urdf(tmp_path: Path) -> None:
    path = tmp_path / "three.urdf"
    path.write_text(URDF, encoding="utf-8")
    robot = Robot.from_urdf(path)
    m = random_motion(robot, 50, np.random.default_rng(25))
    found = ours(robot, m)
    assert_same(found, pinocchio_dynamics(pin.buildModelFromXML(URDF), np.zeros(3), m), m)
    assert_same(found, mujoco_dynamics(mujoco.MjModel.from_xml_string(URDF), m), m)


# --- Rows and targets -------------------------------------------------------------------------------------------------


def test_one_row_or_many() -> None:
    rng = np.random.default_rng(32)
    for robot in (general_arm(), *random_arms()[:10]):
        m = random_motion(robot, 11, rng)
        n = m.wrench[:, :3] / np.linalg.norm(m.wrench[:, :3], axis=1)[:, None]
        many = (*vars(ours(robot, m)).values(), effective_mass(robot, m.q, n), singular_values(robot, m.q))
        for i in range(11):
            one = Motion(m.q[i], m.qd[i], m.qdd[i], m.wrench[i], m.link, m.point)
            single = (
                *vars(ours(robot, one)).values(),
                effective_mass(robot, m.q[i], n[i]),
                singular_values(robot, m.q[i]),
            )
            for a, b in zip(single, many, strict=True):
                assert np.array_equal(a, b[i])
    nothing = np.empty((0, 7))
    assert inverse_dynamics(general_arm(), nothing, nothing, nothing).shape == (0, 7)
    assert mass_matrix(general_arm(), nothing).shape == (0, 7, 7)
    assert effective_mass(general_arm(), nothing, (0, 0, 1)).shape == (0,)


def test_targets_agree() -> None:
    robot = general_arm()
    rng = np.random.default_rng(33)
    q, qd, qdd = positions(robot, 9, rng), rng.normal(size=(9, 7)), rng.normal(size=(9, 7))
    results = []
    for target in _native.available_targets():
        module = _native.load(target)
        links = [joint.inertia for joint in robot.joints if joint.inertia is not None]
        chain = module.Chain(
            prismatic=[False] * 7,
            origin=np.array([joint.origin for joint in robot.joints]),
            rotation=np.array([joint.rotation for joint in robot.joints]),
            axis=np.array([joint.axis for joint in robot.joints]),
        )
        inertias = [
            module.LinkInertia(link.mass, np.array(link.center), np.array(link.tensor), rotor)
            for link, rotor in zip(links, rotors_of(robot), strict=True)
        ]
        arm = module.Dynamics(chain, inertias)
        results.append(arm.inverse_dynamics(q, qd, qdd, GRAVITY))
    for other in results[1:]:
        np.testing.assert_allclose(other, results[0], rtol=0, atol=1e-13 * np.abs(results[0]).max())


# --- Input ------------------------------------------------------------------------------------------------------------

Q = np.zeros(7)
BAD: dict[str, tuple[str, Callable[[Robot], object]]] = {
    "q too short": ("q", lambda r: mass_matrix(r, np.zeros(6))),
    "rates of another shape": ("qd", lambda r: coriolis_torque(r, Q, np.zeros((1, 7)))),
    "fewer rates": ("qd", lambda r: coriolis_torque(r, np.zeros((3, 7)), np.zeros((2, 7)))),
    "nan": ("qdd[3]", lambda r: inverse_dynamics(r, Q, Q, [0, 0, 0, np.nan, 0, 0, 0])),
    "gravity as a number": ("gravity", lambda r: gravity_torque(r, Q, gravity=9.81)),
    "a force without moment": ("wrench", lambda r: inverse_dynamics(r, Q, Q, Q, wrench=[0, 0, 1])),
    "wrenches for one row": ("wrench", lambda r: inverse_dynamics(r, Q, Q, Q, wrench=np.zeros((1, 6)))),
    "too few wrenches": (
        "wrench",
        lambda r: inverse_dynamics(r, *[np.zeros((3, 7))] * 3, wrench=np.zeros((2, 6))),
    ),
    "unknown link": ("link", lambda r: inverse_dynamics(r, Q, Q, Q, link="l9")),
    "no unit vector": ("direction", lambda r: effective_mass(r, Q, (0, 0, 2))),
    "no unit vector in a row": (
        "direction[1]",
        lambda r: effective_mass(r, np.zeros((2, 7)), [[0, 0, 1], [0, 0, 0]]),
    ),
    "rows": ("rows", lambda r: singular_values(r, Q, rows="angular")),  # type: ignore[arg-type]
}


@pytest.mark.parametrize(("field", "call"), BAD.values(), ids=BAD)
def test_bad_input(field: str, call: Callable[[Robot], object]) -> None:
    with pytest.raises(InputError) as refused:
        call(general_arm())
    assert refused.value.field == field


def test_the_first_link_without_inertia_is_named() -> None:
    arm = general_arm()
    joints = [replace(joint, inertia=None) if joint.link in ("l2", "l5") else joint for joint in arm.joints]
    robot = replace(arm, joints=tuple(joints))
    for call in (
        lambda: mass_matrix(robot, Q),
        lambda: gravity_torque(robot, Q),
        lambda: inverse_dynamics(robot, Q, Q, Q),
        lambda: effective_mass(robot, Q, (0, 0, 1)),
    ):
        with pytest.raises(InputError, match="general: no inertia of link 'l2' is known"):
            call()
    assert singular_values(robot, Q).shape == (3,)  # needs none


def test_a_motion_that_moves_no_mass_is_refused() -> None:
    # The last joint turns a point on its own axis.
    joints = (
        Joint(name="a", link="one", inertia=LinkInertia(mass=1.0, center=(0.3, 0.0, 0.0))),
        Joint(name="b", link="two", origin=(0.5, 0.0, 0.0), inertia=LinkInertia(mass=1.0)),
    )
    robot = Robot(name="loose", joints=joints, tip_origin=(0.2, 0.0, 0.0))
    with pytest.raises(InputError, match=r"some motion of loose at q\[0\] moves no mass"):
        effective_mass(robot, np.zeros((2, 2)), (0.0, 1.0, 0.0))
    geared = replace(robot, joints=(joints[0], replace(joints[1], rotor_inertia=0.1)))
    assert np.isfinite(effective_mass(geared, [0.0, 0.0], (0.0, 1.0, 0.0)))


def test_robots_of_lists_and_arrays() -> None:
    # Positions may be given as lists; nothing may depend on a robot having a hash.
    link = LinkInertia(mass=1.0, center=[0.1, 0.0, 0.0])  # type: ignore[arg-type]
    joint = Joint(name="j", link="l", origin=[0, 0, 1], axis=np.array([0, 0, 1]), inertia=link)  # type: ignore[arg-type]
    assert mass_matrix(Robot(name="r", joints=(joint,)), [0.0]) == pytest.approx(np.array([[0.01]]))
