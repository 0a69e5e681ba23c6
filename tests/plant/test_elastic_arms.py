"""Arms whose gears give, in MuJoCo, beside the linear equations with equal parameters; gauges; servos in cascade."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from bumpstop.errors import InputError
from bumpstop.model import Robot, mass_matrix
from bumpstop.plant import (
    Experiment,
    Gears,
    Plant,
    PlantObject,
    PlantReaction,
    PlantRun,
    Sample,
    Servo,
    gauge_regions,
    line,
)
from bumpstop.plant.objects import rubber_modulus
from cli.support import run
from plant.pendulum import pendulum
from plant.test_closed_forms import still, without_end
from reference.elastic_arm import Body, ElasticArm, collide

Floats = npt.NDArray[np.float64]

POSE = np.radians([0, -75.7, 102.6, -116.9, -90, 0])
ROTORS = [1.5, 1.5, 0.9, 0.3, 0.3, 0.3]
GEARS = [30e3, 30e3, 20e3, 6e3, 6e3, 6e3]
DOWN = np.array([0.0, 0.0, -1.0])
AHEAD = 0.004


def gears() -> Gears:
    return Gears(rotor_inertia=ROTORS, stiffness=GEARS, damping=[30.0, 30.0, 20.0, 4.0, 2.0, 0.5])


def blow(servo: Servo, thing: PlantObject, speed: float, reacts_N: float) -> tuple[PlantRun, Floats]:
    """A line into an object, and how far the contact point was told to go, by the millisecond from the start on [m]."""
    robot = Robot.load("ur10e")
    # With gravity the links hang in their gears, and contact begins a little sooner than along the command.
    plant = Plant(robot, friction=gears(), servo=servo, objects=[thing], gravity=(0, 0, 0))
    answer = PlantReaction(kind="stop", joint_acceleration=6.0, latency_s=0.008)

    def watch(sample: Sample) -> PlantReaction | None:
        return answer if sample.contact_force[0] > reacts_N else None

    command = line(robot, POSE, speed * DOWN, duration=AHEAD / speed + 0.15, start="moving")
    run = plant.run(command, on_sample=watch)
    q = command.q
    if run.reaction_time is not None:
        knot = round(run.reaction_time * 1000)
        q = np.concatenate([q[:knot], command.reaction(knot, answer).q])
    along = (robot.pose(q)[:, :3, 3] - robot.pose(POSE)[:3, 3]) @ DOWN
    return run, along


def linear(servo: Servo, body: Body, along: Floats) -> tuple[float, float]:
    """Peak force and peak measured force of the linear equations about the pose of contact."""
    robot = Robot.load("ur10e")
    M, given = mass_matrix(robot, POSE), gears()
    jacobian = robot.jacobian(POSE)
    damping = np.asarray(servo.velocity_bandwidth) * (np.array(ROTORS) + np.diag(M))
    arm = ElasticArm(
        mass_matrix=M,
        rotor_inertia=ROTORS,
        gear_stiffness=GEARS,
        gear_damping=given.damping,  # type: ignore[arg-type]
        servo_stiffness=np.asarray(servo.position_gain) * damping,
        servo_damping=damping,
        lever=DOWN @ jacobian[:3],
        rates=np.linalg.pinv(jacobian) @ [*DOWN, 0, 0, 0],
        feedforward=servo.acceleration_feedforward,
        feeds_motors=True,
    )
    found = collide(arm, body, along, 0.001, offset=AHEAD)
    return found.peak_force, found.peak_measured


def below(**more: object) -> dict[str, object]:
    x, y, z = Robot.load("ur10e").pose(POSE)[:3, 3]
    return {"position": (x, y, z - AHEAD), "normal": (0, 0, -1), **more}


@pytest.mark.parametrize("share", [0.0, 1.0])
@pytest.mark.parametrize(
    ("stiffness", "speed", "bandwidth", "gain", "reacts_N"),
    [(75e3, 0.16, 60.0, 10.0, 1e9), (75e3, 0.25, 150.0, 25.0, 60.0), (10e3, 0.16, 150.0, 25.0, 15.0)],
)
def test_peak_forces_are_those_of_the_linear_equations(
    share: float, stiffness: float, speed: float, bandwidth: float, gain: float, reacts_N: float
) -> None:
    servo = Servo(velocity_bandwidth=bandwidth, position_gain=gain, acceleration_feedforward=share)
    thing = PlantObject(name="x", stiffness=stiffness, **below())  # type: ignore[arg-type]
    run, along = blow(servo, thing, speed, reacts_N)
    assert (run.reaction_time is None) == (reacts_N > 1e6)
    expected, _ = linear(servo, Body(stiffness=stiffness), along)
    assert run.peak_force == pytest.approx(expected, rel=0.03)
    rigid = stiffness * (along.max() - AHEAD)
    assert run.peak_force < 0.8 * rigid


def test_a_free_body_takes_what_two_masses_give() -> None:
    servo = Servo(velocity_bandwidth=100.0, position_gain=20.0)
    thing = PlantObject(name="x", stiffness=75e3, body_mass=3.0, **below())  # type: ignore[arg-type]
    run, along = blow(servo, thing, 0.25, 1e9)
    expected, _ = linear(servo, Body(stiffness=75e3, mass=3.0), along)
    assert run.peak_force == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("region", ["hand", "chest", "abdomen"])
def test_a_gauge_shows_what_the_equations_say(region: str) -> None:
    servo = Servo(velocity_bandwidth=100.0, position_gain=20.0, acceleration_feedforward=0.0)
    gauge = PlantObject.gauge(region, **below())  # type: ignore[arg-type]
    run, along = blow(servo, gauge, 0.2, 1e9)
    assert gauge.spring is not None
    assert gauge.body_mass is not None
    body = Body(
        stiffness=gauge.stiffness,
        damping=gauge.damping,
        mass=gauge.body_mass,
        spring=gauge.spring,
        spring_damping=2 * gauge.spring_damping_ratio * math.sqrt(gauge.spring * gauge.body_mass),
    )
    _, expected = linear(servo, body, along)
    assert run.trace.measured_force.max() == pytest.approx(expected, rel=0.03)
    assert run.truth["run"]["peak_measured_force_N"] == [pytest.approx(run.trace.measured_force.max())]


def test_pressed_slowly_a_gauge_shows_what_presses_it() -> None:
    robot = pendulum(rotor=0.5)
    x, y, z = robot.pose(np.array([0.0]))[:3, 3]
    gauge = PlantObject.gauge("hand", position=(x, y, z - 1e-4), normal=(0, 0, -1))
    plant = Plant(robot, objects=[gauge], gravity=(0, 0, 0))
    series = 1 / (1 / gauge.stiffness + 1 / 75e3)
    kp = plant._gains(np.zeros(1))[0]
    give = float(robot.jacobian(np.zeros(1))[2, 0] ** 2 / kp[0])
    assert plant.series_stiffness([0.0], gauge) == pytest.approx(1 / (1 / series + give), rel=0.01)


def test_pads_are_gents_rubber() -> None:
    """Natural rubber of 50 Shore A has 2.2 to 2.5 MPa in tables."""
    assert 2.2e6 < rubber_modulus(50) < 2.6e6
    assert rubber_modulus(70) > rubber_modulus(30) > rubber_modulus(10)
    springs = {region: PlantObject.gauge(region, **below()).spring for region in gauge_regions()}  # type: ignore[arg-type]
    assert springs["hand"] == 75e3
    assert springs["abdomen"] == 10e3
    assert len(springs) == 8


def test_a_cascade_is_as_stiff_as_its_gains_and_bounded_by_its_limit() -> None:
    """A jump of the command by x asks for P x at once; a limited motor gives no more than its limit."""
    command = still()
    q = command.q.copy()
    q[101:] = 1e-3
    moved = 0.3 + float(mass_matrix(pendulum(), np.zeros(1))[0, 0])
    peaks = {}
    for limit in (math.inf, 0.4):
        servo = Servo(velocity_bandwidth=60.0, position_gain=20.0, torque_limit=limit)
        plant = Plant(pendulum(rotor=0.3), servo=servo, gravity=(0, 0, 0))
        run = plant.run(without_end(q, 0 * q))
        peaks[limit] = float(np.abs(run.trace.tau).max())
        assert run.trace.q[-1, 0] == pytest.approx(1e-3, rel=0.01)
    wanted = 60.0 * 20.0 * moved * 1e-3
    # Forces are noted every millisecond, by when the motor has moved.
    assert 0.85 * wanted < peaks[math.inf] < wanted
    assert wanted > 0.5
    assert peaks[0.4] == pytest.approx(0.4, rel=1e-6)


def test_gears_and_servo_of_a_drive_train() -> None:
    robot = Robot.load("ur10e")
    train = robot.drive_train
    given = Gears.of(robot, POSE)
    inertia = np.diag(mass_matrix(robot, POSE))
    reduced = train.rotor_inertia * inertia / (train.rotor_inertia + inertia)
    np.testing.assert_allclose(given.damping, 2 * train.gear_damping * np.sqrt(train.gear_stiffness * reduced))  # type: ignore[arg-type]
    servo = Servo.of(train)
    kp, kv = Plant(robot, friction=given, servo=servo)._gains(POSE)
    np.testing.assert_allclose(kv, train.servo_bandwidth * (train.rotor_inertia + inertia))
    np.testing.assert_allclose(kp, train.servo_position_gain * kv)


def test_an_experiment_file_has_cascade_and_gauge(tmp_path: Path) -> None:
    text = """
