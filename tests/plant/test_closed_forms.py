"""An arm of one joint, or two, of which everything is known on paper: servo, gears, contact, friction, sensors."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from bumpstop.collision.trajectory import Trajectory
from bumpstop.errors import InputError
from bumpstop.joint import JointParameters, JointTorqueModel, Parameter
from bumpstop.model import Joint, LinkInertia, Robot, inverse_dynamics
from bumpstop.plant import Command, Experiment, Gears, Plant, PlantObject, Sample, Sensors, Servo, along, mjcf
from bumpstop.plant.drive import Drives
from bumpstop.plant.sensors import SamplePlan

MASS, CENTRE, ABOUT_CENTRE, LENGTH = 2.0, 0.3, 0.02, 0.5
INERTIA = ABOUT_CENTRE + MASS * CENTRE**2
GRAVITY = 9.80665
NONE = (0.0, 0.0, 0.0)
Floats = npt.NDArray[np.float64]


def pendulum(*, rotor: float = 0.0, kind: str = "revolute") -> Robot:
    """One joint about y with a heavy link along x; +q turns it down."""
    tensor = ((0.001, 0, 0), (0, ABOUT_CENTRE, 0), (0, 0, ABOUT_CENTRE))
    link = LinkInertia(mass=MASS, center=(CENTRE, 0, 0), tensor=tensor)
    joint = Joint(
        name="j",
        link="l",
        axis=(0, 1, 0) if kind == "revolute" else (0, 0, 1),
        kind=kind,  # type: ignore[arg-type]
        inertia=link,
        rotor_inertia=rotor,
        lower=-3,
        upper=3,
        velocity=20,
    )
    return Robot(name="pendulum", joints=(joint,), tip_origin=(LENGTH, 0, 0))


def still(q: float = 0.0, seconds: float = 0.5) -> Command:
    return along(Trajectory(np.array([0.0, 0.1]), np.full((2, 1), q)), pendulum(), hold=seconds - 0.1)


def swing(way: float, seconds: float) -> Command:
    """From rest to rest, with a hundred rows."""
    u = np.linspace(0, 1, 101)
    rows = (way * u**3 * (10 - 15 * u + 6 * u * u))[:, None]
    return along(Trajectory(u * seconds, rows), pendulum())


def steady(rate: float, seconds: float) -> Command:
    t = np.linspace(0, seconds, 51)
    return along(Trajectory(t, (rate * t)[:, None]), pendulum())


def without_end(q: Floats, qd: Floats) -> Command:
    def react(*_: object) -> tuple[Floats, Floats]:
        raise AssertionError

    return Command(q, qd, react)


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
    """A leap of the command is overshot by exp(-pi d / sqrt(1 - d^2)), half a damped period later."""
    command = still()
    q = command.q.copy()
    q[101:] = 1e-3
    plant = Plant(pendulum(), servo=Servo(bandwidth_hz=bandwidth, damping_ratio=damping), gravity=NONE)
    run = plant.run(without_end(q, 0 * q))
    root = math.sqrt(1 - damping**2)
    highest = int(np.argmax(run.trace.q[:, 0]))
    assert run.trace.q[highest, 0] / 1e-3 - 1 == pytest.approx(math.exp(-math.pi * damping / root), rel=0.03)
    assert run.trace.t[highest] - 0.1005 == pytest.approx(0.5 / (bandwidth * root), abs=1.1e-3)


@pytest.mark.parametrize("stiffness", [math.inf, 2000.0])
@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_what_gives_is_in_series(stiffness: float, kind: str) -> None:
    """1/K = 1/K_object + n'J (1/w^2 m + 1/K_gear) J'n, m being the rotor where the gear gives."""
    rotor, own = 0.4, 3700.0
    robot, servo = pendulum(rotor=rotor, kind=kind), Servo(bandwidth_hz=15.0)
    turns = kind == "revolute"
    plant = Plant(robot, friction=Gears(stiffness=stiffness), servo=servo, gravity=NONE)
    moved = rotor + ((INERTIA if turns else MASS) if math.isinf(stiffness) else 0.0)
    lever = LENGTH if turns else 1.0
    give = lever**2 * (1 / (moved * (2 * math.pi * 15.0) ** 2) + 1 / stiffness)
    normal = (0, 0, -1) if turns else (0, 0, 1)
    thing = PlantObject.of("foam", position=(0, 0, 0), normal=normal)
    assert plant.series_stiffness([0.0], thing) == pytest.approx(1 / (1 / own + give), rel=8e-3)
    # In the field of gravity, and at half the lever.
    near = Plant(
        robot,
        friction=Gears(stiffness=stiffness),
        servo=servo,
        contact_link="l",
        contact_point=(0.5 * LENGTH, 0, 0),
    )
    nearby = give / 4 if turns else give
    assert near.series_stiffness([0.0], thing) == pytest.approx(1 / (1 / own + nearby), rel=8e-3)


def test_a_soft_gear_sags_by_the_weight_over_its_stiffness() -> None:
    """The encoders, which are the motor's, do not see it; the truth does."""
    stiffness, angle = 800.0, 0.4
    plant = Plant(pendulum(rotor=0.3), friction=Gears(stiffness=stiffness, damping_ratio=1.0))
    run = plant.run(still(angle, 1.5))
    encoders, link = float(run.recording.q[-1, 0]), float(run.trace.q[-1, 0])
    assert encoders == pytest.approx(angle, abs=2e-4)
    sag = link - encoders
    assert sag == pytest.approx(MASS * GRAVITY * CENTRE * math.cos(link) / stiffness, rel=2e-3)
    # It hangs there from the begin: nothing has to be lifted first.
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


