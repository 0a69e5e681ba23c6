"""Planted rotors, servos and gears are found again, with errors that hold, and real arms tell what they can."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.errors import InputError
from bumpstop.identification.drive_train import (
    DriveTrainFit,
    Pushes,
    identify_drive_train,
    identify_gear_stiffness,
    identify_rotors,
    identify_servo,
)
from bumpstop.model import Joint, LinkInertia, Robot, load_drive_train, mass_matrix, with_rotors
from bumpstop.plant.command import COMMAND_STEP
from bumpstop.plant.drive import Gears
from bumpstop.plant.motions import pick_and_place
from bumpstop.plant.plant import Plant
from bumpstop.plant.sensors import Sensors
from bumpstop.plant.servo import Servo
from bumpstop.recording import Recording
from identification.drives import driven, drives, fourier
from identification.test_dynamics_fit import ROTOR, planted
from recording.cases import real

UR5E = Robot.load("ur5e")


def two_joints() -> Robot:
    """A rod that turns about the vertical, and one that swings on it."""
    rod = LinkInertia(mass=12.0, center=(0.2, 0, 0), tensor=((0.02, 0, 0), (0, 0.2, 0), (0, 0, 0.25)))
    other = LinkInertia(mass=6.0, center=(0.2, 0, 0), tensor=((0.01, 0, 0), (0, 0.09, 0), (0, 0, 0.1)))
    limits = {"lower": -3.0, "upper": 3.0, "velocity": 3.0}
    joints = (
        Joint(name="a", link="upper", inertia=rod, **limits),  # type: ignore[arg-type]
        Joint(name="b", link="lower", origin=(0.4, 0, 0), inertia=other, **limits),  # type: ignore[arg-type]
    )
    return Robot(name="two", joints=joints, tip_origin=(0.4, 0, 0), inertia_status="assumed")


def servoed(
    robot: Robot, w_v: float, w_p: float, feedforward: float, coulomb: float, *, seconds: float = 8.0, seed: int = 3
) -> Recording:
    """What a cascade makes of a reference, in steps of 0.1 ms by the full mass matrix, seen at 250 Hz.

    The gains are those that belong to the inertia about the middle of the motion. Friction is a steep slope here, and a
    set with a closed form in the fit.
    """
    every = 40
    t, q, qd, qdd = fourier(robot, seconds, 250.0 * every, seed)
    rotors = robot.drive_train.rotor_inertia
    matrix = mass_matrix(with_rotors(robot, rotors), q)
    moved = np.einsum("nii->ni", matrix).mean(axis=0)
    damping, h, slope = w_v * moved, t[1] - t[0], 2e-4
    e, rate = np.zeros(robot.dof), np.zeros(robot.dof)
    errors = np.empty_like(q)
    for k in range(t.size):
        errors[k] = e
        turning = np.tanh((qd[k] + rate) / slope)
        torque = -damping * (rate + w_p * e) - coulomb * turning - (1 - feedforward) * matrix[k] @ qdd[k]
        steep = coulomb / slope * (1 - turning**2)
        rate = rate + h * np.linalg.solve(matrix[k] + h * np.diag(damping + steep), torque)
        e = e + h * rate
    rng = np.random.default_rng(seed)
    seen = (q + errors)[::every] + 5e-6 * rng.normal(size=q[::every].shape)
    names = tuple(joint.name for joint in robot.joints)
    return Recording(t=t[::every], q=seen, q_ref=q[::every], joint_names=names, robot=robot.name, source="planted")


@pytest.mark.parametrize(("w_v", "w_p", "feedforward"), [(100.0, 25.0, 1.0), (60.0, 30.0, 0.3), (80.0, 15.0, 0.5)])
def test_planted_servos(w_v: float, w_p: float, feedforward: float) -> None:
    robot = two_joints()
    found = identify_servo([servoed(robot, w_v, w_p, feedforward, 3.0)], robot)
    for j in range(2):
        assert found.explained[j] > 0.99
        for values, truth, share in ((found.bandwidth, w_v, 0.15), (found.position_gain, w_p, 0.1)):
            if values.identified[j]:
                assert abs(values.values[j] - truth) < 4 * values.errors[j] + share * truth
    # The first joint's inertia changes by half with the elbow; the second's stays, but it feels the first's errors.
    assert abs(found.feedforward.values[0] - feedforward) < 0.25
    assert abs(found.feedforward.values[1] - feedforward) < 0.12
    assert found.bandwidth.identified[1]
    assert found.position_gain.identified.all()


def test_a_search_that_does_not_settle_gives_no_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = two_joints()
    log = servoed(robot, 80.0, 15.0, 0.5, 3.0, seconds=4.0)
    monkeypatch.setattr("bumpstop.identification.drive_train.servo_fit._MAX_SEARCH", 3)
    found = identify_servo([log], robot)
    for values in (found.bandwidth, found.position_gain, found.feedforward):
        assert values.reasons == ("the search did not settle in 3 steps",) * 2


def test_servos_that_show_nothing() -> None:
    robot = two_joints()
    log = servoed(robot, 100.0, 25.0, 1.0, 3.0, seconds=4.0)
    assert log.q_ref is not None
    perfect = identify_servo([replace(log, q=log.q_ref)], robot)
    assert perfect.bandwidth.reasons == ("it makes no error",) * 2
    assert not perfect.bandwidth.identified.any()
    still = identify_servo([replace(log, q=0 * log.q + 1e-5, q_ref=0 * log.q)], robot)
    assert still.position_gain.reasons == ("it hardly moves",) * 2
    rng = np.random.default_rng(1)
    noise = identify_servo([replace(log, q=log.q_ref + 1e-3 * rng.normal(size=log.q.shape))], robot)
    assert not noise.bandwidth.identified.any()
    assert "explains" in noise.bandwidth.reasons[0]
    with pytest.raises(InputError, match=r"^recording: has no reference; wanted q_ref_1 \.\."):
        identify_servo([replace(log, q_ref=None)], robot)


def test_the_servo_of_an_arm_in_mujoco() -> None:
    """Another simulator's cascade: a smooth motion shows gains, and a bandwidth where a joint is light and alone."""
    drive_train = UR5E.drive_train.with_values("acceleration_feedforward", 0.4, "assumed", "planted")
    q = np.deg2rad([0, -80, 100, -110, -90, 0])
    command = pick_and_place(UR5E, q, (0.2, 0.15, -0.15))
    gears = Gears(rotor_inertia=drive_train.rotor_inertia.tolist())
    log = Plant(UR5E, friction=gears, servo=Servo.of(drive_train), sensors=Sensors(rate_hz=250)).run(command).recording
    asked = command.q[np.round(log.t / COMMAND_STEP).astype(int).clip(max=len(command.q) - 1)]
    found = identify_servo([replace(log, q_ref=asked)], UR5E)
    told = found.position_gain.identified
    assert told[[0, 1, 2, 3, 5]].all()
    assert found.position_gain.reasons[4] == "it hardly moves"
    off = np.abs(found.position_gain.values - 25.0)[told]
    assert (off < 2 * found.position_gain.errors[told] + 0.02 * 25.0).all()
    assert found.bandwidth.values[5] == pytest.approx(100.0, rel=0.05)
    assert found.feedforward.values[5] == pytest.approx(0.4, abs=0.05)
    bandwidth = found.bandwidth
    assert not bandwidth.identified[:2].any()
    told = bandwidth.identified[:4]
    assert told.any()
    assert (np.abs(bandwidth.values[:4] - 100.0)[told] < 2 * bandwidth.errors[:4][told]).all()