robot = "ur10e"
pose_deg = [0, -75.7, 102.6, -116.9, -90, 0]
[motion]
kind = "line"
velocity_mm_s = [0, 0, -100]
duration_s = 0.15
start = "moving"
[friction]
rotor_inertia_kg_m2 = [1.5, 1.5, 0.9, 0.3, 0.3, 0.3]
stiffness_Nm_rad = [30000, 30000, 20000, 6000, 6000, 6000]
damping_Nm_s_rad = [30, 30, 20, 4, 2, 0.5]
[servo]
velocity_bandwidth_rad_s = 60
position_gain_1_s = 10
torque_limit_Nm = [330, 330, 150, 56, 56, 56]
acceleration_feedforward = 0.5
[[object]]
kind = "gauge_hand"
ahead_mm = 4
"""
    file = tmp_path / "experiment.toml"
    file.write_text(text)
    run = Experiment.load(file).run()
    (thing,) = run.truth["object"]
    assert thing["spring_N_m"] == 75000
    assert thing["status"] == "assumed"
    assert 30 < run.truth["run"]["peak_measured_force_N"][0] < 120
    for old, new, problem in (
        ("position_gain_1_s = 10\n", "", "position_gain"),
        ("gauge_hand", "gauge_toe", "toe"),
        ("acceleration_feedforward = 0.5", "acceleration_feedforward = 1.5", "acceleration_feedforward"),
        ("torque_limit_Nm = [330, ", "torque_limit_Nm = [", "torque_limit"),
    ):
        file.write_text(text.replace(old, new))
        with pytest.raises(InputError, match=problem):
            Experiment.load(file).prepare()


def test_a_gauge_needs_a_body() -> None:
    gauge = PlantObject.gauge("hand", **below())  # type: ignore[arg-type]
    for change, problem in (({"body_mass": None}, "body_mass"), ({"spring": 0.0}, "spring")):
        with pytest.raises(InputError, match=problem):
            replace(gauge, **change)  # type: ignore[arg-type]


def test_the_command_tells_what_a_gauge_shows() -> None:
    done = run("plant", "run", Path(__file__).parents[2] / "examples/plant/06_gauge.toml")
    assert done.status == 0
    told = next(text for text in done.out.splitlines() if text.startswith("gauge_hand"))
    assert "on 0.5 kg on a spring of 75000 N/m, shows " in told
    shown, felt = (float(part.split()[1]) for part in (told[told.index("shows") :], told[told.index("peak") :]))
    # The pad's mass takes part in the blow.
    assert 60 < shown < felt < 1.2 * shown