def test_each_object_has_its_own_force_and_contact_torque_is_that_of_the_touching_link() -> None:
    robot = pendulum(rotor=2.0)
    point = (0.8 * LENGTH, 0.0, 0.0)

    def plate(name: str, q: float) -> PlantObject:
        """In the way of the point, where it gets at q."""
        x, y, z = robot.pose([q], "l", point)[:3, 3].tolist()
        return PlantObject.of("foam", name=name, position=(x, y, z), normal=(-math.sin(q), 0, -math.cos(q)))

    seen: list[Sample] = []
    away = replace(plate("away", 0.1), position=(0.0, 5.0, 0.0))
    plant = Plant(robot, objects=[away, plate("there", 0.1)], contact_link="l", contact_point=point)
    plant.run(swing(0.12, 0.2), on_sample=seen.append)
    last = seen[-1]
    assert last.contact_force[0] == 0
    assert last.contact_force[1] > 20
    # The plate turns its face a little while the arm goes on: the lever is that of its normal.
    assert last.contact_torque[0] == pytest.approx(0.8 * LENGTH * last.contact_force[1], rel=1e-2)


def test_the_wrist_feels_moments_and_has_noise_of_its_own() -> None:
    robot = pendulum(rotor=0.5)
    loud = Sensors(rate_hz=1000, force_noise=0.3, moment_noise=0.02, position_noise=1e-5, current_noise=0.2)
    runs = [Plant(robot, sensors=sensors, seed=3).run(still(0.3, 2.0)) for sensors in (Sensors(rate_hz=1000), loud)]
    clean, noisy = (run.recording for run in runs)
    assert clean.wrench is not None
    assert noisy.wrench is not None
    assert clean.current is not None
    assert noisy.current is not None
    # 2000 samples tell an sd to 1.6 %.
    spread = (noisy.wrench - clean.wrench).std(axis=0)
    np.testing.assert_allclose(spread, [0.3] * 3 + [0.02] * 3, rtol=0.08)
    rows = np.column_stack([noisy.wrench - clean.wrench, noisy.q - clean.q, noisy.current - clean.current])
    between = np.corrcoef(rows.T) - np.eye(8)
    assert np.abs(between).max() < 0.1  # four and a half standard errors
    # What touches beside the tip twists the wrist.
    point = (LENGTH, 0.05, 0.0)
    thing = PlantObject.of("foam", position=robot.pose([0.1], "l", point)[:3, 3].tolist(), normal=(0, 0, -1))
    run = Plant(robot, objects=[thing], contact_point=(0.0, 0.05, 0.0)).run(swing(0.12, 0.3))
    assert run.recording.wrench is not None
    wrench, force = run.recording.wrench[-1], run.trace.contact_force[-1, 0]
    assert force > 10
    # The object pushes up: R'(0, 0, F) at 50 mm along y twists by 50 mm F about x, and the part along x about z.
    q = float(run.trace.q[-1, 0])
    tool = np.array([-math.sin(q), 0.0, math.cos(q)]) * force
    np.testing.assert_allclose(wrench[:3], tool, atol=0.02 * force)
    np.testing.assert_allclose(wrench[3:], np.cross([0, 0.05, 0], tool), atol=0.02 * 0.05 * force)


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


