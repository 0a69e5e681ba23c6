"""Runs: what is recorded, what is true, and how the arm reacts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.trajectory.trajectory import load_motion
from bumpstop.errors import InputError
from bumpstop.model import inverse_dynamics
from bumpstop.plant import Gears, Plant, PlantObject, PlantReaction, Sample, Sensors, Servo, along, line
from bumpstop.plant.motions import pick_and_place, workspace
from bumpstop.recording import Recording
from plant.cases import (
    PRESSES,
    ROTORS,
    STANDARD,
    free_residual,
    hit_scenario,
    hits,
    joint_model,
    press_error,
    source_arm,
    source_plant,
)

DOWN = [0.0, 0.0, -0.05]
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
# Table 3.1 of Schroeder (2013): pick and place, mean and sd of joints 1 to 6 [Nm].
MEAN = np.array([4.4391, 0.2607, -5.6133, 1.5958, -5.6335, 0.1112])
SD = np.array([5.0078, 3.5832, 4.1414, 1.5317, 1.5256, 2.8138])


def below(ahead: float, kind: str = "hand_finger", **more: float) -> PlantObject:
    tip = source_arm().pose(STANDARD)[:3, 3]
    return PlantObject.of(kind, position=tip - [0, 0, ahead], normal=[0, 0, -1], **more)


def test_one_seed_one_recording(tmp_path: Path) -> None:
    sensors = Sensors(rate_hz=250, jitter_s=2e-4, loss=0.05, position_noise=1e-6, current_noise=1.0, force_noise=0.1)
    command = line(source_arm(), STANDARD, DOWN, duration=0.3, held_joints=[7])
    plant = source_plant(3, [below(0.008)], sensors)
    first, again = plant.run(command).recording, plant.run(command).recording
    other = source_plant(3, [below(0.008)], sensors).run(command)
    for log in (again, other.recording):
        for name in ("t", "q", "current", "wrench"):
            assert getattr(log, name).tobytes() == getattr(first, name).tobytes(), name
    changed = source_plant(4, [below(0.008)], sensors).run(command).recording
    assert first.current is not None
    assert changed.current is not None
    assert not np.array_equal(changed.current[:10], first.current[:10])
    read = Recording.load(other.save(tmp_path)[0])
    np.testing.assert_array_equal(read.q, first.q)
    assert read.robot == "sia5d"
    assert read.joint_names == tuple(joint.name for joint in source_arm().joints)


@pytest.mark.parametrize("rate", [250.0, 1000.0])
def test_samples_come_when_and_as_often_as_asked(rate: float) -> None:
    command = line(source_arm(), STANDARD, [0, 0, -0.005], duration=1.5, held_joints=[7])
    even = source_plant(1, sensors=Sensors(rate_hz=rate)).run(command)
    np.testing.assert_allclose(even.recording.t, 1e-3 + np.arange(round(1.5 * rate)) / rate, atol=1e-12)
    assert even.lost == 0
    uneven = source_plant(1, sensors=Sensors(rate_hz=rate, jitter_s=0.1 / rate, loss=0.1)).run(command)
    count = round(1.5 * rate)
    assert uneven.lost + len(uneven.recording.t) == count
    # Binomial, four standard deviations.
    assert abs(uneven.lost - 0.1 * count) < 4 * np.sqrt(0.09 * count)
    late = uneven.recording.t * rate % 1.0
    # Stamps say when samples were taken: their sd is the jitter's, rounded to integration steps.
    centred = (late - 1e-3 * rate + 0.5) % 1.0 - 0.5
    assert np.std(centred) == pytest.approx(np.hypot(0.1, 2e-4 * rate / np.sqrt(12)), rel=0.15)


def test_noise_and_steps_are_those_asked_for() -> None:
    # An arm whose current is its torque, standing: what varies is noise.
    robot = source_arm()
    quiet = Sensors(rate_hz=1000)
    loud = Sensors(rate_hz=1000, position_noise=3e-5, position_step=1e-5, current_noise=0.2, current_step=0.05)
    command = line(robot, STANDARD, [0, 0, -1e-4], duration=1.0, start="rest")
    runs = [Plant(robot, sensors=s, friction=Gears(rotor_inertia=ROTORS), seed=9).run(command) for s in (quiet, loud)]
    for name, sd, step in (("q", 3e-5, 1e-5), ("current", 0.2, 0.05)):
        clean, noisy = (getattr(run.recording, name) for run in runs)
        np.testing.assert_allclose(noisy / step, np.rint(noisy / step), atol=1e-6)
        # Rounding adds the variance of an even law; 1000 samples tell an sd to 2.2 %.
        expected = np.hypot(sd, step / np.sqrt(12))
        assert np.abs((noisy - clean).std(axis=0) / expected - 1).max() < 0.1


def test_steps_finer_than_a_number_change_nothing() -> None:
    robot, command = source_arm(), line(source_arm(), STANDARD, [0, 0, -1e-4], duration=0.1)
    plain, finest = (Plant(robot, sensors=Sensors(current_step=step)).run(command) for step in (0.0, 5e-324))
    np.testing.assert_array_equal(plain.recording.current, finest.recording.current)


def test_a_motion_that_blows_up_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo would go on from its own pose, and the recording would look like one."""
    monkeypatch.chdir(tmp_path)  # it writes a log where it stands
    plant = Plant(source_arm(), friction=Gears(rotor_inertia=1.0, stiffness=1e12))
    with pytest.raises(InputError, match="friction: the motion blows up: something swings too fast"):
        plant.run(line(source_arm(), STANDARD, DOWN, duration=0.1, held_joints=[7]))