def test_planted_rotors_from_torques() -> None:
    """In ten recordings the truth lies where the errors say."""
    truth = ROTOR / (1 + np.arange(6))
    beyond = []
    for seed in range(1, 11):
        found = identify_rotors([planted(UR5E, seed)], UR5E)
        told = found.identified
        assert told[0]
        assert told[2:5].all()
        beyond += list(np.abs(found.values[told] - truth[told]) > 1.96 * found.errors[told])
        np.testing.assert_allclose(found.values[told], truth[told], rtol=0.5)
    assert np.mean(beyond) < 0.2


def test_rotors_of_torques_behind_their_motion_are_not_told() -> None:
    """At 20 ms those of the wrists came out at half of what was planted, far beyond their errors."""
    log = replace(planted(UR5E, 1), source="log")
    assert log.tau is not None
    assert log.qd is not None
    late = replace(log, t=log.t[2:], q=log.q[2:], qd=log.qd[2:], tau=log.tau[:-2])
    found = identify_drive_train([late], UR5E)
    assert found.identified == ()
    assert found.reasons["rotor_inertia"].startswith("log: the torques lag behind the motion by 20 ms: do both")


def test_planted_rotors_from_currents() -> None:
    motion = fourier(UR5E, 40.0, 100.0, 2)
    torque = bs.model.inverse_dynamics(UR5E, *motion[1:])
    model = drives(UR5E, torque)
    found = identify_rotors([driven(UR5E, motion, model, 2)], UR5E)
    truth = np.array([joint.value("inertia") for joint in model.joints])
    told = found.identified
    assert told.sum() >= 3
    assert (np.abs(found.values[told] - truth[told]) < 5 * found.errors[told]).all()


