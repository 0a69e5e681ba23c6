"""The nonlinear arm of the validation: the linear one where everything is held, and what another solver finds."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from validation.collision import elastic_arm
from validation.collision.nonlinear_arm import KNOT, Array, bare, simulate

from bumpstop.model import Robot, coriolis_torque, mass_matrix

HELD = ("mass", "jacobian", "coriolis")


def test_with_everything_held_it_is_the_linear_arm() -> None:
    case = elastic_arm.draw(Robot.load("ur10e"), 3, 3)
    fed = case.drives.feedforward == 1
    full, straight = elastic_arm.nonlinear(case, frozen=HELD), elastic_arm.linear(case)
    np.testing.assert_allclose(straight.peak_force, full, rtol=0.02)
    # Where the path's acceleration is not fed forward, the linear one knows it along the normal only.
    np.testing.assert_allclose(straight.peak_force[fed], full[fed], rtol=2e-4)
    own = np.einsum("nij,ni->nj", case.robot.jacobian(case.q)[:, :3], case.normal)
    held = elastic_arm.linear(case, levers=np.stack([own, own], axis=1))
    np.testing.assert_allclose(held.peak_force, straight.peak_force, rtol=1e-12)


def test_a_stiff_solver_finds_the_same() -> None:
    case, _ = elastic_arm.published_cases()
    case = case.chosen(np.arange(1))
    robot, drives, path = bare(case.robot), case.drives, case.reference
    until = 30
    found = simulate(
        robot, drives, type(path)(*(x[:until] for x in (path.q, path.qd, path.distance))), case.normal, case.stiffness
    )
    n, begin = robot.dof, robot.pose(case.q[0])[:3, 3]
    B, Kg, Dg, P, D = (
        x[0]
        for x in (
            drives.rotor_inertia,
            drives.gear_stiffness,
            drives.gear_damping,
            drives.servo_stiffness,
            drives.servo_damping,
        )
    )

    def force(q: Array) -> float:
        return float(case.stiffness[0] * max(0.0, case.normal[0] @ (robot.pose(q)[:3, 3] - begin)))

    def flow(t: float, y: Array) -> Array:
        q, th, qd, thd = np.split(y, 4)
        k = min(int(t / KNOT), until - 2)
        late = t - k * KNOT
        acceleration = (path.qd[k + 1, 0] - path.qd[k, 0]) / KNOT
        rate = path.qd[k, 0] + late * acceleration
        wanted = path.q[k, 0] + late * path.qd[k, 0] + late**2 / 2 * acceleration
        gear = Kg * (th - q) + Dg * (thd - qd)
        middle = (path.q[k, 0] + path.q[k + 1, 0]) / 2, (path.qd[k, 0] + path.qd[k + 1, 0]) / 2
        told = mass_matrix(robot, middle[0]) @ acceleration + coriolis_torque(robot, *middle)
        push = gear + told - coriolis_torque(robot, q, qd) - robot.jacobian(q)[:3].T @ case.normal[0] * force(q)
        rotor = (-gear - P * (th - wanted) - D * (thd - rate) + B * acceleration) / B
        return np.concatenate([qd, thd, np.linalg.solve(mass_matrix(robot, q), push), rotor])

    start = np.concatenate([path.q[0, 0], path.q[0, 0], path.qd[0, 0], path.qd[0, 0]])
    solved = solve_ivp(
        flow,
        (0, (until - 1) * KNOT),
        start,
        "Radau",
        rtol=1e-7,
        atol=1e-9,
        max_step=1e-3,
        t_eval=KNOT * np.arange(until),
    )
    forces = np.array([force(y[:n]) for y in solved.y.T])
    np.testing.assert_allclose(found.force[:, 0], forces, atol=1e-5 * forces.max())
    assert found.peak_force[0] == pytest.approx(forces.max(), rel=1e-3)


def test_finer_steps_change_nothing() -> None:
    case, _ = elastic_arm.published_cases()
    case = case.chosen(np.arange(2))
    rows = type(case.reference)(*(x[:40] for x in (case.reference.q, case.reference.qd, case.reference.distance)))
    coarse, fine = (
        simulate(case.robot, case.drives, rows, case.normal, case.stiffness, steps_per_knot=steps) for steps in (20, 40)
    )
    np.testing.assert_allclose(coarse.peak_force, fine.peak_force, rtol=1e-4)