def test_the_arm_goes_where_it_is_told_and_its_torque_is_ours() -> None:
    robot = source_arm()
    command = workspace(robot, 1, moves=2)
    run = source_plant(1).run(command)
    trace = run.trace
    assert np.abs(trace.q - command.q[1:]).max() < 2e-3
    # Newton-Euler along what the arm did, rotors beside it: what the gears passed on.
    ours = inverse_dynamics(robot, trace.q, trace.qd, trace.qdd) + trace.qdd * ROTORS
    # The accelerations are a step of 0.2 ms older than the rates.
    assert np.abs(ours - trace.tau).std() < 0.1


@pytest.mark.parametrize("name", ["sia5d", "ur10e"])
def test_every_move_through_the_workspace_is_one(name: str) -> None:
    """The middle of a UR lies below the floor: its motion begins in the first pose that does not."""
    command = workspace(bs.Robot.load(name), 2, moves=3)
    moves = np.abs(command.qd).max(axis=1) > 1e-2
    begins = np.flatnonzero(np.diff(moves.astype(int), prepend=0) == 1)
    assert len(begins) == 3


def test_the_wrist_feels_what_the_arm_touches() -> None:
    run = source_plant(1, [below(0.005)]).run(line(source_arm(), STANDARD, DOWN, duration=0.15, held_joints=[7]))
    log = run.recording
    assert log.wrench is not None
    forces = run.trace.contact_force[np.rint(log.t * 1e3).astype(int) - 1, 0]
    assert forces.max() > 100
    # From below it pushes the arm up: along -x of this tool, which points down.
    np.testing.assert_allclose(log.wrench[:, 0], -forces, atol=1e-3 * forces.max())
    assert np.abs(log.wrench[:, 1:3]).max() < 1e-3 * forces.max()
    # Statically the motors give J' F more; here half a newton-metre of it is the blow.
    with_contact = forces > 0
    np.testing.assert_allclose(forces[with_contact][0], 0, atol=20)


def test_an_object_pushes_back_with_its_stiffness() -> None:
    for kind, stiffness in (("foam", 3700.0), ("hand_finger", 75000.0)):
        thing = below(0.0, kind)
        stiff = source_plant(1, [])
        assert thing.stiffness == stiffness
        measured = stiff.series_stiffness(STANDARD, thing)
        # In series with the servo, w^2 times what each joint moves; joints move along the least-norm line.
        kp = stiff._gains(STANDARD)[0]
        lever = source_arm().jacobian(STANDARD)[2]
        assert measured == pytest.approx(1 / (1 / stiffness + np.sum(lever**2 / kp)), rel=0.005)


