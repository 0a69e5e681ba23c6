"""Effective masses by every definition: two links by hand, Pinocchio, and what orders them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pinocchio as pin
import pytest

from bumpstop.errors import InputError
from bumpstop.model import EffectiveMassDefinition, Joint, LinkInertia, Robot, effective_mass, robots, with_rotors
from bumpstop.model.drive_train import DriveTrainEntry
from model.dynamics_cases import general_arm, pinocchio_model
from model.random_motions import random_arms, random_motion

Floats = npt.NDArray[np.float64]
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def planar(rotors: tuple[float, float] = (0.5, 0.2)) -> Robot:
    """Two rods of 1 m and 0.8 m in the plane of x and y, 6 kg and 3 kg, their rotors in the drive train."""

    def rod(mass: float, length: float) -> LinkInertia:
        about = mass * length**2 / 12
        return LinkInertia(mass=mass, center=(length / 2, 0, 0), tensor=((0, 0, 0), (0, about, 0), (0, 0, about)))

    return Robot(
        name="planar",
        joints=(
            Joint(name="a", link="upper", inertia=rod(6.0, 1.0)),
            Joint(name="b", link="lower", origin=(1.0, 0, 0), inertia=rod(3.0, 0.8)),
        ),
        tip_origin=(0.8, 0, 0),
        drive_train_entries=(
            DriveTrainEntry(quantity="rotor_inertia", values=rotors, status="published", source="by hand"),
        ),
    )


def planar_by_hand(q1: float, q2: float, n: Floats, rotors: tuple[float, float]) -> float:
    """The textbook's mass matrix and Jacobian of two links."""
    l1, l2, m1, m2 = 1.0, 0.8, 6.0, 3.0
    i1, i2, c2 = m1 * l1**2 / 12, m2 * l2**2 / 12, np.cos(q2)
    m22 = i2 + m2 * l2**2 / 4
    m12 = m22 + m2 * l1 * l2 / 2 * c2
    m11 = i1 + m1 * l1**2 / 4 + m22 + m2 * (l1**2 + l1 * l2 * c2)
    matrix = np.array([[m11 + rotors[0], m12], [m12, m22 + rotors[1]]])
    s12, c12 = np.sin(q1 + q2), np.cos(q1 + q2)
    jacobian = np.array([[-l1 * np.sin(q1) - l2 * s12, -l2 * s12], [l1 * np.cos(q1) + l2 * c12, l2 * c12]])
    row = n[:2] @ jacobian
    return float(1 / (row @ np.linalg.solve(matrix, row)))


def test_two_links_by_hand() -> None:
    robot, rng = planar(), np.random.default_rng(4)
    for q1, q2, angle in rng.uniform(-2.5, 2.5, (50, 3)):
        n = np.array([np.cos(angle), np.sin(angle), 0.0])
        for definition, rotors in (("links", (0.0, 0.0)), ("links_and_rotors", (0.5, 0.2))):
            found = effective_mass(robot, [q1, q2], n, definition=definition)  # type: ignore[arg-type]
            assert found == pytest.approx(planar_by_hand(q1, q2, n, rotors), rel=1e-12)
        # Rods as pairs of masses at their ends and four times as much in the middle (Simpson).
        points, masses = [], []
        elbow = np.array([np.cos(q1), np.sin(q1), 0.0])
        tip = elbow + 0.8 * np.array([np.cos(q1 + q2), np.sin(q1 + q2), 0.0])
        for begin, end, mass in ((0 * elbow, elbow, 6.0), (elbow, tip, 3.0)):
            points += [begin, (begin + end) / 2, end]
            masses += [mass / 6, 4 * mass / 6, mass / 6]
        c = np.average(points, axis=0, weights=masses)
        about_z = sum(m * float((p - c) @ (p - c)) for m, p in zip(masses, points, strict=True))
        r = tip - c
        expected = 1 / (1 / 9.0 + (r[0] * n[1] - r[1] * n[0]) ** 2 / about_z)
        found = effective_mass(robot, [q1, q2], n, definition="composite_rigid_body")
        assert found == pytest.approx(expected, rel=1e-10)
    assert effective_mass(robot, [0.1, 0.2], X, definition="ts15066") == 4.5
    assert effective_mass(robot, [0.1, 0.2], Z, definition="ts15066", payload_kg=2.5) == 7.0
    assert np.isinf(effective_mass(robot, [0.1, 0.2], Z, definition="links"))


