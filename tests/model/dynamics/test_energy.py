"""Dynamics that keep energy and statics, and agree with each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bumpstop.model import (
    Joint,
    LinkInertia,
    Robot,
    coriolis_torque,
    effective_mass,
    gravity_torque,
    inverse_dynamics,
    mass_matrix,
)
from model.dynamics_cases import general_arm
from model.random_chains import Floats, positions
from model.random_motions import GRAVITY, random_arms, random_motion


def energy(robot: Robot, q: Floats, qd: Floats) -> Floats:
    """Kinetic and potential energy (N,) [J], from mass matrix and positions of the centres of mass."""
    kinetic = 0.5 * np.einsum("ni,nij,nj->n", qd, mass_matrix(robot, q), qd)
    potential = np.zeros(len(q))
    for joint in robot.joints:
        assert joint.inertia is not None
        potential -= joint.inertia.mass * robot.pose(q, joint.link, joint.inertia.center)[:, :3, 3] @ GRAVITY
    total: Floats = kinetic + potential
    return total


def test_energy_balance() -> None:
    # The power of the motors is the rate of the energy: along a motion, by differences of eighth order.
    rng = np.random.default_rng(26)
    h, coefficients = 0.02, np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
    for robot in (general_arm(), *random_arms()[:60]):
        q, qd, qdd = positions(robot, 1, rng)[0], rng.uniform(-0.2, 0.2, robot.dof), rng.uniform(-0.2, 0.2, robot.dof)
        t = h * np.arange(-4, 5)[:, None]
        e = energy(robot, q + qd * t + 0.5 * qdd * t**2, qd + qdd * t)
        rate = coefficients @ (e[5:] - e[3::-1]) / h
        power = qd @ inverse_dynamics(robot, q, qd, qdd, gravity=GRAVITY)
        assert abs(rate - power) <= 1e-10 * np.abs(e).max()


def test_coriolis_forces_are_quadratic_and_the_wrench_linear() -> None:
    rng = np.random.default_rng(27)
    for robot in random_arms()[:30]:
        m = random_motion(robot, 4, rng)
        once, twice = coriolis_torque(robot, m.q, m.qd), coriolis_torque(robot, m.q, 2 * m.qd)
        assert np.abs(twice - 4 * once).max() <= 1e-12 * (1 + np.abs(twice).max())
        link = robot.joints[m.link].link
        rest = np.zeros_like(m.q)
        pushed = inverse_dynamics(robot, m.q, rest, rest, gravity=(0, 0, 0), wrench=m.wrench, link=link, point=m.point)
        known = -np.einsum("nij,ni->nj", robot.jacobian(m.q, link, m.point), m.wrench)
        assert np.abs(pushed - known).max() <= 1e-12 * (1 + np.abs(known).max())


def test_mass_matrix_by_columns_symmetric_and_positive() -> None:
    rng = np.random.default_rng(28)
    for robot in (general_arm(), *random_arms()):
        q = positions(robot, 3, rng)
        mass = mass_matrix(robot, q)
        rest = np.zeros_like(q)
        for j in range(robot.dof):
            unit = np.broadcast_to(np.eye(robot.dof)[j], q.shape)
            column = inverse_dynamics(robot, q, rest, unit, gravity=(0, 0, 0))
            assert np.abs(mass[:, :, j] - column).max() <= 1e-12 * np.abs(mass).max()
        assert np.array_equal(mass, mass.transpose(0, 2, 1))
        assert (np.linalg.eigvalsh(mass)[:, 0] > 0).all()


def test_a_payload_adds_its_own_share() -> None:
    rng = np.random.default_rng(29)
    for robot in random_arms()[:40]:
        last = robot.joints[-1]
        assert last.inertia is not None
        bare, load, place = last.inertia, 3.5, rng.uniform(-0.3, 0.3, 3)
        mass = bare.mass + load
        center = (bare.mass * np.array(bare.center) + load * place) / mass
        tensor = np.array(bare.tensor)
        for part, r in ((bare.mass, np.array(bare.center) - center), (load, place - center)):
            tensor = tensor + part * (r @ r * np.eye(3) - np.outer(r, r))
        loaded = LinkInertia(
            mass=mass, center=tuple(center.tolist()), tensor=tuple(tuple(row) for row in tensor.tolist())
        )
        heavier = replace(robot, joints=(*robot.joints[:-1], replace(last, inertia=loaded)))
        q = positions(robot, 3, rng)
        J = robot.jacobian(q, last.link, place)[:, :3]
        added = mass_matrix(heavier, q) - mass_matrix(robot, q)
        assert np.abs(added - load * J.transpose(0, 2, 1) @ J).max() <= 1e-11 * np.abs(mass_matrix(heavier, q)).max()
        held = gravity_torque(heavier, q, gravity=GRAVITY) - gravity_torque(robot, q, gravity=GRAVITY)
        scale = 1 + np.abs(gravity_torque(heavier, q, gravity=GRAVITY)).max()
        assert np.abs(held + load * J.transpose(0, 2, 1) @ GRAVITY).max() <= 1e-11 * scale


def test_signs_of_a_pendulum() -> None:
    # A point of 2 kg, 0.5 m along x from a joint that lifts it when it turns about -y.
    link = LinkInertia(mass=2.0, center=(0.5, 0.0, 0.0))
    joint = Joint(name="j", link="l", axis=(0.0, -1.0, 0.0), inertia=link, rotor_inertia=0.25)
    robot = Robot(name="pendulum", joints=(joint,), tip_origin=(0.5, 0.0, 0.0))
    assert gravity_torque(robot, [0.0]) == pytest.approx([2.0 * 9.80665 * 0.5])
    assert mass_matrix(robot, [0.3]) == pytest.approx(np.array([[2.0 * 0.5**2 + 0.25]]))
    # The environment carries the weight: the motor has nothing to do.
    carried = inverse_dynamics(robot, [0.0], [0.0], [0.0], wrench=[0, 0, 2.0 * 9.80665, 0, 0, 0])
    assert carried == pytest.approx([0.0], abs=1e-12)
    # A moment that turns it up does the motor's work too.
    assert inverse_dynamics(robot, [0.0], [0.0], [0.0], gravity=(0, 0, 0), wrench=[0, 0, 0, 0, -3, 0]) == pytest.approx(
        [-3.0]
    )
    assert inverse_dynamics(robot, [0.0], [0.0], [2.0], gravity=(0, 0, 0)) == pytest.approx([2.0 * 0.75])
    # Pushed up at its mass, the rotor adds its inertia over the square of the arm.
    assert effective_mass(robot, [0.0], (0.0, 0.0, 1.0)) == pytest.approx(2.0 + 0.25 / 0.5**2)


def test_coriolis_force_on_a_slide() -> None:
    # A bead of 3 kg runs outward on a turning rod: 2 m r r' w' about the axis, -m r w^2 along the rod.
    bead = LinkInertia(mass=3.0)
    rod = Joint(name="a", link="rod", inertia=LinkInertia(mass=0.0))
    slide = Joint(name="b", link="bead", kind="prismatic", axis=(1.0, 0.0, 0.0), inertia=bead)
    robot = Robot(name="rod", joints=(rod, slide))
    assert coriolis_torque(robot, [0.4, 0.7], [1.5, 0.2]) == pytest.approx(
        [2 * 3.0 * 0.7 * 0.2 * 1.5, -3.0 * 0.7 * 1.5**2]
    )