def test_gears_that_give_are_in_series() -> None:
    robot, gear = source_arm(), 20000.0
    plant = Plant(robot, friction=Gears(rotor_inertia=ROTORS, stiffness=[gear] * 4 + [np.inf] * 3))
    thing = below(0.0)
    lever = robot.jacobian(STANDARD)[2]
    kp = plant._gains(STANDARD)[0]
    expected = 1 / (1 / thing.stiffness + np.sum(lever**2 / kp) + np.sum(lever[:4] ** 2) / gear)
    assert expected < 0.6 * thing.stiffness
    # Under the load of a push a gear's own weight has sunk a little farther.
    assert plant.series_stiffness(STANDARD, thing) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(
    ("kind", "law"),
    [
        ("reverse", {}),
        ("stop", {}),
        ("reverse", {"deceleration": "constant_time", "stopping_time_s": 0.13}),
        ("stop", {"deceleration": "constant_time", "stopping_time_s": 0.13}),
        ("reverse", {"deceleration": "ramp", "ramp_time_s": 0.021}),
        ("stop", {"deceleration": "ramp", "ramp_time_s": 0.021, "stop_category": 0}),
        ("stop", {"stop_category": 0}),
    ],
)
def test_the_reaction_is_the_one_of_collision(kind: str, law: dict[str, Any]) -> None:
    """Along the same path, computed there by other code."""
    problem = bs.CollisionProblem.from_scenario(
        hit_scenario("standard, downward", "hand_finger").with_values(
            {"reaction.kind": kind, **{f"reaction.{key}": value for key, value in law.items()}}
        )
    )
    curve = bs.stopping_curve(problem, whole=True)
    tick = 30
    knot = tick * problem.period_steps + 1
    command = line(problem.robot, problem.q, list(problem.velocity), duration=1.0, held_joints=[7])
    tip = problem.robot.pose(command.q)[:, :3, 3]
    np.testing.assert_allclose((tip - tip[0]) @ curve.normal, curve.distance[: len(tip)], atol=1e-9)
    answer = PlantReaction(kind=kind, joint_acceleration=4.5, deceleration=problem.deceleration)  # type: ignore[arg-type]
    turned = command.reaction(knot, answer)
    way = (problem.robot.pose(turned.q)[:, :3, 3] - tip[0]) @ curve.normal
    (theirs,) = curve.kernel.reaction_paths([tick], [0.0])
    count = min(len(way), len(theirs))
    assert count > 10
    # They leap over steps where the path is smooth, to 1e-9 m.
    np.testing.assert_allclose(way[:count], theirs[:count], atol=3e-9)