def test_against_pinocchio() -> None:
    rng = np.random.default_rng(41)
    for arm in (general_arm(), *map(Robot.load, robots()), *random_arms()):
        m = random_motion(arm, 3, rng)
        n = rng.normal(size=(3, 3))
        n /= np.linalg.norm(n, axis=1)[:, None]
        link = arm.joints[m.link].link
        model = pinocchio_model(arm)
        data = model.createData()
        found = {
            definition: effective_mass(arm, m.q, n, link, m.point, definition=definition)  # type: ignore[arg-type]
            for definition in ("links", "links_and_rotors", "composite_rigid_body")
        }
        for i in range(3):
            pin.ccrba(model, data, m.q[i], np.zeros(arm.dof))
            inertia, center = data.Ig, data.com[0]
            moment = np.cross(arm.pose(m.q[i], link, m.point)[:3, 3] - center, n[i])
            expected = 1 / (1 / inertia.mass + moment @ np.linalg.solve(inertia.inertia, moment))
            assert found["composite_rigid_body"][i] == pytest.approx(expected, rel=1e-8)
            matrix = pin.crba(model, data, m.q[i])
            matrix = np.triu(matrix) + np.triu(matrix, 1).T
            row = n[i] @ arm.jacobian(m.q[i], link, m.point)[:3]
            scale = (row @ row + 1e-3) / np.linalg.eigvalsh(matrix)[0]
            for definition, rotors in (("links", 0.0), ("links_and_rotors", arm.drive_train.rotor_inertia)):
                full = matrix + np.diag(np.broadcast_to(rotors, arm.dof))
                assert abs(1 / found[definition][i] - row @ np.linalg.solve(full, row)) <= 1e-9 * scale


def test_what_orders_them() -> None:
    """Rotors make heavier, and no rigid body is heavier than its mass; the mass matrix lies on the rotors it has."""
    rng = np.random.default_rng(42)
    for arm in (Robot.load("ur10e"), Robot.load("panda"), *random_arms()):
        q = random_motion(arm, 20, rng).q
        n = rng.normal(size=(20, 3))
        n /= np.linalg.norm(n, axis=1)[:, None]
        links = effective_mass(arm, q, n, definition="links")
        rotors = effective_mass(arm, q, n, definition="links_and_rotors")
        assert (rotors >= links * (1 - 1e-9)).all()
        rigid = effective_mass(arm, q, n, definition="composite_rigid_body")
        total = sum(joint.inertia.mass for joint in arm.joints if joint.inertia)
        assert (rigid <= total * (1 + 1e-9)).all()
        bare, geared = with_rotors(arm, 0.0), with_rotors(arm, arm.drive_train.rotor_inertia)
        np.testing.assert_array_equal(effective_mass(bare, q, n), links)
        np.testing.assert_array_equal(effective_mass(geared, q, n), rotors)
        # Rotors that the joints have already are left out, and not counted twice.
        np.testing.assert_array_equal(effective_mass(geared, q, n, definition="links"), links)
        np.testing.assert_array_equal(effective_mass(geared, q, n, definition="links_and_rotors"), rotors)


