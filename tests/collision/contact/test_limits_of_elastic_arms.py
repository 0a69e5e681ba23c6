"""What an elastic arm becomes where parts of it are rigid, weightless or lossless: closed forms to many digits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.linalg import expm

import bumpstop as bs
from bumpstop import _native
from bumpstop.model import effective_mass, with_rotors

ROBOT = bs.Robot.load("ur10e")
Q = np.radians([0, -60, 90, -120, -90, 0])
LEVER = -np.array(ROBOT.jacobian(Q)[2])  # moving down
ROTOR = np.array([1.5, 1.5, 0.9, 0.3, 0.3, 0.3])
STEP, STIFFNESS = 1e-3, 75000.0


def arm(**changes: float) -> _native.ElasticArm:
    compliance = _native.ArmCompliance(ROBOT.dynamics)
    compliance.rotor_inertia = ROTOR
    values: dict[str, float] = {
        "gear_stiffness": 2e4,
        "gear_damping": 0.0,
        "servo_bandwidth": 0.0,
        "servo_position_gain": 0.0,
        "acceleration_feedforward": 1.0,
    }
    for name, value in (values | changes).items():
        setattr(compliance, name, np.full(6, value))
    return _native.ElasticArm(ROBOT.chain, compliance, Q, np.ascontiguousarray(LEVER), np.zeros(6))


def body(**values: float) -> _native.ContactBody:
    made = _native.ContactBody()
    made.stiffness = STIFFNESS
    for name, value in values.items():
        setattr(made, name, value)
    return made


def out_and_back() -> npt.NDArray[np.float64]:
    t = STEP * np.arange(200)
    return np.asarray(0.25 * np.minimum(t, 0.06) - 0.02 * np.maximum(t - 0.06, 0))


@pytest.mark.parametrize("rigid", [1e14, 1e16])
def test_rigid_gears_and_servos_press_as_the_clamped_spring(rigid: float) -> None:
    # With P = w_p D and D = w_v (B + M_jj), w_p w_v = rigid: both compliances fall with it.
    stiff = arm(gear_stiffness=rigid, gear_damping=1.0, servo_bandwidth=1e6, servo_position_gain=rigid / 1e6)
    path = out_and_back()
    course = _native.contact_course(stiff, body(), STEP, path, 0.0, 0)
    left = 2e5 / rigid  # what K a'(1/Kg + 1/P) a is, and the damping of the servo
    assert course.peak == pytest.approx(STIFFNESS * path.max(), rel=left)
    np.testing.assert_allclose(course.force, STIFFNESS * np.maximum(path, 0.0), atol=2 * left * course.peak)
    if rigid > 1e15:
        assert course.peak == pytest.approx(STIFFNESS * path.max(), rel=1e-9)


@pytest.mark.parametrize("rotors", [False, True])
def test_an_arm_that_nothing_holds_strikes_with_v_root_mk(rotors: bool) -> None:
    held = arm(gear_stiffness=1e13 if rotors else 1e-9)
    speed = 0.25
    course = _native.contact_course(held, body(), STEP, speed * STEP * np.arange(200.0), 0.0, 0)
    mass = float(effective_mass(with_rotors(ROBOT, ROTOR) if rotors else ROBOT, Q, np.array([0.0, 0.0, -1.0])))
    assert course.peak == pytest.approx(speed * math.sqrt(mass * STIFFNESS), rel=1e-6)


def energy(met: _native.ContactBody, a: npt.NDArray[np.float64]) -> Any:
    """Energy as a quadratic form of the state, from the masses and springs the arm was made of."""
    n, m = 6, a.shape[0] // 2
    rate = a[0, m]
    mass = np.zeros((m, m))
    links = bs.model.mass_matrix(ROBOT, Q)
    mass[:n, :n], mass[n : 2 * n, n : 2 * n] = links, np.diag(ROTOR)
    spring = np.zeros((m, m))
    gear = 2e4 * np.eye(n)
    spring[:n, :n] = spring[n : 2 * n, n : 2 * n] = gear
    spring[:n, n : 2 * n] = spring[n : 2 * n, :n] = -gear
    gap = np.zeros(m)
    gap[:n] = LEVER
    if met.mass > 0:
        mass[-1, -1], gap[-1] = met.mass, -1.0
        spring[-1, -1] += met.ground_stiffness
    spring += met.stiffness * np.outer(gap, gap)
    form = np.zeros((2 * m, 2 * m))
    form[:m, :m], form[m:, m:] = spring, rate**2 * mass
    return form


@pytest.mark.parametrize(
    "met", [{}, {"mass": 4.0}, {"mass": 0.3, "ground_stiffness": 75000.0}], ids=["clamped", "free", "gauge"]
)
def test_contact_without_losses_keeps_its_energy_and_with_losses_loses_some(met: dict[str, float]) -> None:
    lossless, hit = arm(), body(**met)
    a = np.asarray(lossless.matrix(hit, True))
    form = energy(hit, a)
    drift = form @ a
    assert abs(drift + drift.T).max() < 1e-12 * abs(drift).max()
    # From any state, over half a second.
    z = np.random.default_rng(1).normal(size=len(a))
    later = expm(0.5 * a) @ z
    assert later @ form @ later == pytest.approx(z @ form @ z, rel=1e-9)
    for losing in (arm(gear_damping=0.05), arm(servo_bandwidth=50.0)):
        drift = form @ np.asarray(losing.matrix(hit, True))
        assert np.linalg.eigvalsh(drift + drift.T).max() < 1e-9 * abs(drift).max()
        assert np.linalg.eigvalsh(drift + drift.T).min() < -1e-3


def test_force_follows_the_exponential_of_the_stated_system_and_nothing_that_is_to_come() -> None:
    held, hit = arm(gear_damping=0.05, servo_bandwidth=200.0, servo_position_gain=20.0), body(damping=100.0)
    t = STEP * np.arange(60)
    path = 0.2 * t - 1.5 * t**2
    course = _native.contact_course(held, hit, STEP, path, 0.0, 0)
    a = np.asarray(held.matrix(hit, True))
    m = len(a) // 2
    rate = a[0, m]
    # What contact adds to the system is the force per metre, and per metre a second, times the row of the gap.
    added, j = a - np.asarray(held.matrix(hit, False)), int(abs(LEVER).argmax())
    whole = np.zeros((len(a) + 2, len(a) + 2))
    whole[:-2, :-2], whole[-2, -1] = a, 1.0
    whole[:-2, -2], whole[:-2, -1] = added[:, j] / LEVER[j], added[:, m + j] / (LEVER[j] * rate)
    step = expm(STEP * whole)
    z = np.zeros(len(whole))
    for i in range(30):  # then they part
        z[-2], z[-1] = path[i], (path[i + 1] - path[i]) / STEP
        z = step @ z
        gap, speed = z[-2] + LEVER @ z[:6], z[-1] + rate * (LEVER @ z[m : m + 6])
        assert course.force[i + 1] == pytest.approx(STIFFNESS * gap + 100.0 * speed, rel=1e-9, abs=1e-9), i
    assert course.force[31] == 0
    changed = path.copy()
    changed[20:] += 0.01
    other = _native.contact_course(held, hit, STEP, changed, 0.0, 0)
    np.testing.assert_array_equal(course.force[:20], other.force[:20])
    assert other.force[20] > course.force[20] + 1