def test_reactions_along_a_trajectory_stay_on_it() -> None:
    robot = source_arm()
    motion = load_motion(EXAMPLES / "06_pick_and_place.csv", robot)
    command = along(motion, robot)
    np.testing.assert_allclose(command.q[100], motion.at(0.1))
    for kind in ("stop", "reverse"):
        turned = command.reaction(400, PlantReaction(kind=kind, joint_acceleration=4.5))  # type: ignore[arg-type]
        np.testing.assert_allclose(turned.q[0], command.q[400])
        acceleration = np.diff(turned.q, 2, axis=0) / 1e-6
        assert np.abs(acceleration[5:-5]).max() < 5.5  # 4.5 at sub-steps; differences of millisecond rows round it
        for row in turned.q[:: max(1, len(turned.q) // 20)]:
            assert np.abs(command.q - row).max(axis=1).min() < 2e-3
        if kind == "stop":
            assert np.abs(np.diff(turned.q[-3:], axis=0)).max() == 0


def test_a_callback_turns_the_motion_after_its_latency() -> None:
    seen: list[float] = []

    def watch(sample: Sample) -> PlantReaction | None:
        seen.append(sample.t)
        return PlantReaction(latency_s=0.0035) if sample.contact_force[0] > 15 else None

    command = line(source_arm(), STANDARD, DOWN, duration=1.0, held_joints=[7])
    run = source_plant(1, [below(0.01)]).run(command, on_sample=watch)
    # Whole milliseconds, rounded up; and nobody is asked again.
    assert run.reaction_time == pytest.approx(np.ceil(seen[-1] * 1e3 + 3.5 - 1e-6) / 1e3)
    assert run.truth["run"]["reaction_s"] == run.reaction_time
    assert run.trace.contact_force[-1, 0] == 0
    assert run.trace.t[-1] < 1.0
    q_turn = run.trace.q[np.searchsorted(run.trace.t, run.reaction_time - 1e-9)]
    assert np.abs(q_turn - command.q[round(run.reaction_time * 1e3)]).max() < 1e-3  # type: ignore[operator]
    stopped = source_plant(1, [below(0.01)]).run(
        command, on_sample=lambda s: PlantReaction(kind="stop") if s.contact_force[0] > 15 else None
    )
    assert stopped.trace.contact_force[-1, 0] == pytest.approx(stopped.peak_force, rel=0.05)


def test_contact_torque_is_the_lever_times_the_force() -> None:
    found: list[Sample] = []
    plant = source_plant(1, [below(0.005)])
    plant.run(line(source_arm(), STANDARD, DOWN, duration=0.13, held_joints=[7]), on_sample=found.append)
    last = found[-1]
    lever = -source_arm().jacobian(plant.joint_positions())[2]
    assert last.contact_force[0] > 50
    np.testing.assert_allclose(last.contact_torque, lever * last.contact_force[0], rtol=1e-2, atol=1e-2)
    # The motors' extra torque has this sign: joint 2 is driven down by +q here, and must push.
    assert abs(last.contact_torque[1]) > 20


def test_peak_force_beside_the_exact_law() -> None:
    """Few seeds for a test; `make validate` has a hundred in three poses."""
    found = hits("standard, downward", "hand_finger", 12)
    # 3 %, and what twelve runs leave open at three standard errors.
    assert abs(found.ratio - 1) < 0.03 + 3 * found.ratio_error
    assert found.ratio_error < 0.04


def test_free_motion_beside_table_3_1() -> None:
    run = source_plant(1).run(pick_and_place(source_arm(), STANDARD))
    with_rotors, without = (free_residual(run, inertia=inertia) for inertia in (True, False))
    # The scatter of friction leaves the mean of 1250 samples open by 0.06 Nm.
    assert (np.abs(with_rotors.mean(axis=0)) <= np.abs(MEAN)).all()
    assert (with_rotors.std(axis=0) <= SD).all()
    moved = [1, 3]  # in this motion the others hardly accelerate
    assert (with_rotors.std(axis=0)[moved] < 0.95 * without.std(axis=0)[moved]).all()


@pytest.mark.parametrize(("kind", "speed", "limit", "into", "cutoff"), [PRESSES[0], PRESSES[5]])
def test_force_from_currents_while_pressing(kind: str, speed: float, limit: float, into: float, cutoff: float) -> None:
    found = press_error(kind, speed, 1, into, cutoff)
    assert found.outside < limit
    assert found.steady_rows > 0
    assert found.peak > 40


def test_gears_say_what_no_model_of_the_class_says() -> None:
    robot = source_arm()
    command = pick_and_place(robot, STANDARD)
    spread = []
    for gears in (Gears(rotor_inertia=ROTORS, scatter=0.0), Gears(rotor_inertia=ROTORS, scatter=0.0, ripple=2.0)):
        run = Plant(robot, joint_model(inertia=False), friction=gears, seed=1).run(command)
        spread.append(free_residual(run, inertia=True)[:, 1].std())
    # A sine of amplitude 2 Nm has an sd of 1.4 while the joint turns; the arm stands for a third of the time.
    assert spread[1] == pytest.approx(np.hypot(spread[0], 2 / np.sqrt(2)), rel=0.2)
    assert spread[1] > 1.3 * spread[0]


def turned(acceleration: object) -> object:
    command = line(source_arm(), STANDARD, DOWN, duration=0.1, held_joints=[7])
    return command.reaction(10, PlantReaction(joint_acceleration=acceleration))  # type: ignore[arg-type]


REFUSED = {
    "seed": ("seed", lambda: source_plant(-1)),
    "seed of text": ("seed", lambda: Plant(source_arm(), seed="1")),  # type: ignore[arg-type]
    "rate": ("sensors.rate_hz", lambda: Sensors(rate_hz=2000)),
    "loss": ("sensors.loss", lambda: Sensors(loss=1.0)),
    "servo": ("servo.bandwidth_hz", lambda: Servo(bandwidth_hz=1e4)),
    "two of a name": ("object.name", lambda: source_plant(1, [below(0.01), below(0.02)])),
    "inside": (
        "object 'hand_finger' position",
        lambda: source_plant(1, [below(-0.002)]).run(line(source_arm(), STANDARD, DOWN, duration=0.1)),
    ),
    "another arm's command": (
        "command",
        lambda: Plant(bs.Robot.load("ur5e")).run(line(source_arm(), STANDARD, DOWN, duration=0.1)),
    ),
    "gear without rotor": (
        "friction.rotor_inertia[1]",
        lambda: Plant(source_arm(), friction=Gears(stiffness=1e4)),
    ),
    "stiffness": ("object 'x' stiffness", lambda: below(0.01, name="x", stiffness=1e9)),  # type: ignore[arg-type]
    "mass": ("object 'plexiglas' mass", lambda: below(0.01, "plexiglas", mass=1e-6)),
    "normal": ("object 'foam' normal", lambda: PlantObject.of("foam", position=[0, 0, 0], normal=[0, 0, 0])),
    "kind": ("object.kind", lambda: below(0.01, "plexiglass")),
    "singular": ("pose", lambda: line(source_arm(), np.zeros(7), [0.0, 0, 0.05], duration=0.1, held_joints=[7])),
    "limits": ("pose[2]", lambda: line(source_arm(), [0, 9, 0, 0, 0, 0, 0], DOWN, duration=0.1)),
    "held": ("held_joints", lambda: line(source_arm(), STANDARD, DOWN, duration=0.1, held_joints=[8])),
    "too few joints": ("task", lambda: line(source_arm(), STANDARD, DOWN, duration=0.1, held_joints=[1, 2])),
    "start": ("start", lambda: line(source_arm(), STANDARD, DOWN, duration=0.1, start="moved")),  # type: ignore[arg-type]
    "task": ("task", lambda: line(source_arm(), STANDARD, DOWN, duration=0.1, task="line")),  # type: ignore[arg-type]
    "hold": ("hold", lambda: line(source_arm(), STANDARD, DOWN, duration=0.1, hold=math.nan)),
    "held text": (
        "held_joints",
        lambda: line(source_arm(), STANDARD, DOWN, duration=0.1, held_joints=["7"]),  # type: ignore[list-item]
    ),
    "no acceleration": (
        "joint_acceleration",
        lambda: line(
            source_arm(), STANDARD, DOWN, duration=0.1, start="rest", joint_acceleration=-1.0, held_joints=[7]
        ),
    ),
    "two accelerations": (
        "joint_acceleration",
        lambda: line(source_arm(), STANDARD, DOWN, duration=0.1, joint_acceleration=[4.5, 4.5], held_joints=[7]),
    ),
    "turn": ("reaction.kind", lambda: PlantReaction(kind="turn")),  # type: ignore[arg-type]
    "latency": ("reaction.latency_s", lambda: PlantReaction(latency_s=math.nan)),
    "reaction before its sample": ("reaction.latency_s", lambda: PlantReaction(latency_s=-0.1)),
    "acceleration of text": ("reaction.joint_acceleration", lambda: turned("fast")),
    "endless stribeck": ("friction.stribeck[1]", lambda: Plant(source_arm(), friction=Gears(stribeck=math.inf))),
    "endless noise": ("sensors.current_noise[1]", lambda: Plant(source_arm(), sensors=Sensors(current_noise=math.inf))),
    "rotor of text": ("friction.rotor_inertia", lambda: Plant(source_arm(), friction=Gears(rotor_inertia="x"))),  # type: ignore[arg-type]
    "damping of gears": ("friction.damping_ratio", lambda: Gears(damping_ratio=-1.0)),
    "size": ("object 'foam' size", lambda: below(0.01, "foam", size=(math.nan, 0.1))),  # type: ignore[arg-type]
    "reach": ("motion.offset_mm", lambda: pick_and_place(source_arm(), STANDARD, (2.0, 0, 0))),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals(case: str) -> None:
    field, call = REFUSED[case]
    with pytest.raises(InputError) as refused:
        call()  # type: ignore[no-untyped-call]
    assert refused.value.field == field


def test_near_names_of_objects_are_offered() -> None:
    with pytest.raises(InputError, match="did you mean 'plexiglas'"):
        below(0.01, "plexiglass")