def pushes(robot: Robot, stiffness: np.ndarray, count: int, seed: int, noise: float = 0.0) -> Pushes:
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2, 2, (count, robot.dof))
    force = 40 * rng.normal(size=(count, 3))
    jacobian = robot.jacobian(q)[:, :3]
    twist = np.einsum("nij,ni->nj", jacobian, force) / stiffness
    moved = np.einsum("nij,nj->ni", jacobian, twist)
    # As a nonlinear arm would: where the tip gets when the joints give by that.
    far = robot.pose(q + twist)[:, :3, 3] - robot.pose(q)[:, :3, 3]
    assert np.abs(far - moved).max() < 0.02 * np.abs(moved).max()
    return Pushes(q, force, displacement=far + noise * rng.normal(size=far.shape))


STIFFNESS = np.array([30e3, 30e3, 20e3, 6e3, 6e3, 3e3])


def test_planted_gears() -> None:
    exact = identify_gear_stiffness(pushes(UR5E, STIFFNESS, 30, 1), UR5E)
    assert exact.identified[:5].all()
    np.testing.assert_allclose(exact.values[:5], STIFFNESS[:5], rtol=0.05)
    # The flange is pushed on the axis of the last joint, which that does not load.
    assert exact.reasons[5] == "no push loads it"
    errors = []
    for seed in range(20):
        found = identify_gear_stiffness(pushes(UR5E, STIFFNESS, 40, seed, noise=2e-5), UR5E)
        told = found.identified
        assert told[:4].all()
        errors += list((np.abs(found.values - STIFFNESS) / found.errors)[told])
    assert np.mean(np.array(errors) > 2) < 0.15
    # Off the axis, the last one is loaded, too.
    off = Pushes(*[getattr(pushes(UR5E, STIFFNESS, 30, 1), name) for name in ("q", "force")], point=(0.1, 0, 0))
    jacobian = UR5E.jacobian(off.q, None, off.point)[:, :3]
    twist = np.einsum("nij,ni->nj", jacobian, off.force) / STIFFNESS
    found = identify_gear_stiffness(replace(off, twist=twist), UR5E)
    np.testing.assert_allclose(found.values, STIFFNESS, rtol=1e-9)
    partly = np.where(np.arange(6) == 2, np.nan, twist)
    assert identify_gear_stiffness(replace(off, twist=partly), UR5E).reasons[2] == "no push loads it"


def test_pushes_from_a_table(tmp_path: Path) -> None:
    made = pushes(UR5E, STIFFNESS, 25, 4)
    assert made.displacement is not None
    path = tmp_path / "pushes.csv"
    names = [f"q_{j}" for j in range(1, 7)] + [f"force_{x}_N" for x in "xyz"] + [f"displacement_{x}_mm" for x in "xyz"]
    rows = np.column_stack([made.q, made.force, 1e3 * made.displacement])
    path.write_text("\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n")
    read = identify_gear_stiffness(Pushes.load(path, UR5E), UR5E)
    np.testing.assert_allclose(read.values, identify_gear_stiffness(made, UR5E).values, rtol=1e-9)
    for old, new, message in (
        ("force_x_N", "force_x", r"'force_x' is no column of pushes; valid: q_1, "),
        ("q_6,", "q_7,", r"'q_7' is no column of pushes"),
    ):
        path.write_text(",".join(names).replace(old, new) + "\n")
        with pytest.raises(InputError, match=message):
            Pushes.load(path, UR5E)
    path.write_text(",".join(names[:9]) + "\n" + ",".join(["0"] * 9) + "\n")
    with pytest.raises(InputError, match=r"^pushes: measured nothing; wanted displacements"):
        identify_gear_stiffness(Pushes.load(path, UR5E), UR5E)
    path.write_text(",".join([*names[:8], *names[9:]]) + "\n")
    with pytest.raises(InputError, match=r"has no column 'force_z_N'; wanted force_x_N, "):
        Pushes.load(path, UR5E)


def test_tables_of_pushes_as_people_write_them(tmp_path: Path) -> None:
    """A hundred rows of whole numbers made the first decimal an error; zeros everywhere ended without a word."""
    head = ",".join(
        [f"q_{j}" for j in range(1, 7)] + [f"force_{x}_N" for x in "xyz"] + [f"twist_{j}" for j in range(1, 7)]
    )
    whole, half = ",".join(["0", "-1", "1", "-1", "-1", "0", "9", "5", "-4", *"000000"]), "," + ",".join(["0"] * 5)
    path = tmp_path / "pushes.csv"
    text = "\n".join([head, *[whole] * 150, whole.rsplit(",", 6)[0] + ",1e-4" + half]) + "\n"
    for written in (text, text.replace(",", "; "), "# of 3 May\n\n" + text.replace(",", "\t")):
        path.write_text(written, encoding="utf-8")
        read = Pushes.load(path, UR5E)
        assert read.twist is not None
        assert (len(read.q), read.twist[-1, 0], read.force[0, 2]) == (151, 1e-4, -4.0)
    path.write_text("\n".join([head, ",".join(["0"] * 15)]) + "\n", encoding="utf-8")
    assert set(identify_gear_stiffness(Pushes.load(path, UR5E), UR5E).reasons) == {"no push loads it"}
    for old, new, message in (
        ("9,5", "9,x", "row 2: force_y_N is 'x'; wanted a finite number"),
        ("9,5", "9,", "row 2: has no force_y_N; wanted pose and force"),
        ("0,0,0\n", "0,0,inf\n", "row 2: twist_6 is 'inf'; wanted"),
        (head, head + ",q_1", "has two columns 'q_1'"),
        (text, head, "has no rows"),
    ):
        path.write_text(text.replace(old, new), encoding="utf-8")
        with pytest.raises(InputError, match=message):
            Pushes.load(path, UR5E)


