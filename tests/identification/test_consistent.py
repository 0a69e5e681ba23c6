"""Inertias that bodies can have: planted ones predict other motions, and none is impossible."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.identification import consistent_inertias, identify_dynamics
from bumpstop.identification.dynamics.physical_consistency import _derivative, _matrix, _start
from bumpstop.identification.payload.tip_parameters import parameters_of, pseudo_inertia
from bumpstop.model import LinkInertia, inverse_dynamics, mass_matrix, write_urdf
from identification.test_dynamics_fit import excited, planted


def without_inertia(robot: bs.Robot) -> bs.Robot:
    return replace(robot, joints=tuple(replace(j, inertia=None) for j in robot.joints), inertia_status="unknown")


def test_a_planted_arm_predicts_another_motion_and_its_links_are_bodies() -> None:
    robot = bs.Robot.load("ur5e")
    log = planted(robot, 11, noise=0.3, seconds=20.0)
    fit = identify_dynamics(log, without_inertia(robot), cutoff_hz=8.0)
    found = consistent_inertias(log, fit)
    # Bodies predict the recording as well as free parameters do, but for what noise taught those.
    assert np.all(found.rmse < 1.07 * found.rmse_free)
    _, q, qd, qdd = excited(robot, 10.0, 20.0, 12)
    truth, ours = (inverse_dynamics(arm, q, qd, 0.3 * qdd) for arm in (robot, found.robot))
    # No single sample of the recording was as near the truth as this.
    assert np.all(np.std(ours - truth, axis=0) < 0.3 / (1 + np.arange(robot.dof)))
    for joint in found.robot.joints:
        assert joint.inertia is not None
        assert joint.inertia.mass > 0
        assert not joint.inertia.breaks_triangle
        assert joint.rotor_inertia > 0
    for position in q[::20]:
        assert np.linalg.eigvalsh(mass_matrix(found.robot, position))[0] > 0


def test_what_the_motion_cannot_show_stays_as_it_was() -> None:
    robot = bs.Robot.load("ur5e")
    log = planted(robot, 13, noise=0.3, seconds=15.0)
    found = consistent_inertias(log, identify_dynamics(log, robot, cutoff_hz=8.0)).robot.joints[0].inertia
    own = robot.joints[0].inertia
    assert found is not None
    assert own is not None
    # Gravity does not act about a vertical axis: only the moment about it moves the first link's mass, and little.
    assert found.mass == pytest.approx(own.mass, rel=0.05)


def test_rotors_are_not_paid_for_in_kilograms() -> None:
    """Planted rotors of some kg m2, which the robot does not know of: links keep about the masses they have."""
    robot = bs.Robot.load("ur10e")
    log = planted(robot, 5, noise=2.0, seconds=15.0)
    assert log.qd is not None
    assert log.tau is not None
    rotors = np.array([4.0, 4.0, 2.0, 0.6, 0.6, 0.6])
    qdd = np.gradient(log.qd, log.t, axis=0)
    log = replace(log, tau=log.tau + rotors * qdd)
    found = consistent_inertias(log, identify_dynamics(log, robot, cutoff_hz=8.0))
    for own, joint in zip(robot.joints, found.robot.joints, strict=True):
        assert own.inertia is not None
        assert joint.inertia is not None
        assert joint.inertia.mass == pytest.approx(own.inertia.mass, rel=0.3)
    assert np.all(found.rmse < 1.1 * found.rmse_free)


def test_parameters_turn_as_their_derivative_says() -> None:
    rng = np.random.default_rng(5)
    for _ in range(5):
        theta = rng.normal(size=10) * 0.5
        slope = _derivative(theta)
        for k in range(10):
            step = np.zeros(10)
            step[k] = 1e-6
            difference = (parameters_of(_matrix(theta + step)) - parameters_of(_matrix(theta - step))) / 2e-6
            np.testing.assert_allclose(slope[:, k], difference, rtol=1e-6, atol=1e-7 * np.abs(slope).max())


def test_the_search_starts_at_the_link_it_is_given() -> None:
    link = LinkInertia(
        mass=4.2, center=(0.1, -0.2, 0.05), tensor=((0.08, 0.01, 0.0), (0.01, 0.07, 0.005), (0.0, 0.005, 0.06))
    )
    m, c = link.mass, np.array(link.center)
    about = np.array(link.tensor) + m * (c @ c * np.eye(3) - np.outer(c, c))
    given = np.array([m, *(m * c), *about.diagonal(), *about[[0, 0, 1], [1, 2, 2]]])
    matrix = pseudo_inertia(given)
    matrix[:3, :3] += m * 1e-6 * np.eye(3)
    np.testing.assert_allclose(_matrix(_start(link)), matrix, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["sia5d", "ur10e", "panda"])
def test_written_urdf_is_the_same_arm(name: str, tmp_path: Path) -> None:
    robot = bs.Robot.load(name)
    write_urdf(robot, tmp_path / "arm.urdf")
    again = bs.Robot.from_urdf(tmp_path / "arm.urdf", tip=robot.tip_name)
    q, qd, qdd = np.random.default_rng(1).normal(size=(3, 20, robot.dof))
    np.testing.assert_allclose(again.pose(q)[0], robot.pose(q)[0], atol=1e-12)
    unpadded = replace(robot, joints=tuple(replace(joint, rotor_inertia=0.0) for joint in robot.joints))
    np.testing.assert_allclose(inverse_dynamics(again, q, qd, qdd), inverse_dynamics(unpadded, q, qd, qdd), atol=1e-9)
    np.testing.assert_array_equal(again.lower, robot.lower)
    np.testing.assert_array_equal(again.velocity, robot.velocity)


def test_written_urdf_gives_the_base_a_name_of_its_own(tmp_path: Path) -> None:
    robot = bs.Robot.load("ur10e")
    first, second, *others = robot.joints
    named = (replace(first, link="base_link"), replace(second, name=f"{robot.tip_name}_fixed"), *others)
    write_urdf(replace(robot, joints=named), tmp_path / "arm.urdf")
    again = bs.Robot.from_urdf(tmp_path / "arm.urdf", tip=robot.tip_name)
    assert again.joints[0].link == "base_link"
    assert [joint.name for joint in again.joints] == [joint.name for joint in named]
