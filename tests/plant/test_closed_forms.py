"""What a plant of one joint does, beside closed forms: servo, gears, friction, energy, samples."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bumpstop.joint import JointParameters, JointTorqueModel, Parameter
from bumpstop.model import Robot, inverse_dynamics
from bumpstop.plant import Gears, Plant, Sensors, Servo
from bumpstop.plant.drive import Drives
from bumpstop.plant.sensors import SamplePlan
from plant.pendulum import CENTRE, GRAVITY, INERTIA, MASS, NONE, Floats, pendulum, steady, still, swing, without_end


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -20.0), (30.0, 0.0, 20.0)])
def test_the_servo_knows_the_torque_of_the_motion(gravity: tuple[float, float, float]) -> None:
    """Without friction the arm is where it should be; it would lag by what is left out over the servo's stiffness."""
    robot, command = pendulum(), swing(0.8, 0.5)
    run = Plant(robot, friction=Gears(rotor_inertia=1.0), gravity=gravity).run(command)
    stiffness = (INERTIA + 1.0) * (2 * math.pi * 100) ** 2
    shares = (
        np.abs(inverse_dynamics(robot, command.q, 0 * command.qd, 0 * command.qd, gravity=gravity)).max(),
        1.0 * np.abs(np.diff(command.qd, axis=0)).max() / 1e-3,
    )
    assert np.abs(run.trace.q - command.q[1:]).max() < 0.5 * min(shares) / stiffness


@pytest.mark.parametrize(("bandwidth", "damping"), [(20.0, 0.2), (40.0, 0.5)])
def test_the_servo_swings_as_its_figures_say(bandwidth: float, damping: float) -> None:
    """A jump of the command is overshot by exp(-pi d / sqrt(1 - d^2)), half a damped period later."""
    command = still()
    q = command.q.copy()
    q[101:] = 1e-3
    plant = Plant(pendulum(), servo=Servo(bandwidth_hz=bandwidth, damping_ratio=damping), gravity=NONE)
    run = plant.run(without_end(q, 0 * q))
    root = math.sqrt(1 - damping**2)
    highest = int(np.argmax(run.trace.q[:, 0]))
    assert run.trace.q[highest, 0] / 1e-3 - 1 == pytest.approx(math.exp(-math.pi * damping / root), rel=0.03)
    assert run.trace.t[highest] - 0.1005 == pytest.approx(0.5 / (bandwidth * root), abs=1.1e-3)


def test_a_soft_gear_sags_by_the_weight_over_its_stiffness() -> None:
    """The encoders, which are the motor's, do not see it; the truth does."""
    stiffness, angle = 800.0, 0.4
    plant = Plant(pendulum(rotor=0.3), friction=Gears(stiffness=stiffness, damping_ratio=1.0))
    run = plant.run(still(angle, 1.5))
    encoders, link = float(run.recording.q[-1, 0]), float(run.trace.q[-1, 0])
    assert encoders == pytest.approx(angle, abs=2e-4)
    sag = link - encoders
    assert sag == pytest.approx(MASS * GRAVITY * CENTRE * math.cos(link) / stiffness, rel=2e-3)
    # It hangs there from the beginning: nothing has to be lifted first.
    current = run.recording.current
    assert current is not None
    np.testing.assert_allclose(current[:, 0], -MASS * GRAVITY * CENTRE * math.cos(link), rtol=0.01)


def test_samples_are_of_one_instant() -> None:
    """Position, rate, acceleration and current of a sample fit Newton and Euler to rounding."""
    robot = pendulum(rotor=0.2)
    run = Plant(robot, sensors=Sensors(rate_hz=1000)).run(swing(1.5, 0.3))
    log, trace = run.recording, run.trace
    assert log.current is not None
    before = trace.qd - trace.qdd * 2e-4
    needed = inverse_dynamics(robot, log.q, before, trace.qdd)
    np.testing.assert_allclose(log.current, needed, rtol=0, atol=1e-7 * np.abs(needed).max())


