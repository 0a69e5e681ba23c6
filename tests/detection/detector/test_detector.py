"""The detector: residuals against closed forms, noise, missing data, and what does not belong together."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.detection import Detector, DetectorSettings, Thresholds, residual_record
from bumpstop.detection.tuning.residual_record import ResidualRecord, write_residuals
from bumpstop.joint import JointTorqueModel
from bumpstop.model import Joint, LinkInertia, Robot, gravity_torque, inverse_dynamics
from bumpstop.recording import Recording
from detection.moving_arms import DT, FILLING, UR5E, live, moving, parabola


def joint_model(names: list[str], drives: list[dict[str, float]]) -> JointTorqueModel:
    """A model of joints whose torque is the slope B times the current, and what turns with the motor."""
    from bumpstop.joint import JointParameters, Parameter

    joints = tuple(
        JointParameters(
            name=name,
            map="odd",
            friction="power",
            parameters={"inertia": None}
            | {key: Parameter(value) for key, value in ({"D": 0.0, "F": 1.0, "hysteresis": 0.0} | drive).items()},
            rest_speed=0.01,
        )
        for name, drive in zip(names, drives, strict=True)
    )
    return replace(JointTorqueModel.load("sia5d"), robot="ur5e", joints=joints)


# --- Residuals --------------------------------------------------------------------------------------------------------


def test_direct_residual_of_exact_data_is_zero_to_rounding() -> None:
    t, q, _, _, tau = parabola(UR5E)
    run = Detector(UR5E, None, [1.0] * 6).run(Recording(t=t, q=q, tau=tau))
    # Rounding of q enters the acceleration by its noise gain, 720 / (m (m^2 - 1) (m^2 - 4)) under the root, over dt^2.
    gain = math.sqrt(720 / (8 * 63 * 60)) / DT**2
    bound = 2**-52 * gain * np.abs(q).max() * np.abs(tau).max() * 8
    assert np.nanmax(np.abs(run.residual)) < bound < 1e-7
    assert run.events == ()


def test_observer_error_falls_as_the_square_of_the_sample_time() -> None:
    """With the true rates; the derivative's own error is of its own order."""
    errors = []
    for dt in (0.004, 0.002, 0.001):
        t, q, qd, _, tau = moving(UR5E, round(2 / dt), dt)
        given_settings = DetectorSettings(residual="observer", measured_rates=True)
        run = Detector(UR5E, None, [1e3] * 6, given_settings).run(Recording(t=t, q=q, qd=qd, tau=tau))
        errors.append(np.nanmax(np.abs(run.residual[t > 0.5])))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.05)