def test_pushes_in_another_unit_or_direction() -> None:
    """Twists in degrees gave gears a 57th as stiff, poses in degrees those of another arm, without a word."""
    made = pushes(UR5E, STIFFNESS, 30, 1)
    assert made.displacement is not None
    assert identify_drive_train([], UR5E, pushes=made).warnings == ()
    (warning,) = identify_drive_train([], UR5E, pushes=replace(made, displacement=57.3 * made.displacement)).warnings
    assert "arms like it" in warning
    # As with displacements in m.
    (warning,) = identify_drive_train([], UR5E, pushes=replace(made, displacement=1e-3 * made.displacement)).warnings
    assert "hardly as stiff as found" in warning
    assert "are displacements in mm" in warning
    with pytest.raises(InputError, match=r"^pushes\.q\[1\]: joint . at .* is outside its limits; valid: .* rad"):
        identify_gear_stiffness(replace(made, q=np.degrees(made.q)), UR5E)
    turned = identify_gear_stiffness(replace(made, force=-made.force), UR5E)
    assert turned.reasons[0] == "it gives against the force: is that the force on the arm?"


def test_what_is_found_becomes_a_drive_train_file(tmp_path: Path) -> None:
    log = replace(planted(UR5E, 1), source="monday.csv")
    found = identify_drive_train([log], UR5E, pushes=pushes(UR5E, STIFFNESS, 30, 1))
    assert isinstance(found, DriveTrainFit)
    assert found.identified == ("rotor_inertia", "gear_stiffness")
    assert found.reasons == {"servo_bandwidth": "no recording has references (q_ref)"}
    path = tmp_path / "drive_train.toml"
    found.save(path)
    again = load_drive_train(path, UR5E)
    assert again == found.drive_train
    own = UR5E.drive_train
    for name in found.identified:
        told = found.found[name].identified
        np.testing.assert_array_equal(getattr(again, name)[told], found.found[name].values[told])
        np.testing.assert_array_equal(getattr(again, name)[~told], getattr(own, name)[~told])
    # One gear was not loaded: the quantity is no better known than it.
    assert again.status["gear_stiffness"] == "assumed"
    assert again.source["gear_stiffness"].startswith("identified from static pushes for joint 1, 2, 3, 4, 5; a class")
    assert again.status["servo_bandwidth"] == "assumed"
    assert again.status["torque_limit"] == "published"
    with pytest.raises(InputError, match=r"^recordings: there are none, and no pushes"):
        identify_drive_train([], UR5E)
    unknown = replace(UR5E, joints=(replace(UR5E.joints[0], inertia=None), *UR5E.joints[1:]), inertia_status="unknown")
    assert "not known" in identify_drive_train([log], unknown).reasons["rotor_inertia"]
    with pytest.raises(InputError, match=r"^robot: The inertia of ur5e is not known"):
        identify_rotors([log], unknown)


def test_a_real_ur3e_at_25_hz() -> None:
    """Its servo is faster than its log: no figure is told, and why."""
    pytest.importorskip("fastexcel")
    log = Recording.load(real("ur3e_rtde/fig9.xlsx"))
    found = identify_servo([log.between(log.t[0], log.t[0] + 15)], Robot.load("ur3e"))
    assert not found.bandwidth.identified.any()
    assert all(found.bandwidth.reasons)
    # Its controller feeds accelerations forward.
    told = found.feedforward.identified
    assert told.any()
    assert (found.feedforward.values[told] > 0.9).all()


def test_a_real_ur10_shows_the_rotor_of_its_base() -> None:
    robot = Robot.load("ur10")
    log = Recording.load(real("ur10_ros2/ur10_exciting_trajectory.db3"), robot=robot)
    found = identify_rotors([log], robot)
    assert found.identified[0]
    assert 0.3 < found.values[0] < 3.0