@pytest.mark.parametrize("rate", [0.6, -0.6])
@pytest.mark.parametrize("load", [0.0, 0.25])
def test_friction_of_the_model_at_a_steady_rate(rate: float, load: float) -> None:
    """Motor torque B i, of which B (c sgn + v qd + load sgn |i|) stays in the gear."""
    unit, coulomb, viscous, robot = 0.1, 90.0, 30.0, pendulum(rotor=0.5)
    values = {
        "A": 0.0,
        "B": unit,
        "coulomb": coulomb,
        "viscous": viscous,
        "load": load,
        "hysteresis": 6.0,
        "inertia": 0.5,
    }
    joint = JointParameters(
        name="j",
        map="odd",
        friction="load_dependent",
        parameters={key: Parameter(value) for key, value in values.items()},
    )
    model = JointTorqueModel(robot="pendulum", created_from="test", unit="A", joints=(joint,))
    run = Plant(robot, model, sensors=Sensors(rate_hz=1000)).run(steady(rate, 1.0))
    log, trace = run.recording, run.trace
    assert log.current is not None
    rows = slice(300, 900)
    assert np.abs(trace.tau[rows, 0] - inverse_dynamics(robot, trace.q, trace.qd, trace.qdd)[rows, 0]).max() < 0.02
    current = (trace.tau + trace.friction)[rows, 0] / unit
    np.testing.assert_allclose(log.current[rows, 0], current, rtol=2e-3)
    sign = math.copysign(1.0, rate)
    kept = unit * (coulomb * sign + viscous * trace.qd[rows, 0] + load * sign * np.abs(current))
    np.testing.assert_allclose(trace.friction[rows, 0], kept, rtol=5e-3)


@pytest.mark.parametrize("rate", [0.6, -0.6])
def test_friction_that_grows_with_the_load_brakes_whatever_the_load(rate: float) -> None:
    """Power that is lost in the gear is never negative: gravity helps one way and hinders the other. It is a share of
    what goes into the gear."""
    run = Plant(pendulum(rotor=0.5), friction=Gears(load_share=0.2)).run(steady(rate, 1.0))
    trace = run.trace
    expected = 0.2 * np.abs(trace.tau + trace.friction)[:, 0] * math.copysign(1.0, rate)
    np.testing.assert_allclose(trace.friction[300:900, 0], expected[300:900], rtol=0.02)


def test_energy_of_a_swing_is_accounted_for() -> None:
    """What the motors give is what the gears keep, and what lifts and moves the link."""
    robot = pendulum(rotor=0.4)
    gears = Gears(load_share=0.1, stribeck=1.0, ripple=0.5, ripple_per_turn=40.0)
    run = Plant(robot, friction=gears, sensors=Sensors(rate_hz=1000)).run(swing(-1.2, 0.6))
    log, trace = run.recording, run.trace
    assert log.current is not None
    until = 300  # the middle, where it is fastest

    def work(torque: Floats) -> float:
        power = (torque * trace.qd)[:until, 0]
        return float(((power[1:] + power[:-1]) / 2).sum() * 1e-3)

    q, qd = float(trace.q[until - 1, 0]), float(trace.qd[until - 1, 0])
    gained = (INERTIA + 0.4) * qd**2 / 2 - MASS * GRAVITY * CENTRE * math.sin(q)
    kept = work(trace.friction)
    assert kept > 0.05 * abs(gained)
    assert work(log.current) == pytest.approx(kept + gained, rel=5e-3)


@pytest.mark.parametrize("rate", [250.0, 1000.0])
def test_jittered_samples_keep_their_order_and_their_place(rate: float) -> None:
    """However large the jitter: within 0.45 of a period, after the begin, and never two of one instant."""
    sensors = Sensors(rate_hz=rate, jitter_s=1.0)
    plan = SamplePlan.draw(sensors, 1, 10.0, 2e-4, 1e-3, seed=2)
    late = plan.step * 2e-4 - 1e-3 - np.arange(len(plan.step)) / rate
    assert plan.step.min() >= 1
    assert np.abs(late[1:]).max() <= 0.45 / rate + 1e-4 + 1e-9
    assert (np.abs(late) > 0.3 / rate).mean() > 0.9
    assert (np.diff(plan.step[plan.kept]) > 0).all()


