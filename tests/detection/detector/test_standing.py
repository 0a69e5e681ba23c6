"""Joints that stand still hide what their friction holds: forces that stay undetected, and what an alarm can tell."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import curve_fit

import bumpstop as bs
from bumpstop.detection import Detector, DetectorSettings, detect, undetectable_forces, undetectable_stretches
from bumpstop.detection.standing import checked_stiction, hidden_torques, standing_share
from bumpstop.identification.segments.motion import UniformMotion
from bumpstop.joint import JointParameters, JointTorqueModel, Parameter
from bumpstop.model import gravity_torque, inverse_dynamics
from bumpstop.recording import Recording
from cli.support import run, strict_json
from detection.detector.test_fitted_dynamics import planted
from detection.moving_arms import UR5E

THETA = [20.0, 20, 20, 6, 6, 6]
NOISE = (3.0, 3, 3, 0.2, 0.2, 0.2)
STICTION = (15.0, 15, 12, 8, 8, 8)
POSE = np.radians([10, -80, 110, -120, -90, 20])


def pushed(force: np.ndarray, wrist_feels: bool) -> Recording:
    """The base joints move, the wrist stands; from 1 s on a force on the body, which a stuck wrist does not show."""
    t = 0.004 * np.arange(400)
    qd = np.zeros((400, 6))
    qd[:, :3] = 0.2
    q = POSE + qd * t[:, None]
    tau = inverse_dynamics(UR5E, q, qd, 0 * q)
    rows = t >= 1.0
    turned = np.einsum("nij,i->nj", UR5E.jacobian(q[rows])[:, :3], force)
    if not wrist_feels:
        turned[:, 3:] = 0.0
    tau[rows] += turned
    return Recording(t=t, q=q, tau=tau)


def test_a_stuck_wrist_is_not_believed_to_feel_nothing() -> None:
    force = np.array([0.0, 0.0, -60.0])
    settings = DetectorSettings(noise_sd=NOISE)
    stated = DetectorSettings(noise_sd=NOISE, stiction=STICTION)
    log = pushed(force, wrist_feels=False)
    (believed,) = detect(log, UR5E, None, THETA, settings).events[:1]
    (found,) = detect(log, UR5E, None, THETA, stated).events[:1]
    assert abs(believed.force_along) < 30  # a wrist with little noise and a zero: next to nothing
    assert found.force_along == pytest.approx(60, abs=6)
    low, high = found.force_interval
    assert low < 60 < high
    assert found.standing == (3, 4, 5)
    np.testing.assert_allclose(found.hidden, [0, 0, 0, 8, 8, 8], atol=1e-9)
    data = found.to_json()
    assert data["standing_joints"] == [4, 5, 6]
    assert data["force_interval_N"] == [low, high]
    # The contact is at the tip, and a silent wrist does not speak against that.
    assert UR5E.joints[-1].link in found.possible_links


def test_a_wrist_that_shows_a_torque_is_heard_to_within_what_is_hidden() -> None:
    force = np.array([0.0, 0.0, -80.0])
    stated = DetectorSettings(noise_sd=NOISE, stiction=(0.0, 0, 0, 1, 1, 1))
    (found,) = detect(pushed(force, wrist_feels=True), UR5E, None, THETA, stated).events[:1]
    assert found.force_along == pytest.approx(80, abs=1)


def test_a_direction_that_only_standing_joints_feel_has_no_force() -> None:
    detector = Detector(UR5E, None, THETA, DetectorSettings(stiction=STICTION))
    residual = np.array([0.0, 0, 25.0, 0, 0, 0])
    # Along the base's axis seen from the third joint on nothing but the joints 2 to 5 turns it; all but 3 stand.
    qd = np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0])
    told = detector.explain(POSE, residual, qd)
    column = UR5E.jacobian(POSE)[2, 2]
    assert told.force_along == pytest.approx(25.0 / -column, rel=1e-6)
    assert math.isfinite(told.force_along_sd)
    moving = detector.explain(POSE, residual)
    assert abs(moving.force_along) < abs(told.force_along)
    # Between rest_speed and twice that friction hides a part.
    np.testing.assert_allclose(detector.hidden(np.full(6, 0.015)), 0.5 * np.array(STICTION), rtol=1e-9)
    assert not detector.hidden(np.full(6, 0.02)).any()


def test_what_friction_holds_is_known_from_models_or_stated() -> None:
    model = JointTorqueModel.load("sia5d")
    robot = bs.Robot.load("sia5d")
    detector = Detector(robot, model, [20.0] * 6 + [math.inf])
    np.testing.assert_allclose(hidden_torques(robot, model), detector.dead_zone)
    assert (hidden_torques(robot, model)[:6] > 0).all()
    # Of the last joint no drive is known, and none is monitored: what friction hides there is not zero.
    assert np.isnan(detector.dead_zone[6])
    assert any("unknown Nm by joint" in note for note in detector.notes)
    assert detector.smallest_torque(resting=True)[6] == math.inf
    assert detector.hidden(np.zeros(7))[6] == 0
    assert detector.kernel_settings(0.004).dead_zone[6] == 0
    np.testing.assert_array_equal(hidden_torques(robot, model, DetectorSettings(stiction=(3.0,) * 7)), np.full(7, 3.0))
    np.testing.assert_array_equal(hidden_torques(robot, None), np.zeros(7))
    for given, message in (
        (-1.0, "stiction of joint 1: is -1"),
        ([1, 2], "stiction: has shape"),
        (math.inf, "stiction: is inf"),
    ):
        with pytest.raises(bs.InputError, match=message):
            checked_stiction(given, 7)


def test_shares_of_standing_are_those_of_the_speed_around_a_row() -> None:
    t = 0.01 * np.arange(300)
    q = np.stack([np.zeros(300), 0.1 * t, 0.015 * t, 1e-5 * (-1.0) ** np.arange(300)], axis=1)
    share = standing_share(t, q)
    np.testing.assert_allclose(share[20:-20], np.tile([1.0, 0.0, 0.5, 1.0], (260, 1)), atol=1e-6)
    assert standing_share(t[:1], q[:1]).tolist() == [[1.0] * 4]


def test_standing_poses_hide_more_in_stretches() -> None:
    """The arm moves, stands, and moves on: only while it stands friction hides more than the limit."""
    t = 0.01 * np.arange(600)
    moved = np.interp(t, [0, 2, 4, 6], [0, 0.6, 0.6, 1.2])
    q = POSE + moved[:, None] * np.array([1.0, 0.2, 0.2, 0.2, 0.2, 0.2])
    theta = np.array(THETA)
    moving = undetectable_forces(UR5E, q, theta).largest
    standing = undetectable_forces(UR5E, q, theta + STICTION).largest
    limit = 1.05 * float(moving.max())
    assert float(standing[300]) > limit
    assert undetectable_stretches(UR5E, t, q, theta, limit) == ()
    (one,) = undetectable_stretches(UR5E, t, q, theta, limit, dead_zone=STICTION)
    assert one.start_s == pytest.approx(2.0, abs=0.1)
    assert one.end_s == pytest.approx(4.0, abs=0.1)
    assert one.largest_N == pytest.approx(float(standing[300]), rel=1e-6)


def test_sensitivity_of_a_standing_arm(tmp_path: Path) -> None:
    pose = "10,-80,110,-120,-90,20"
    given = ("sensitivity", "ur5e", "--pose-deg", pose, "--thresholds", ",".join(map(str, THETA)))
    plain = strict_json(run(*given, "--json").out)
    assert plain["standing"] is None
    assert "give --model or --stiction" in run(*given).out
    stated = strict_json(run(*given, "--stiction", ",".join(map(str, STICTION)), "--json").out)
    wanted = undetectable_forces(UR5E, POSE, np.array(THETA) + STICTION)
    assert stated["standing"]["largest_force_N"] == pytest.approx(float(wanted.largest), rel=1e-9)
    assert stated["standing"]["force_along_N"] > plain["force_along_N"]
    assert {key: stated[key] for key in plain if key != "standing"} == {
        key: plain[key] for key in plain if key != "standing"
    }
    sia = ("sensitivity", "sia5d", "--pose-deg", "0,30,0,-20,0,-40,0", "--thresholds", "20,10,20,20,20,20,20")
    whole, half = (
        strict_json(run(*sia, "--model", "sia5d", *more, "--json").out)["standing"]["dead_zone_Nm"]
        for more in ((), ("--stiction", "50%"))
    )
    # Of the last joint no drive is known: standing still it counts as one that is not monitored.
    np.testing.assert_allclose(half[:6], 0.5 * np.array(whole[:6]))
    assert half[6] is whole[6] is None
    found = strict_json(run(*sia, "--model", "sia5d", "--json").out)
    assert any("joint_t: of unknown gain" in note for note in found["notes"])
    unmonitored = (*sia[:-1], "20,10,20,20,20,20,inf")
    other = strict_json(run(*unmonitored, "--model", "sia5d", "--json").out)
    assert found["standing"] == other["standing"]
    assert found["singular_values_six_rows"] == other["singular_values_six_rows"]
    words = run(*sia, "--model", "sia5d").out
    assert "standing still, where friction holds" in words
    assert ", unknown Nm: largest" in words
    for options, message in (
        (("--stiction", "1,2"), "--stiction: '1,2' cannot be used; wanted 6 numbers"),
        (("--stiction", "-3"), "--stiction: '-3' cannot be used; wanted zero or more"),
        (("--stiction", "50%"), "--stiction: 50% of what is not known; give --model, or Nm"),
        (("--stiction", "5", "--model", "sia5d"), "--stiction: has no meaning with --model"),
    ):
        refused = run(*given, *options)
        assert refused.status == 2
        assert message in refused.err


def test_detect_states_what_standing_joints_hide(tmp_path: Path) -> None:
    log = tmp_path / "log.parquet"
    pushed(np.array([0.0, 0.0, -60.0]), wrist_feels=False).save(log)
    given = (
        "detect",
        log,
        "--robot",
        "ur5e",
        "--thresholds",
        ",".join(map(str, THETA)),
        "--stiction",
        "15,15,12,8,8,8",
    )
    found = strict_json(run(*given, "--json").out)
    assert found["events"][0]["standing_joints"] == [4, 5, 6]
    assert "joints stood still, and friction may hide of joint 4 up to 8 Nm" in run(*given).out


def driven(friction: str, parameters: dict[str, float], **more: object) -> JointTorqueModel:
    """A UR5e whose joints all have one drive."""
    made = {name: Parameter(value) for name, value in parameters.items()} | {"hysteresis": Parameter(0.5)}
    joint = JointParameters(
        name="", map="linear", friction=friction, parameters={**made, "inertia": None}, **more  # type: ignore[arg-type]
    )  # fmt: skip
    joints = tuple(replace(joint, name=each.name) for each in UR5E.joints)
    return JointTorqueModel(robot="ur5e", created_from="a test", unit="A", joints=joints)


@pytest.mark.parametrize("top", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("viscous", [0.2, 1.0, 5.0])
def test_a_power_law_does_not_take_friction_away_at_rest(viscous: float, top: float) -> None:
    """Fitted to Coulomb and viscous friction from 0.04 rad/s on, it falls to a half of it towards rest and below."""
    speed = np.linspace(0.04, top, 500)
    (D, F), _ = curve_fit(lambda v, d, f: d * v**f, speed, 1 + viscous * speed, (1, 0.3))
    model = driven("power", {"B": 10.0, "D": D, "F": F}, speed_range=(0.006, top))
    told = (hidden_torques(UR5E, model) - 0.5) / 10
    assert (told > 1).all()
    assert (told < 1.6).all()
    # Without a range it is that of the slowest rows that fits use.
    unknown = (hidden_torques(UR5E, driven("power", {"B": 10.0, "D": D, "F": F})) - 0.5) / 10
    np.testing.assert_allclose(unknown, D * 0.04**F, rtol=1e-12)


def test_friction_that_grows_with_the_load_hides_more_under_a_load() -> None:
    coulomb, load, B = 0.5, 0.2, 10.0
    model = driven("load_dependent", {"B": B, "coulomb": coulomb, "viscous": 0.0, "load": load})
    weight = np.abs(gravity_torque(UR5E, POSE))
    # The motor may hold the weight against its friction.
    current = (weight / B + coulomb) / (1 - load)
    np.testing.assert_allclose(hidden_torques(UR5E, model, q=POSE), B * (coulomb + load * current) + 0.5, rtol=1e-9)
    # Without a pose it is that of the pose in which a joint holds most: about a vertical axis there is nothing to hold.
    q = np.random.default_rng(5).uniform(-np.pi, np.pi, (20_000, 6))
    seen, every = hidden_torques(UR5E, model, q=q), hidden_torques(UR5E, model)
    assert (every >= seen - 1e-9).all()
    np.testing.assert_allclose(every, seen, rtol=0.02)
    assert every[0] == pytest.approx(B * coulomb / (1 - load) + 0.5, abs=1e-6)
    np.testing.assert_array_equal(Detector(UR5E, model, THETA).dead_zone, every)
    # A payload is held, too, and lies on the joints as it hangs.
    carried = hidden_torques(UR5E, model, DetectorSettings(payload_kg=3.0), POSE)
    torque = np.abs(gravity_torque(UR5E, POSE) + UR5E.jacobian(POSE)[2] * 3.0 * 9.80665)
    np.testing.assert_allclose(carried, B * (coulomb + load * (torque / B + coulomb) / (1 - load)) + 0.5, rtol=1e-9)


def test_friction_of_fitted_dynamics_counts_load_and_bend() -> None:
    model = planted(1, essential=False)
    of = dict(zip(model.column_names, model.values, strict=True))
    hidden = hidden_torques(UR5E, model, q=POSE)
    motion = UniformMotion(np.zeros(1), POSE[None], np.zeros((1, 6)), np.zeros((1, 6)), 1.0, model.gravity)
    weight = model.loads(motion)[1][0]
    # What gives way is Coulomb friction and a share of all that is on the gear then, of which it holds a part itself.
    assert hidden[1] == pytest.approx(abs(of["coulomb_2"]) + of["load_2"] * (abs(weight) + hidden[1]), rel=1e-9)
    bend = max(-4 / 15 * of["bend_1"], 0.0)
    assert hidden[0] == pytest.approx(abs(of["coulomb_1"]) + bend, rel=1e-9)
    every = hidden_torques(UR5E, model)
    assert every[1] >= hidden[1]
    np.testing.assert_allclose(np.delete(every, [1, 4]), np.delete(hidden, [1, 4]))
