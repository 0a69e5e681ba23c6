"""Joint models from currents: planted drives recovered, unobservable gains named, damaged recordings refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.identification import (
    JointMotion,
    compare_currents,
    identify_joint_model,
    motor_current,
    stiction_share,
    with_payload,
)
from bumpstop.identification.drive.drive_model import DriveModel
from bumpstop.identification.segments.drive_samples import DriveSamples
from bumpstop.joint import JointParameters, JointTorqueModel, Parameter
from bumpstop.model import inverse_dynamics, with_rotors
from bumpstop.recording import Recording
from identification.drives import Motion, driven, drives, fourier, planted, z_scores
from identification.recorded import FILES, SHARED, arm_and_motion, there

ELBOW = "elbow_joint"
LAWS = {
    "power": {"D": 0.6, "F": 0.3},
    "stribeck": {"coulomb": 0.4, "viscous": 0.3, "stribeck": 0.2, "stribeck_speed": 0.1},
    "load_dependent": {"coulomb": 0.4, "viscous": 0.3, "load": 0.1},
}


def one_joint(kind: str, law: str) -> JointParameters:
    figures = {"B": 10.0, **({} if kind == "linear" else {"A": 0.4}), **LAWS[law], "hysteresis": 3.0, "inertia": 1.2}
    return JointParameters(
        name="elbow",
        map=kind,  # type: ignore[arg-type]
        friction=law,  # type: ignore[arg-type]
        parameters={name: Parameter(value) for name, value in figures.items()},
        current_range=(-3.0, 4.0),
    )


@pytest.mark.parametrize("kind", ["linear", "odd", "load_dependent"])
@pytest.mark.parametrize("law", list(LAWS))
def test_current_is_the_inverse_of_torque(kind: str, law: str) -> None:
    """Also beyond the fitted range, at rest and after motion either way."""
    joint = one_joint(kind, law)
    rng = np.random.default_rng(1)
    qd = np.cumsum(rng.normal(size=2000)) * 0.004
    qdd, torque = rng.normal(size=(2, 2000)) * np.array([[2.0], [25.0]])
    current = motor_current(joint, JointMotion(torque, qd, qdd, stiction_share(qd, joint.rest_speed)))
    model = JointTorqueModel(robot="arm", created_from="a test", unit="A", joints=(joint,))
    again = model.torque(current[:, None], qd[:, None], qdd[:, None])[:, 0]
    np.testing.assert_allclose(again, torque, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", ["linear", "odd", "load_dependent", "unknown_gain"])
@pytest.mark.parametrize("law", list(LAWS))
def test_derivatives_are_those_of_the_current(kind: str, law: str) -> None:
    rng = np.random.default_rng(2)
    qd = rng.normal(size=300)
    motion = JointMotion(20 * rng.normal(size=300), qd, rng.normal(size=300), stiction_share(qd, 0.05))
    figures = {"B": 10.0, "A": 0.3, "hysteresis": 2.0, "inertia": 1.0, "torque": 0.1, "acceleration": 0.2, **LAWS[law]}
    whole = DriveModel.of(kind, law, 0.05, {}, hysteresis=True)
    values = np.array([figures[name] for name in whole.names])
    _, columns = whole.current(values, motion)
    for place in range(values.size):
        step = np.zeros_like(values)
        step[place] = 1e-6
        change = (whole.current(values + step, motion)[0] - whole.current(values - step, motion)[0]) / 2e-6
        np.testing.assert_allclose(columns[:, place], change, rtol=1e-5, atol=1e-6, err_msg=whole.names[place])


@pytest.mark.parametrize(("name", "kind", "law"), [("ur10e", "odd", "power"), ("panda", "load_dependent", "stribeck")])
def test_planted_kinds_are_chosen_and_predict_another_motion(name: str, kind: str, law: str) -> None:
    robot = bs.Robot.load(name)
    motion = fourier(robot, 40.0, 100.0, 1)
    torque = inverse_dynamics(with_rotors(robot, 0.0), *motion[1:])
    truth = drives(robot, torque, kind=kind, friction=LAWS[law], law=law)
    fit = identify_joint_model(driven(robot, motion, truth, 1), robot, cutoff_hz=10.0)
    # Where a torque is that of a light wrist alone its bend may hide; of the others all must be found.
    right = [joint.parameters.map == kind for joint in fit.joints]
    assert sum(right) >= robot.dof - 2
    other = driven(robot, fourier(robot, 20.0, 100.0, 2), truth, 2, noise=0.0)
    found = compare_currents(fit.model, other, robot)
    assert min(score.r2 for score in found.current_scores() if score is not None) > 0.99
    # More current is more torque of the motors than the motion asks for: the sign of the detector's residual.
    more = compare_currents(fit.model, replace(other, current=other.current + 0.1), robot)
    assert (more.torque_residual > found.torque_residual).all()
    # Errors of validation, scores and page, are the other way round: predicted (Newton-Euler) less estimated (eq 3.1).
    page = more.torques()
    for j, (score, on_page) in enumerate(zip(more.torque_scores(), page.scores(), strict=True)):
        assert score is not None
        assert score.mean == pytest.approx(-more.torque_residual[:, j].mean(), abs=1e-12)
        assert page.error[:, j].mean() == pytest.approx(on_page.mean, abs=1e-12)
    np.testing.assert_array_equal(page.predicted, more.torque)


def test_coulomb_and_viscous_friction_alone_can_be_asked_for() -> None:
    robot = bs.Robot.load("ur10e")
    motion = fourier(robot, 40.0, 100.0, 1)
    plain = {"coulomb": 0.4, "viscous": 0.3, "stribeck": 0.0, "stribeck_speed": 0.1}
    torque = inverse_dynamics(with_rotors(robot, 0.0), *motion[1:])
    recording = driven(robot, motion, drives(robot, torque, friction=plain, law="stribeck"), 1)
    known = {ELBOW: {"stribeck": 0.0}}
    elbow = identify_joint_model(recording, robot, cutoff_hz=10.0, frictions=["stribeck"], known=known).joints[2]
    assert elbow.parameters.value("stribeck") == 0
    assert elbow.parameters.value("coulomb") == pytest.approx(0.4, rel=0.02)
    assert elbow.parameters.value("viscous") == pytest.approx(0.3, rel=0.05)
    assert [one.refused for one in elbow.candidates if one.map == "linear"] == [""]


def test_the_friction_law_is_chosen_again_with_the_map() -> None:
    """With a line in place of a bent map, friction that grows with the load makes up for the bend."""
    robot = bs.Robot.load("ur10e")
    for seed, elbow in ((5, 2), (0, 3)):
        motion = fourier(robot, 40.0, 100.0, seed)
        truth = drives(robot, inverse_dynamics(with_rotors(robot, 0.0), *motion[1:]))
        bent = [{**joint.parameters, "A": Parameter(0.2 * joint.value("B"))} for joint in truth.joints]
        truth = replace(
            truth,
            joints=tuple(replace(joint, parameters=own) for joint, own in zip(truth.joints, bent, strict=True)),
        )
        (joint,) = identify_joint_model(
            driven(robot, motion, truth, seed), robot, cutoff_hz=10.0, joints=[elbow]
        ).joints
        with_line = {one.friction: one.held_out for one in joint.candidates if one.map == "linear"}
        assert with_line["load_dependent"] < with_line["power"]
        assert (joint.parameters.map, joint.parameters.friction) == ("odd", "power")


def test_intervals_hold_under_correlated_noise_and_lost_samples() -> None:
    robot = bs.Robot.load("ur10e")
    scores: list[float] = []
    for seed in range(4):
        truth, log = planted(robot, fourier(robot, 30.0, 100.0, seed), 10 + seed)
        options = {"maps": ["odd"], "frictions": ["power"], "inertia_uncertainty": 0.0}
        fit = identify_joint_model(log, robot, cutoff_hz=10.0, **options)  # type: ignore[arg-type]
        scores += z_scores(fit.model, truth)
    assert len(scores) >= 4 * 6 * 4
    # Of 120 intervals at 95 %, independent by sixes at best, fewer than 85 % inside has one chance in 100.
    assert np.mean(np.abs(scores) < 1.96) > 0.85


@pytest.mark.parametrize("name", ["ur10", "tx40"])
def test_planted_drives_on_the_positions_of_real_arms(name: str) -> None:
    if not there(name):
        pytest.skip(f"{SHARED / FILES[name]} is absent: set BUMPSTOP_SHARED")
    robot, motion = arm_and_motion(name)
    truth, log = planted(robot, motion, 1)
    fit = identify_joint_model(log, robot, maps=["odd"], frictions=["power"], inertia_uncertainty=0.0)
    scores = np.abs(z_scores(fit.model, truth))
    # All of some 30 within 4 standard errors; of independent ones at 95 %, fewer than 80 % inside in 1 of 500.
    assert scores.max() < 4
    assert np.mean(scores < 1.96) >= 0.8


def test_hysteresis_is_found_where_the_arm_rests() -> None:
    robot = bs.Robot.load("ur5e")
    motion = fourier(robot, 60.0, 100.0, 3, rests=24)
    truth = drives(robot, inverse_dynamics(with_rotors(robot, 0.0), *motion[1:]), hysteresis=0.3)
    fit = identify_joint_model(driven(robot, motion, truth, 3, noise=0.02), robot, cutoff_hz=10.0, rest_speed=0.01)
    for joint, own in zip(fit.joints, truth.joints, strict=True):
        found = joint.parameters.parameters["hysteresis"]
        assert found is not None, joint.name
        assert found.standard_error is not None
        assert abs(found.value - own.value("hysteresis")) < 4 * found.standard_error + 0.1 * own.value("hysteresis")


def ramps(robot: bs.Robot, j: int, speed: float) -> Motion:
    """One joint to and fro at a single speed, the others still."""
    t = np.arange(0, 30.0, 0.01)
    at = np.where(np.isfinite(robot.lower + robot.upper), (robot.lower + robot.upper) / 2, 0.0)
    q, qd = np.tile(at + 0.3, (t.size, 1)), np.zeros((t.size, robot.dof))
    phase = np.mod(t, 4.0)
    q[:, j] += speed * (np.where(phase < 2, phase, 4 - phase) - 1)
    qd[:, j] = np.where(phase < 2, speed, -speed)
    return t, q, qd, np.zeros_like(qd)


def test_what_a_motion_cannot_show_is_named_and_not_made_up() -> None:
    robot = bs.Robot.load("ur10e")
    motion = ramps(robot, 1, 0.5)
    torque = inverse_dynamics(with_rotors(robot, 0.0), *motion[1:])
    log = driven(robot, motion, drives(robot, torque + 1.0, kind="linear"), 5)
    fit = identify_joint_model(log, robot, cutoff_hz=10.0)
    lift, pan = fit.joints[1], fit.joints[0]
    assert lift.observable
    assert {"F", "hysteresis"} <= set(lift.unobservable)
    assert lift.parameters.parameters["F"] == Parameter(0.0)  # fixed, and without a standard error
    # The vertical axis: no gravity torque, no scale.
    assert not pan.observable
    assert pan.parameters.parameters["B"] is None
    assert pan.parameters.parameters["inertia"] is None
    assert any("shoulder_pan_joint: B is not identifiable" in warning for warning in fit.warnings)
    assert np.isnan(fit.model.torque(np.zeros(6), np.zeros(6))[0])
    assert "shoulder_pan_joint" in fit.model.notes()[0]
    given = identify_joint_model(log, robot, cutoff_hz=10.0, known={"shoulder_pan_joint": {"B": 12.0}})
    assert given.joints[0].parameters.parameters["B"] == Parameter(12.0)


@pytest.mark.parametrize("kind", ["odd", "load_dependent"])
def test_a_joint_at_rest_whose_map_does_not_rise_is_named(kind: str) -> None:
    """Neither law of a bend fits: a current like the square of the torque, or one beside which nothing shows a bend."""
    robot = bs.Robot.load("ur5e")
    t, *moves = fourier(robot, 20.0, 100.0, 1)
    rest = 1 if kind == "odd" else 0
    for still, x in zip((moves[0][0, rest], 0.0, 0.0), moves, strict=True):
        x[:, rest] = still
    if kind == "load_dependent":
        others = [j for j in range(robot.dof) if j != 1]
        for still, x in zip((moves[0][0, others], 0.0, 0.0), moves, strict=True):
            x[:, others] = still
    model = drives(robot, inverse_dynamics(with_rotors(robot, 0.0), *fourier(robot, 15.0, 100.0, 1)[1:]))
    log = driven(robot, (t, *moves), model, 1, encoder=0.0)
    if kind == "odd":
        assert log.current is not None
        own = log.current[:, rest]
        log.current[:, rest] = own * np.abs(own) / np.abs(own).max()
    fit = identify_joint_model(log, robot, maps=[kind], joints=[rest], cutoff_hz=10.0, rest_speed=0.01)
    assert fit.joints[0].parameters.parameters["A"] == Parameter(0.0)
    assert {"A", "D", "F"} <= set(fit.joints[0].unobservable)
    assert any(warning.startswith(f"{robot.joints[rest].name}: A is not identifiable") for warning in fit.warnings)


def test_noise_of_encoders_is_no_torque_that_changes() -> None:
    """At rest friction may carry any part of a torque, however the noise of the positions makes it shiver."""
    robot = bs.Robot.load("ur10e")
    q = np.tile([0, -1, 1.2, -0.5, 1, 0.3], (5000, 1))
    t, rng = 0.004 * np.arange(len(q)), np.random.default_rng(0)
    current = inverse_dynamics(robot, q, 0 * q, 0 * q) / 10 + 0.005 * rng.normal(size=q.shape)
    log = Recording(t=t, q=q + 1e-5 * rng.normal(size=q.shape), current=current)
    fit = identify_joint_model(log, robot, cutoff_hz=30.0)
    assert not any(joint.observable for joint in fit.joints)


def test_payload_that_is_declared_is_not_taken_for_gain() -> None:
    robot = bs.Robot.load("ur5e")
    carrying = with_payload(robot, 4.0, (0.0, 0.0, 0.08))
    truth, log = planted(carrying, fourier(robot, 30.0, 100.0, 7), 7)
    right = identify_joint_model(log, carrying, maps=["odd"], frictions=["power"], cutoff_hz=10.0)
    wrong = identify_joint_model(log, robot, maps=["odd"], frictions=["power"], cutoff_hz=10.0)
    lift = truth.joints[1].value("B")
    assert abs(right.model.joints[1].value("B") / lift - 1) < 0.05
    assert wrong.model.joints[1].value("B") / lift < 0.9


def test_wrong_signs_are_said() -> None:
    robot = bs.Robot.load("ur5e")
    _, log = planted(robot, fourier(robot, 20.0, 100.0, 8), 8)
    assert log.current is not None
    turned = replace(log, current=log.current * np.array([1, -1, 1, 1, 1, 1]))
    fit = identify_joint_model(turned, robot, cutoff_hz=10.0)
    assert not fit.joints[1].observable
    assert any("is its sign right?" in warning for warning in fit.joints[1].warnings)


def test_gaps_cost_their_rows_only() -> None:
    robot = bs.Robot.load("ur5e")
    truth, log = planted(robot, fourier(robot, 30.0, 100.0, 9), 9)
    assert log.current is not None
    kept = (log.t < 10) | (log.t > 14)
    cut = Recording(t=log.t[kept], q=log.q[kept], current=log.current[kept])
    options = {"maps": ["odd"], "frictions": ["power"], "inertia_uncertainty": 0.0}
    fit = identify_joint_model(cut, robot, cutoff_hz=10.0, **options)  # type: ignore[arg-type]
    assert len(fit.rows.segments) == 2
    assert np.abs(z_scores(fit.model, truth)).max() < 5


def test_what_cannot_be_fitted_is_refused() -> None:
    robot = bs.Robot.load("ur5e")
    _, log = planted(robot, fourier(robot, 5.0, 100.0, 6), 6)
    for problem, message in (
        (lambda: identify_joint_model(Recording(t=log.t, q=log.q), robot), "has no motor current"),
        (lambda: identify_joint_model(log, bs.Robot.load("panda")), "has 6 joints"),
        (lambda: identify_joint_model(log, robot, maps=["cubic"]), "maps: 'cubic' is none"),
        (lambda: identify_joint_model(log, robot, known={"x": {}}), "known.x: is no joint"),
        (lambda: identify_joint_model(log, robot, cutoff_hz=-1.0), "cutoff_hz: is -1.0"),
        (lambda: identify_joint_model(log.between(0, 0.3), robot, cutoff_hz=10.0), "no segment of 50 rows"),
        (lambda: with_payload(robot, -1.0), "payload.mass: is -1.0 kg"),
        (lambda: with_payload(robot, 1e300), r"payload.mass: is 1e\+300 kg; wanted 0 to 100000"),
        (lambda: with_payload(robot, 1.0, (0, 1e300, 0)), "payload.center: is .* m; wanted at most 100"),
        (lambda: identify_joint_model(log, robot, known={ELBOW: {"B": 0.0}}), "B: is 0; wanted 1e-09 to"),
        (lambda: identify_joint_model(log, robot, known={ELBOW: {"A": 1e300}}), r"A: is 1e\+300; wanted -1e\+09 to"),
        (lambda: identify_joint_model(log, robot, known={ELBOW: {"F": 1e9}}), r"F: is 1e\+09; wanted 0 to 3"),
        (lambda: identify_joint_model(log, robot, known={ELBOW: {"F": 5.0}}), r"F: is 5; wanted 0 to 3"),
    ):
        with pytest.raises(bs.InputError, match=message):
            problem()


def test_a_real_arm_with_a_declared_payload() -> None:
    """Gains of a UR3e at 25 Hz beside its controller's own: the slope of target moment over target current.

    7 %: the controller's own model is not ours. Without the payload, a gripper, the wrist's gain is a sixth of it.
    """
    path = SHARED / "ur3e_rtde/fig9.xlsx"
    if not path.exists():
        pytest.skip(f"{path} is absent: set BUMPSTOP_SHARED")
    robot, log = bs.Robot.load("ur3e"), Recording.load(path)
    assert any("--payload 1.07,0,0,0.058" in note for note in log.report.notes)
    controller = {"shoulder_lift_joint": 10.88, "elbow_joint": 7.70, "wrist_1_joint": 3.56}
    fit = identify_joint_model(log, with_payload(robot, 1.07, (0, 0, 0.058)), cutoff_hz=3.0)
    for joint in fit.model.joints:
        if joint.name in controller:
            assert joint.value("B") == pytest.approx(controller[joint.name], rel=0.07)
    assert fit.model.joints[5].parameters["B"] is None
    assert any("wrist_3_joint: B is not identifiable" in warning for warning in fit.warnings)


def test_the_swing_of_a_filter_is_not_the_last_motion() -> None:
    """A joint turns at 1 rad/s, stops, and a filter without delay lets it swing back at 0.1 rad/s: it came from below.

    A motion of 0.1 rad/s long after the stop is one.
    """
    rate, cutoff = 150.0, 15.0
    t = np.arange(900) / rate
    turning = np.where((t > 1) & (t < 2), 1.0, 0.0)
    swing = np.where((t >= 2) & (t < 2.04), -0.1, 0.0)
    later = np.where((t > 4) & (t < 4.5), -0.1, 0.0)
    qd = np.repeat((turning + swing + later)[:, None], 1, axis=1)
    nothing = np.zeros_like(qd)
    rows = DriveSamples(t, nothing, qd, nothing, nothing, nothing, (slice(0, t.size),), (rate,), cutoff, t.size, 0)
    held = rows.joint(0, 0.01).held
    assert (held[(t > 2.05) & (t < 3.95)] == 1.0).all()
    assert (held[t > 4.55] == -1.0).all()
    assert (held[t < 0.95] == 0.0).all()


def test_a_load_that_nobody_declared_is_suspected() -> None:
    """Two recordings, 2 kg in the second: fitted as if there were none, they want different gains."""
    robot = bs.Robot.load("ur5e")
    loaded = with_payload(robot, 2.0, (0.0, 0.0, 0.08))
    motions = [fourier(robot, 15.0, 94.0, seed) for seed in (11, 12)]
    model = drives(robot, inverse_dynamics(with_rotors(robot, 0.0), *motions[0][1:]), kind="linear")
    logs = [driven(arm, motion, model, 1) for arm, motion in zip((robot, loaded), motions, strict=True)]
    options = {"cutoff_hz": 8.0, "rest_speed": 0.01, "maps": ["linear"], "frictions": ["power"]}
    silent = identify_joint_model(logs, robot, **options)  # type: ignore[arg-type]
    assert {"shoulder_lift_joint", "elbow_joint"} <= set(silent.inconsistent)
    assert "the recordings want different gains" in silent.warnings[0]
    declared = identify_joint_model(logs, [robot, loaded], **options)  # type: ignore[arg-type]
    assert declared.inconsistent == ()
    assert not any("different gains" in warning for warning in declared.warnings)


def test_a_current_that_never_varies_has_no_score() -> None:
    """Rounding of the filter is not its variance: shares of that came out beyond all numbers."""
    robot = bs.Robot.load("ur5e")
    _, log = planted(robot, fourier(robot, 12.0, 94.0, 1), 1)
    assert log.current is not None
    current = log.current.copy()
    current[:, 2] = 1.7
    fit = identify_joint_model(replace(log, current=current), robot)
    assert np.isnan(fit.joints[2].r2)
    assert all(joint.r2 > 0.9 for j, joint in enumerate(fit.joints) if j != 2)
    assert max(fit.held_out.values()) < 1