def test_a_plate_swings_and_comes_to_rest_as_its_figures_say() -> None:
    """With 0.3 of the critical damping where nothing is said: each half swing leaves exp(-0.3 pi / sqrt(0.91))."""
    import mujoco

    plate = PlantObject(name="plate", position=(2, 0, 0), normal=(0, 1, 0), stiffness=3700.0, mass=1.0)
    model = mujoco.MjModel.from_xml_string(mjcf(pendulum(), objects=[plate]))
    data = mujoco.MjData(model)
    data.joint(plate.geom).qpos[0] = 0.01
    path = []
    for _ in range(1000):
        mujoco.mj_step(model, data)
        path.append(float(data.joint(plate.geom).qpos[0]))
    assert -min(path) / 0.01 == pytest.approx(math.exp(-0.3 * math.pi / math.sqrt(0.91)), rel=0.02)
    assert int(np.argmin(path)) * 2e-4 == pytest.approx(math.pi / math.sqrt(0.91 * 3700), rel=0.02)


def test_a_face_is_as_wide_and_as_high_as_told() -> None:
    """Of a wall the width is level."""
    import mujoco

    wall = PlantObject(name="wall", position=(2, 0, 0), normal=(0.6, 0.8, 0), stiffness=3700.0, size=(0.2, 0.05))
    model = mujoco.MjModel.from_xml_string(mjcf(pendulum(), objects=[wall]))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    axes = data.geom(wall.geom).xmat.reshape(3, 3)
    width, height, _ = model.geom(wall.geom).size
    assert (width, height) == (0.2, 0.05)
    assert abs(axes[2, 0]) < 1e-12
    assert abs(axes[2, 1]) == pytest.approx(1.0)


def test_what_touches_is_a_ball_about_the_contact_point() -> None:
    """In the frame of a tip that is turned, and in that of its link."""
    import mujoco

    turned = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    robot = replace(pendulum(), tip_rotation=turned)
    for link in (None, "l"):
        model = mujoco.MjModel.from_xml_string(mjcf(robot, contact_link=link, contact_point=(0.01, 0.02, 0.03)))
        data = mujoco.MjData(model)
        data.qpos[0] = 0.3
        mujoco.mj_forward(model, data)
        place = robot.pose([0.3], link, (0.01, 0.02, 0.03))[:3, 3]
        np.testing.assert_allclose(data.geom(":tool").xpos, place, atol=1e-12)


def urdf(joints: int) -> str:
    """So many links of half a metre, one behind the other, about parallel axes."""
    parts = ['<robot name="flap"><link name="l0"/>']
    for j in range(joints):
        parts.append(
            f'<joint name="j{j}" type="revolute"><origin xyz="{0.5 if j else 0} 0 0"/><parent link="l{j}"/>'
            f'<child link="l{j + 1}"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2" effort="1"/></joint>'
            f'<link name="l{j + 1}"><inertial><origin xyz="0.3 0 0"/><mass value="3"/>'
            '<inertia ixx="0.03" ixy="0" ixz="0" iyy="0.04" iyz="0" izz="0.04"/></inertial></link>'
        )
    end = f'<joint name="end" type="fixed"><origin xyz="0.5 0 0"/><parent link="l{joints}"/><child link="tip"/></joint>'
    return "".join([*parts, end, '<link name="tip"/></robot>'])


@pytest.mark.parametrize("more", [0, 2])
def test_arms_without_a_straight_line_may_touch(tmp_path: Path, more: int) -> None:
    """One joint, or three about parallel axes: no tip that goes where it is told is no reason to lose a run."""
    (tmp_path / "flap.urdf").write_text(urdf(1 + more), encoding="utf-8")
    names = "".join(f",q_{j + 1}" for j in range(1 + more))
    rows = "".join(f"{t},{q}{',0' * more}\n" for t, q in ((0, 0), (0.1, 0.02), (0.2, 0.05)))
    (tmp_path / "way.csv").write_text(f"t{names}\n{rows}", encoding="utf-8")
    data = {
        "robot": "flap.urdf",
        "friction": {"rotor_inertia_kg_m2": 0.5},
        "motion": {"kind": "trajectory", "file": "way.csv"},
        "object": [{"kind": "foam", "position_mm": [500.0 * (1 + more), 0.0, -5.0], "normal": [0, 0, -1]}],
    }
    run = Experiment.from_dict(data, tmp_path).run()
    assert run.peak_force > 0
    assert 0.97 * 3700 < run.truth["object"][0]["series_stiffness_N_m"] < 3700


def test_a_face_along_which_the_arm_only_slides_is_refused() -> None:
    thing = PlantObject.of("foam", position=(0, 0, 0), normal=(0, 1, 0))
    with pytest.raises(InputError, match="the arm does not move along the object's normal here"):
        Plant(pendulum()).series_stiffness([0.2], thing)