def test_a_push_through_the_centre_moves_the_whole_arm() -> None:
    robot = Robot.load("ur5e")
    q = np.deg2rad([10, -60, 80, -40, -90, 20])
    masses = [joint.inertia.mass for joint in robot.joints if joint.inertia]
    centers = [robot.pose(q, joint.link, joint.inertia.center)[:3, 3] for joint in robot.joints if joint.inertia]
    center, tip = np.average(centers, axis=0, weights=masses), robot.pose(q)[:3, 3]
    n = (tip - center) / np.linalg.norm(tip - center)
    assert effective_mass(robot, q, n, definition="composite_rigid_body") == pytest.approx(sum(masses), rel=1e-9)


def test_with_rotors() -> None:
    robot = Robot.load("ur5e")
    assert [joint.rotor_inertia for joint in with_rotors(robot, [1, 2, 3, 4, 5, 6]).joints] == [1, 2, 3, 4, 5, 6]
    assert [joint.rotor_inertia for joint in with_rotors(robot, 0.5).joints] == [0.5] * 6
    assert with_rotors(with_rotors(robot, 0.5), 0) == robot


@pytest.mark.parametrize("definition", ["links", "links_and_rotors", "composite_rigid_body", "ts15066"])
def test_refusals(definition: EffectiveMassDefinition) -> None:
    robot, q = Robot.load("ur5e"), np.zeros(6)
    with pytest.raises(InputError, match=r"^direction: has length 2; wanted a unit vector$"):
        effective_mass(robot, q, (0, 0, 2), definition=definition)
    with pytest.raises(InputError, match=r"^q: has shape \(5,\)"):
        effective_mass(robot, q[:5], Z, definition=definition)
    bare = replace(robot, joints=(replace(robot.joints[0], inertia=None), *robot.joints[1:]), inertia_status="unknown")
    with pytest.raises(InputError, match=r"^robot: ur5e: .* is (not )?known"):
        effective_mass(bare, q, Z, definition=definition)
    if definition != "ts15066":
        with pytest.raises(InputError, match=r"^payload_kg: has no meaning with "):
            effective_mass(robot, q, Z, definition=definition, payload_kg=2.0)
    assert effective_mass(robot, np.zeros((2, 6)), Z, definition=definition).shape == (2,)
    assert effective_mass(robot, q, Z, definition=definition).shape == ()


def test_definitions_that_are_none() -> None:
    robot, q = Robot.load("ur5e"), np.zeros(6)
    with pytest.raises(InputError, match=r"^definition: 'rotors' is none; did you mean 'links_and_rotors'\?$"):
        effective_mass(robot, q, Z, definition="rotors")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"^payload_kg: has no meaning with 'mass_matrix'"):
        effective_mass(robot, q, Z, payload_kg=2.0)
    with pytest.raises(InputError, match=r"^payload_kg: is -1; wanted zero or more$"):
        effective_mass(robot, q, Z, definition="ts15066", payload_kg=-1.0)


def test_point_masses() -> None:
    """One weighs what it weighs to any push; two in one line turn nothing about that line."""
    one = Robot(
        name="one",
        joints=(Joint(name="a", link="upper", inertia=LinkInertia(mass=6.0, center=(0.3, 0.2, 0.1))),),
        tip_origin=(0.3, 0.2, 0.1),
    )
    two = replace(
        planar(),
        joints=tuple(
            replace(joint, inertia=LinkInertia(mass=m, center=(0.4, 0, 0)))
            for joint, m in zip(planar().joints, (6.0, 3.0), strict=True)
        ),
    )
    n = np.array([0.6, 0.8, 0.0])
    for angle in np.linspace(-3, 3, 61):
        assert effective_mass(one, [angle], n, definition="composite_rigid_body") == pytest.approx(6.0)
        # Masses at 0.4 and 1.4 m, so 2 kg m2 about their centre at 0.733 m; the tip at 1.8 m.
        across = -np.sin(angle) * n[0] + np.cos(angle) * n[1]
        wanted = 1 / (1 / 9 + ((1.8 - 6.6 / 9) * across) ** 2 / 2.0)
        assert effective_mass(two, [angle, 0.0], n, definition="composite_rigid_body") == pytest.approx(wanted)