def test_scatter_of_friction_is_that_of_its_sample_or_its_motion() -> None:
    draws = np.array([[1.0], [2.0], [3.0], [4.0]])
    rates = np.array([[0.5], [-0.5]])
    per_sample, per_motion = (
        Drives(pendulum(), None, Gears(scatter=2.0, scatter_per=per)).scattered(draws, np.array([1, 3]), rates)  # type: ignore[arg-type]
        for per in ("sample", "motion")
    )
    np.testing.assert_array_equal(per_sample, [[4.0], [8.0]])
    np.testing.assert_array_equal(per_motion, [[2.0], [-2.0]])


def test_stiction_of_the_gears_holds_no_more_than_itself() -> None:
    """Below the speed of rest what gears add falls with the rate, so that it never turns a joint round."""
    drives = Drives(pendulum(), None, Gears(stribeck=3.0, stribeck_speed=10.0))
    for share in (0.1, 0.5, 1.0, 2.0):
        qd = np.array([share * drives.rest[0]])
        damping, *_ = drives.resist(np.zeros(1), qd, np.zeros(1))
        assert (damping * qd)[0] == pytest.approx(3.0 * min(share, 1.0), rel=1e-5)


def test_the_joint_models_rotor_and_speed_of_rest_are_taken() -> None:
    values = {
        "A": 0.0,
        "B": 1.0,
        "coulomb": 2.0,
        "viscous": 0.0,
        "stribeck": 9.0,
        "stribeck_speed": 0.1,
        "inertia": 0.7,
        "hysteresis": 1.5,
    }
    joint = JointParameters(
        name="j",
        map="odd",
        friction="stribeck",
        parameters={key: Parameter(value) for key, value in values.items()},
        rest_speed=0.04,
    )
    model = JointTorqueModel(robot="pendulum", created_from="test", unit="A", joints=(joint,))
    drives = Drives(pendulum(rotor=0.2), model, Gears())
    assert drives.inertia[0] == 0.7
    # Between once and twice the speed of rest hysteresis goes.
    drives.reset(np.zeros(1), np.array([0.5]))
    at = [drives.resist(np.zeros(1), np.array([share * 0.04]), np.zeros(1)) for share in (1.0, 1.5, 1.99)]
    np.testing.assert_allclose([each[1][0] - each[3][0] for each in at], [1.5, 0.75, 0.015], rtol=1e-9)
    # Where friction falls with the rate it is still no drive.
    drives.reset(np.zeros(1), np.array([0.3]))
    damping, *_ = drives.resist(np.zeros(1), np.array([0.3]), np.zeros(1))
    assert damping[0] >= 0


def test_hysteresis_at_once_in_one_joint_and_over_a_way_in_another() -> None:
    one = pendulum().joints[0]
    robot = Robot(name="two", joints=(one, replace(one, name="k", link="m")))
    values = {"A": Parameter(0.0), "B": Parameter(1.0), "hysteresis": Parameter(5.0), "inertia": Parameter(0.0)}
    joints = tuple(
        JointParameters(
            name=name, map="odd", friction="power", parameters={**values, "D": Parameter(0.0), "F": Parameter(1.0)}
        )
        for name in ("j", "k")
    )
    model = JointTorqueModel(robot="two", created_from="test", unit="A", joints=joints)
    drives = Drives(robot, model, Gears(presliding=[0.0, 1e-2]))
    drives.reset(np.zeros(2))
    drives.resist(np.full(2, 1e-2), np.full(2, 1.0), np.zeros(2))
    against = drives.resist(np.full(2, 1e-2), np.zeros(2), np.zeros(2))[1]
    np.testing.assert_allclose(against, [5.0, 5.0 * (1 - math.exp(-1))], rtol=1e-9)
    # Creeping back turns round what has a way, and leaves the memory of the other as it is.
    creep = np.full(2, -0.005)
    against = (
        drives.resist(np.full(2, -1e-2), creep, np.zeros(2))[1]
        - drives.resist(np.full(2, -1e-2), creep, np.zeros(2))[3]
    )
    np.testing.assert_allclose(against, [5.0, 5.0 * (-1 + (2 - math.exp(-1)) * math.exp(-2))], rtol=1e-9)
    # A motion that begins at speed has turned it round already.
    drives.reset(np.zeros(2), np.full(2, -1.0))
    np.testing.assert_allclose(drives.resist(np.zeros(2), np.zeros(2), np.zeros(2))[1], -5.0)