def test_observer_answers_a_step_in_closed_form() -> None:
    """Of a torque held by the motors: 1 - a^k (1 + a) / 2, k samples after the first that has it."""
    t = DT * np.arange(300)
    q = np.full((300, 6), 0.3)
    tau = np.repeat(inverse_dynamics(UR5E, q[:1], 0 * q[:1], 0 * q[:1]), 300, axis=0)
    tau[100:, 2] += 7.0
    tau = live(tau)
    given_settings = DetectorSettings(residual="observer", observer_gain_1_s=40.0)
    run = Detector(UR5E, None, [1e3] * 6, given_settings).run(Recording(t=t, q=q, tau=tau))
    a, k = math.exp(-40 * DT), np.arange(200)
    np.testing.assert_allclose(run.residual[100:, 2], 7 * (1 - a**k * (1 + a) / 2), rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(run.residual[100:, [0, 1, 3, 4, 5]], 0, atol=1e-11)


@pytest.mark.parametrize("of", ["robot", "joint model"])
@pytest.mark.parametrize("residual", ["direct", "observer"])
def test_rotors_that_are_accelerated_are_no_contact(residual: str, of: str) -> None:
    """Of the robot, or in their place of the joint model: 2 kg m2 at 10 rad/s2 are 20 Nm, with either sign 40."""
    t, q, qd, qdd, _ = moving(UR5E, 1500, 0.001)
    rotor, slope = 2.0, 5.0
    drives = [{"inertia": rotor, "A": 0.0, "B": slope}] * 6
    robot = UR5E
    if of == "robot":
        robot = replace(UR5E, joints=tuple(replace(joint, rotor_inertia=rotor) for joint in UR5E.joints))
        drives = [{"A": 0.0, "B": slope}] * 6
    bare = replace(UR5E, joints=tuple(replace(joint, rotor_inertia=0.0) for joint in UR5E.joints))
    tau = inverse_dynamics(bare, q, qd, qdd) + rotor * qdd
    model = joint_model([joint.name for joint in UR5E.joints], drives)
    settings = DetectorSettings(residual=residual, measured_rates=True, window_s=0.004)  # type: ignore[arg-type]
    run = Detector(robot, model, [1e3] * 6, settings).run_rows(t, q, tau / slope, qd=qd)
    largest = np.abs(rotor * qdd).max()
    assert largest > 5
    # The observer has forgotten how it began after 0.2 s.
    assert np.nanmax(np.abs(run.residual[300:])) < 0.05 * largest


@pytest.mark.parametrize("kind", ["direct", "observer"])
@pytest.mark.parametrize("channel", ["constant", "fast"])
def test_residuals_of_either_sign_alarm_alike(kind: str, channel: str) -> None:
    t, q, _, _, tau = parabola(UR5E, 400)
    found = []
    for sign in (1, -1):
        pushed = tau.copy()
        pushed[200:, 2] += sign * 20.0
        limits = {"constant": np.full(6, 12.0 if channel == "constant" else np.inf)}
        limits["fast"] = np.full(6, 9.0 if channel == "fast" else np.inf)
        made = Detector(UR5E, None, Thresholds(**limits), DetectorSettings(residual=kind))  # type: ignore[arg-type]
        (event, *_) = made.run_rows(t, q, pushed).events
        assert (event.joints or event.fast_joints) == (2,)
        assert np.sign(event.residual[2]) == sign
        found.append((event.t, abs(event.residual[2])))
    assert found[0] == pytest.approx(found[1], rel=1e-4)
    # The first row that has the push, or as soon as a filter shows half of it.
    at_once = kind == "direct" and channel == "constant"
    assert found[0][0] == pytest.approx(t[200], abs=1e-9 if at_once else 0.03)


@pytest.mark.parametrize("residual", ["direct", "observer"])
def test_sign_of_a_push(residual: str) -> None:
    """A body that pushes the arm up, against a hand moving down, raises the residual by J_v' n F with n downward."""
    q = np.array([0.1, -1.2, 1.4, -0.8, -1.5, 0.0])
    rows, normal, force = 200, np.array([0.0, 0.0, -1.0]), 30.0
    wrench = np.concatenate([-normal * force, np.zeros(3)])
    held = inverse_dynamics(UR5E, q, 0 * q, 0 * q, wrench=wrench)
    free = inverse_dynamics(UR5E, q, 0 * q, 0 * q)
    tau = np.where(np.arange(rows)[:, None] < 100, free, held)
    given_settings = DetectorSettings(residual=residual)  # type: ignore[arg-type]
    run = Detector(UR5E, None, [5.0] * 6, given_settings).run(
        Recording(t=DT * np.arange(rows), q=np.tile(q, (rows, 1)), tau=live(tau))
    )
    wanted = UR5E.jacobian(q)[:3].T @ normal * force
    (event,) = run.events
    # The observer has had 0.2 s: e^-10 of the torque is missing.
    np.testing.assert_allclose(run.residual[-1], wanted, rtol=1e-9 if residual == "direct" else 1e-4, atol=1e-9)
    if residual == "direct":
        assert event.t == pytest.approx(0.2)
        assert event.force_along == pytest.approx(force)
        np.testing.assert_allclose(event.force, normal * force, atol=1e-6)
    assert event.force_along > 0


def test_observer_and_direct_residual_agree_after_a_while() -> None:
    t, q, qd, _, tau = moving(UR5E)
    tau = tau + 3.0
    log = Recording(t=t, q=q, qd=qd, tau=tau)
    found = [
        Detector(UR5E, None, [1e3] * 6, DetectorSettings(residual=kind, measured_rates=True)).run(log).residual[-1]  # type: ignore[arg-type]
        for kind in ("direct", "observer")
    ]
    np.testing.assert_allclose(found[0], found[1], atol=0.3)
    np.testing.assert_allclose(found[1], 3.0, atol=0.01)


def test_joints_that_hardly_move_are_noted() -> None:
    """Thresholds of an arm at rest would not hold in motion."""
    t, q, _, _, tau = moving(UR5E, 2000)
    q, tau = q.copy(), tau.copy()
    q[:, 3:] = q[0, 3:]
    (note,) = (note for note in residual_record(Recording(t=t, q=q, tau=tau), UR5E, None).notes if "hardly" in note)
    assert note.startswith("wrist_1_joint, wrist_2_joint, wrist_3_joint: hardly moved in this recording")


def test_residual_record_goes_into_a_scenario(tmp_path: Path) -> None:
    t, q, _, _, tau = moving(UR5E, 2000)
    noise = np.random.default_rng(3).normal(size=tau.shape)
    record = residual_record(Recording(t=t, q=q, tau=tau + noise), UR5E, None, feedback_period_s=0.004)
    assert record.rows.shape == ((2000 - FILLING + 1) // 2, 6)
    path = tmp_path / "free.parquet"
    record.save(path)
    again = type(record).load(path, 6, 0.004)
    np.testing.assert_array_equal(again.rows, record.rows)
    with pytest.raises(bs.InputError, match="no multiple of the rows' period"):
        residual_record(Recording(t=t, q=q, tau=tau), UR5E, None, feedback_period_s=0.003)


@pytest.mark.parametrize(("share", "fits"), [(0.991, True), (1.009, True), (0.989, False), (1.011, False)])
def test_recorded_residuals_have_the_feedback_period_to_a_hundredth(share: float, fits: bool, tmp_path: Path) -> None:
    path = tmp_path / "free.parquet"
    rows = np.random.default_rng(1).normal(size=(500, 6))
    write_residuals(path, 0.004 * share * np.arange(500), rows)
    if fits:
        np.testing.assert_array_equal(ResidualRecord.load(path, 6, 0.004).rows, rows)
        return
    with pytest.raises(bs.InputError, match=r"has a row every 0\.00\d+ s; wanted the feedback period"):
        ResidualRecord.load(path, 6, 0.004)


@pytest.mark.parametrize(("share", "fits"), [(0.91, True), (1.09, True), (0.89, False), (1.11, False)])
def test_rows_have_the_period_of_the_thresholds_to_a_tenth(share: float, fits: bool) -> None:
    t, q, _, _, tau = moving(UR5E, 200, DT * share)
    made = Detector(UR5E, None, Thresholds(np.full(6, 1e3), period_s=DT))
    if fits:
        assert made.run_rows(t, q, tau).t.size == 200
        return
    with pytest.raises(bs.InputError, match=r"the detector is made for thresholds period_s = 0.002"):
        made.run_rows(t, q, tau)


@pytest.mark.parametrize(
    ("link", "point", "direction"),
    [("link_u", (0.1, 0.0, 0.2), (0.0, 1.0, 0.0)), ("link_e", (0.0, 0.0, 0.3), (0.0, 0.0, 1.0))],
)
def test_a_lever_that_is_only_rounding_tells_no_force(
    link: str, point: tuple[float, float, float], direction: tuple[float, float, float]
) -> None:
    settings = DetectorSettings(link=link, point=point, direction=direction)
    # The joints that count move the point in the plane of the arm and nowhere else.
    thresholds = [math.inf, 10.0, math.inf, 10.0, math.inf, 10.0, 10.0]
    found = Detector(Robot.load("sia5d"), None, thresholds, settings).explain(np.zeros(7), np.ones(7))
    assert (found.force_along, found.force_along_sd) == (0, math.inf)


def test_a_point_on_the_only_axis_tells_no_force() -> None:
    axis = np.array([0.6, 0.0, 0.8])
    joint = Joint(name="j", link="l", origin=(0.1, 0.2, 0.35), axis=tuple(axis), inertia=LinkInertia(mass=1.0))
    robot = Robot(name="mill", joints=(joint,), tip_origin=tuple(0.3 * axis))
    found = Detector(robot, None, [1.0], DetectorSettings(direction=(1.0, 0.0, 0.0))).explain([0.4], [5.0])
    assert (found.force_along, found.force_along_sd) == (0, math.inf)
    assert np.isnan(found.force).all()


# --- Noise ------------------------------------------------------------------------------------------------------------


def test_rows_of_noise_have_the_stated_spread() -> None:
    """White noise through the observer and through the band-pass channel, against their formulas."""
    rows, gain, sd = 60_000, 60.0, 2.0
    t, q = 0.004 * np.arange(rows), np.full((rows, 6), 0.4)
    held = inverse_dynamics(UR5E, q[0], 0 * q[0], 0 * q[0])
    tau = held + sd * np.random.default_rng(5).normal(size=(rows, 6))
    given_settings = DetectorSettings(residual="observer", observer_gain_1_s=gain)
    observer = Detector(UR5E, None, [1e3] * 6, given_settings).run_rows(t, q, tau)
    a = math.exp(-gain * 0.004)
    # Correlated over 1 / (1 - a) rows; six joints: the spread is known to half a percent.
    assert observer.residual[1000:].std() == pytest.approx(sd * math.sqrt((1 - a) / 2), rel=0.02)
    thresholds = Thresholds(np.full(6, 1e3), fast=np.full(6, 1e3))
    given_settings = DetectorSettings(low_hz=1.0, high_hz=20.0)
    fast = Detector(UR5E, None, thresholds, given_settings).run_rows(t, q, tau)
    a, b = math.exp(-2 * math.pi * 20 * 0.004), math.exp(-2 * math.pi * 0.004)
    stated = sd * b * (1 - a) * math.sqrt(2 / ((1 + a) * (1 + b) * (1 - a * b)))
    assert fast.fast[1000:].std() == pytest.approx(stated, rel=0.02)


# --- Currents, friction, payload --------------------------------------------------------------------------------------

SIA5D = Robot.load("sia5d")


def heaviest(j: int) -> float:
    """Greatest torque with which the arm weighs on a joint, of many poses [Nm]."""
    q = np.random.default_rng(0).uniform(SIA5D.lower, SIA5D.upper, (300_000, SIA5D.dof))
    return float(np.abs(gravity_torque(SIA5D, q)[:, j]).max())


def test_friction_hides_contacts_at_standstill() -> None:
    """A stuck joint's current may stay what it was, up to the dead zone: only what is beyond counts."""
    model = JointTorqueModel.load("sia5d")
    detector = Detector(SIA5D, model, [20, 10, 20, 20, 20, 20, math.inf])
    zone = detector.dead_zone
    for j, joint in enumerate(model.joints):
        # Friction at four speeds of rest times the slope of the map under the load of the arm, and hysteresis.
        slope = (zone[j] - joint.value("hysteresis")) / (joint.value("D") * (4 * joint.rest_speed) ** joint.value("F"))
        A, B, weight = joint.value("A"), joint.value("B"), heaviest(j)
        current = 2 * weight / (B + math.sqrt(B**2 + 4 * A * weight))
        assert slope == pytest.approx(B + 2 * A * current, rel=1e-3)
    assert math.isnan(zone[6])  # no drive of the last joint is known
    q, down = np.deg2rad([0, 30, 0, -20, 0, -40, 0]), [0, 0, -1]
    moving_N, resting_N = (detector.smallest_force(q, down, resting=resting) for resting in (False, True))
    lever = np.abs(SIA5D.jacobian(q)[2])
    assert moving_N == pytest.approx(np.min(np.array([20, 10, 20, 20, 20, 20]) / lever[:6].clip(1e-12)))
    assert resting_N == pytest.approx(np.min((np.array([20, 10, 20, 20, 20, 20]) + zone[:6]) / lever[:6].clip(1e-12)))
    assert any("At standstill friction may hide" in note for note in detector.notes)


def gainless(model: JointTorqueModel, number: int) -> JointTorqueModel:
    """The model, but the recordings did not show how much torque a current of this joint is."""
    joints = list(model.joints)
    drive = joints[number]
    known = {name: value for name, value in drive.parameters.items() if name not in ("A", "B")}
    joints[number] = replace(drive, map="linear", parameters={"B": None, **known}, current_range=None)
    return replace(model, joints=tuple(joints))


def test_a_joint_of_unknown_gain_is_not_monitored_and_takes_no_data_away() -> None:
    """As if the model had not the joint at all: the others are monitored as ever."""
    whole, t = JointTorqueModel.load("sia5d"), DT * np.arange(300)
    phase = t[:, None] + np.arange(7)
    log = Recording(t=t, q=0.3 * np.sin(phase), current=np.random.default_rng(2).normal(0, 9, (300, 7)))
    limits = np.array([20.0, 10, 20, math.inf, 20, 20, math.inf])
    model = gainless(whole, 3)
    detector = Detector(SIA5D, model, limits)
    run, wanted = detector.run(log), Detector(SIA5D, whole, limits).run(log)
    others = [0, 1, 2, 4, 5, 6]
    assert not run.no_data[FILLING:].any()
    np.testing.assert_array_equal(run.residual[:, others], wanted.residual[:, others])
    assert not run.residual[FILLING:, 3].any()
    assert "joint_u: the joint model does not know its gain B, not monitored." in detector.notes
    assert "joint_t: without a joint model, not monitored." in detector.notes
    assert np.flatnonzero(np.isnan(detector.dead_zone)).tolist() == [3, 6]
    assert np.isfinite(detector.kernel_settings(DT).dead_zone).all()
    with pytest.raises(bs.InputError, match="does not know the gain B of joint 'joint_u', which is monitored"):
        Detector(SIA5D, model, [20.0, 10, 20, 20, 20, 20, math.inf])


def test_a_declared_payload_is_no_contact_and_an_undeclared_one_is_recognised() -> None:
    t, q, qd, qdd, _ = moving(UR5E, 6000, pace=0.3)
    last = UR5E.joints[-1]
    assert last.inertia is not None
    mass, place = 2.0, np.array(UR5E.tip_origin)
    total = last.inertia.mass + mass
    apart = place - np.array(last.inertia.center)
    center = np.array(last.inertia.center) + mass / total * apart
    tensor = np.array(last.inertia.tensor) + last.inertia.mass * mass / total * (
        apart @ apart * np.eye(3) - np.outer(apart, apart)
    )
    body = replace(last.inertia, mass=total, center=tuple(center), tensor=tuple(map(tuple, tensor)))
    heavy = replace(UR5E, joints=(*UR5E.joints[:-1], replace(last, inertia=body)))
    loaded = inverse_dynamics(heavy, q, qd, qdd)
    log = Recording(t=t, q=q, qd=qd, tau=loaded)
    given = {"measured_rates": True, "payload_change_kg": 0.5, "noise_sd": (1.0,) * 6}
    declared = Detector(UR5E, None, [8.0] * 6, DetectorSettings(payload_kg=mass, **given)).run(log)  # type: ignore[arg-type]
    assert declared.events == ()
    assert not declared.payload_changed.any()
    undeclared = Detector(UR5E, None, [1e3] * 6, DetectorSettings(**given)).run(log)  # type: ignore[arg-type]
    assert undeclared.payload_changed[-1]
    first = undeclared.t[undeclared.payload_changed.argmax()]
    assert first > 0.02


# --- No data --------------------------------------------------------------------------------------------------------


# --- What does not belong together ------------------------------------------------------------------------------------
