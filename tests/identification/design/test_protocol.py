"""Schroeder's fit, step by step, on currents simulated from a known joint model along the plan's own motions."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.cli.main import main
from bumpstop.cli.schroeder2013.protocol import protocol_json
from bumpstop.identification.design.plan import IdentificationPlan, ProtocolSettings, plan_identification
from bumpstop.identification.design.plan_file import save_plan
from bumpstop.identification.design.simulated import SensorNoise, currents, simulated_recording
from bumpstop.joint import JointTorqueModel
from bumpstop.joint.parameters import JointParameters, Parameter
from bumpstop.recording import Recording
from bumpstop.reproduction.schroeder2013 import fit_comparison
from bumpstop.reproduction.schroeder2013.fit_comparison import FitComparison, compare_fits
from bumpstop.reproduction.schroeder2013.protocol import ProtocolFit, ProtocolJoint, identify_protocol
from bumpstop.reproduction.schroeder2013.protocol_page import write_protocol_report
from bumpstop.reproduction.schroeder2013.protocol_verdict import judge_protocol

SETTINGS = ProtocolSettings(
    speed_shares=(0.1, 0.2, 0.35, 0.5, 0.7), repeats=2, ramp_repeats=2, holds=2, hold_s=6.0, acceleration=4.5
)
NOISE = SensorNoise(current_sd=0.1, friction_sd=0.02, position_sd=2e-5, lost=0.01, jitter=0.1)
INERTIA = (4.0, 4.0, 2.0, 0.3, 0.3, 0.3)


def planted(kind: str = "odd") -> JointTorqueModel:
    """Figures of an arm of this size; B falls towards the wrist."""
    joints = []
    for j, joint in enumerate(bs.Robot.load("ur10e").joints):
        B = (10.0, 12.0, 9.0, 6.0, 5.0, 5.0)[j]
        values = {"A": 0.02 * B, "B": B, "D": 1.5, "F": 0.3, "hysteresis": 1.0, "inertia": INERTIA[j]}
        parameters = {name: Parameter(value) for name, value in values.items()}
        reach = (-14.0, 14.0) if kind == "load_dependent" else None
        joints.append(
            JointParameters(name=joint.name, map=kind, friction="power", parameters=parameters, current_range=reach)
        )
    return JointTorqueModel(robot="ur10e", created_from="planted", unit="A", joints=tuple(joints))


@pytest.fixture(scope="module")
def plan() -> IdentificationPlan:
    return plan_identification(bs.Robot.load("ur10e"), SETTINGS)


def recorded(plan: IdentificationPlan, kind: str, seed: int, joints: tuple[int, ...]) -> list[Recording]:
    return [
        simulated_recording(
            plan.loaded, planted(kind), plan.path(one), rate_hz=125.0, noise=NOISE, seed=seed + one.joint
        )
        for one in plan.experiments
        if one.joint in joints
    ]


@pytest.fixture(scope="module")
def recordings(plan: IdentificationPlan) -> list[Recording]:
    return recorded(plan, "odd", 1, (1, 2))


@pytest.fixture(scope="module")
def fit(plan: IdentificationPlan, recordings: list[Recording]) -> ProtocolFit:
    return identify_protocol(plan, recordings)


@pytest.fixture(scope="module")
def beside(fit: ProtocolFit, recordings: list[Recording]) -> FitComparison:
    return compare_fits(fit, recordings)


def test_simulated_currents_give_the_torque_back(plan: IdentificationPlan) -> None:
    model = planted()
    q, qd, qdd = plan.path(plan.experiments[0]).at(np.arange(10.0, 14.0, 0.01))
    tau = bs.model.inverse_dynamics(plan.loaded, q, qd, qdd)
    np.testing.assert_allclose(model.torque(currents(model, tau, qd, qdd), qd, qdd), tau, atol=1e-9)


def test_planted_figures_are_recovered(fit: ProtocolFit) -> None:
    """Within 4 standard errors, where one of 12 would be outside once in 1300 times; and near the truth."""
    assert [joint.experiment.joint for joint in fit.joints] == [1, 2]
    near = {"A": 0.5, "B": 0.02, "D": 0.02, "F": 0.05, "hysteresis": 0.2, "inertia": 0.1}
    for joint in fit.joints:
        truth = planted().joints[joint.experiment.joint]
        assert joint.map == "odd"
        assert joint.r2 > 0.99
        for name, parameter in joint.parameters.items():
            assert parameter is not None
            assert parameter.standard_error is not None
            error = abs(parameter.value - truth.value(name))
            assert error < 4 * parameter.standard_error, (joint.experiment.name, name)
            assert error < near[name] * truth.value(name), (joint.experiment.name, name)


def test_the_general_fit_finds_the_same(beside: FitComparison) -> None:
    """Two ways to a figure: both near the truth, and differences told in what both are uncertain by together."""
    assert beside.why_not == ""
    assert [pair.general.name for pair in beside.joints] == [pair.protocol.experiment.name for pair in beside.joints]
    near = {"A": 0.15, "B": 0.03, "D": 0.02, "F": 0.05, "hysteresis": 0.3, "inertia": 0.1}
    for pair in beside.joints:
        truth = planted().joints[pair.protocol.experiment.joint]
        for name, share in near.items():
            own, other = pair.pair(name)
            assert own is not None
            assert other is not None
            assert other.value == pytest.approx(truth.value(name), rel=share), (pair.general.name, name)
            assert own.standard_error is not None
            assert other.standard_error is not None
            difference = pair.difference(name)
            assert difference is not None
            combined = np.hypot(own.standard_error, other.standard_error)
            assert difference * combined == pytest.approx(own.value - other.value, rel=1e-9, abs=1e-12)
            assert abs(difference) < 4


def test_a_joint_that_cannot_be_fitted_leaves_the_others(fit: ProtocolFit, recordings: list[Recording]) -> None:
    """Joints are fitted by themselves where all together are refused."""

    def refused(fit: ProtocolFit, logs: list[Recording], joints: tuple[ProtocolJoint, ...], progress: object) -> object:
        if any(joint.experiment.joint == 1 for joint in joints):
            raise bs.InputError("joint shoulder_lift_joint", "its map is not monotone")
        return fitted(fit, logs, joints, progress)  # type: ignore[arg-type]

    fitted = fit_comparison._fitted
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fit_comparison, "_fitted", refused)
        found = compare_fits(fit, recordings)
    assert [pair.general.name for pair in found.joints] == ["elbow_joint"]
    assert found.why_not == "joint shoulder_lift_joint: its map is not monotone"
    assert found.rows_used > 0


def test_what_is_not_the_same_thing_is_not_compared(beside: FitComparison) -> None:
    pair = beside.joints[0]
    other = replace(pair.protocol, map="load_dependent")
    assert replace(pair, protocol=other).difference("A") is None
    assert replace(pair, protocol=other).difference("B") is None
    assert replace(pair, protocol=other).difference("D") == pair.difference("D")
    flat = replace(pair.general, unobservable={"A": "of this test"})
    assert replace(pair, general=flat).difference("B") is None
    unsure = replace(pair.protocol, parameters={**pair.protocol.parameters, "F": Parameter(0.3), "inertia": None})
    assert replace(pair, protocol=unsure).difference("F") is None
    assert replace(pair, protocol=unsure).difference("inertia") is None


@pytest.mark.usefixtures("unsaved_pictures")
def test_the_protocol_stands_without_a_general_fit(
    fit: ProtocolFit, recordings: list[Recording], tmp_path: Path
) -> None:
    log = recordings[0]
    assert log.current is not None
    scrap = Recording(t=log.t[:40], q=log.q[:40], current=log.current[:40])
    without = compare_fits(fit, [scrap])
    assert without.joints == ()
    assert "50 rows" in without.why_not
    write_protocol_report(fit, tmp_path, without)
    assert "50 rows" in (tmp_path / "report.html").read_text()
    found = protocol_json(fit, without, recordings)
    assert found["general"] == {"cutoff_hz": None, "rows_used": 0, "why_not": without.why_not}
    assert found["joints"][1]["general"] is None


def test_the_general_fit_knows_the_plans_gravity() -> None:
    """On a tilted base the upright arm's torques would be others by half."""
    gravity = (9.80665 * np.sin(np.radians(30)), 0.0, -9.80665 * np.cos(np.radians(30)))
    settings = replace(SETTINGS, speed_shares=(0.2, 0.5), repeats=1, ramp_repeats=1, holds=1, gravity=gravity)
    tilted = plan_identification(bs.Robot.load("ur10e"), settings)
    one = tilted.experiments[0]
    assert one.joint == 0
    log = simulated_recording(
        tilted.loaded, planted(), tilted.path(one), rate_hz=125.0, noise=NOISE, seed=1, gravity=gravity
    )
    (pair,) = compare_fits(identify_protocol(tilted, [log]), [log]).joints
    for parameter in pair.pair("B"):
        assert parameter is not None
        assert parameter.value == pytest.approx(10.0, rel=0.05)


def test_every_stroke_is_found(fit: ProtocolFit) -> None:
    """There and back at every speed and repeat, at the planned speed; two holds from either side."""
    for joint in fit.joints:
        experiment = joint.experiment
        wanted = sorted(2 * [sign * speed for speed in experiment.speeds for sign in (1.0, -1.0)])
        found = sorted(stroke.speed for stroke in joint.strokes)
        assert len(found) >= len(wanted)
        for speed in wanted:
            assert min(abs(speed - other) for other in found) < 0.02 * abs(speed)
        assert sorted(hold.speed for hold in joint.cut.holds) == [-1.0, -1.0, 1.0, 1.0]
        for part in joint.cut.constant:
            assert np.abs(part.qd - part.speed).max() < max(0.04 * abs(part.speed), 0.006)


def test_the_map_is_chosen_by_strokes_it_was_not_fitted_to(plan: IdentificationPlan) -> None:
    found = identify_protocol(plan, recorded(plan, "load_dependent", 3, (1,)))
    (joint,) = found.joints
    assert joint.map == "load_dependent"
    assert joint.held_out["load_dependent"] < joint.held_out["odd"]
    assert joint.parameters["A"] is not None
    assert joint.parameters["A"].value == pytest.approx(0.24, rel=0.2)


def test_joints_that_were_not_recorded_are_named(fit: ProtocolFit) -> None:
    assert [number for number, _ in fit.missing] == [3, 4]
    assert all("never moves alone" in why for _, why in fit.missing)
    assert [joint.name for joint in fit.model().joints] == ["shoulder_lift_joint", "elbow_joint"]
    lost = ("shoulder_pan_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
    note = fit.model().note
    assert note.startswith("Not identified by the protocol: ")
    assert sorted(note.removesuffix(".").partition(": ")[2].split(", ")) == sorted(lost)


def test_model_predicts_the_torque_of_another_motion(fit: ProtocolFit, plan: IdentificationPlan) -> None:
    """The model's torque from noiseless currents of the planted one, on a swing of both joints."""
    t = np.arange(0, 8, 0.01)
    q, qd, qdd = (np.zeros((t.size, 6)) for _ in range(3))
    for j in (1, 2):
        w = 0.7 + 0.4 * j
        q[:, j], qd[:, j], qdd[:, j] = np.sin(w * t) - 1, w * np.cos(w * t), -w * w * np.sin(w * t)
    tau = bs.model.inverse_dynamics(plan.loaded, q, qd, qdd)
    current = currents(planted(), tau, qd, qdd)
    fast = np.abs(qd[:, 1:3]).min(axis=1) > 0.05
    predicted = fit.model().torque(current[:, 1:3], qd[:, 1:3], qdd[:, 1:3])
    error = (predicted - tau[:, 1:3])[fast]
    assert (error.std(axis=0) < 0.02 * tau[:, 1:3].std(axis=0)).all()


def test_wrong_sign_of_current_is_told(plan: IdentificationPlan, recordings: list[Recording]) -> None:
    log = recordings[0]
    assert log.current is not None
    turned = Recording(t=log.t, q=log.q, current=-log.current)
    with pytest.raises(bs.InputError, match="torque falls where its current rises"):
        identify_protocol(plan, [turned])


def test_recordings_of_something_else_are_refused(plan: IdentificationPlan, recordings: list[Recording]) -> None:
    log = recordings[0]
    with pytest.raises(bs.InputError, match="no motor currents"):
        identify_protocol(plan, [Recording(t=log.t, q=log.q)])
    with pytest.raises(bs.InputError, match="has 5 joints"):
        identify_protocol(plan, [Recording(t=log.t, q=log.q[:, :5])])
    with pytest.raises(bs.InputError, match="never moves alone"):
        identify_protocol(plan, [Recording(t=log.t, q=0 * log.q, current=log.current)])
    slower = Recording(t=1.3 * log.t, q=log.q, current=log.current)
    with pytest.raises(bs.InputError, match="strokes at a planned speed"):
        identify_protocol(plan, [slower])


def test_a_protocol_with_one_speed_is_refused_by_name(plan: IdentificationPlan) -> None:
    """A law of friction through one speed had D = 3e22, and the command ended well."""
    one = plan.experiments[0]
    slow = replace(plan, settings=replace(plan.settings, speed_shares=(0.2,)), experiments=(
        replace(one, speeds=one.speeds[1:2], accelerations=()),
    ))  # fmt: skip
    log = simulated_recording(
        slow.loaded, planted(), slow.path(slow.experiments[0]), rate_hz=125.0, noise=NOISE, seed=1
    )
    with pytest.raises(bs.InputError, match=rf"{one.name}: all its strokes run at one speed, .* deg/s, which shows no"):
        identify_protocol(slow, [log])
    # Of two speeds that are nearly one, too.
    near = replace(slow, experiments=(replace(slow.experiments[0], speeds=(one.speeds[1], 1.05 * one.speeds[1])),))
    log = simulated_recording(
        near.loaded, planted(), near.path(near.experiments[0]), rate_hz=125.0, noise=NOISE, seed=1
    )
    with pytest.raises(bs.InputError, match="all its strokes run at one speed"):
        identify_protocol(near, [log])


def test_holds_in_several_poses_are_refused_by_name(plan: IdentificationPlan) -> None:
    """Each joint stands in its planned pose and elsewhere, and all move between the holds at once."""
    t = np.arange(0, 60, 0.008)
    rng = np.random.default_rng(2)
    poses = [plan.home, *(one.at(position) for one in plan.experiments for position in (one.low, one.high))]
    share = np.clip((np.mod(t, 6.0) - 4.0) / 2.0, 0, 1)[:, None]
    number = (t // 6).astype(int)
    places = np.array([poses[k % len(poses)] for k in range(12)])
    q = (1 - share) * places[number] + share * places[number + 1] + 2e-5 * rng.normal(size=(t.size, 6))
    log = Recording(t=t, q=q, current=1.0 + 0.1 * rng.normal(size=q.shape))
    with pytest.raises(bs.InputError, match="no joint of the plan can be identified") as refused:
        identify_protocol(plan, [log])
    for one in plan.experiments:
        assert one.name in str(refused.value)


def test_a_plan_that_misses_the_recording_says_by_how_much(
    plan: IdentificationPlan, recordings: list[Recording]
) -> None:
    one = next(one for one in plan.experiments if one.joint == 1)
    pose = one.pose.copy()
    pose[3] += np.radians(20)
    missed = replace(plan, experiments=(replace(one, pose=pose),))
    with pytest.raises(bs.InputError, match=r"the other joints come no nearer to it than \S+ deg, wanted 3"):
        identify_protocol(missed, recordings)


def test_strokes_without_gravity_are_refused_by_name(plan: IdentificationPlan) -> None:
    """A hand-written plan for a vertical axis: no torque changes along its strokes."""
    one = replace(plan.experiments[0], joint=0, name="shoulder_pan_joint", pose=plan.home.copy(), low=-1.0, high=1.0,
                  hold_joint=None, route=np.empty((0, 6)))  # fmt: skip
    turning = replace(plan, experiments=(one,))
    log = simulated_recording(turning.loaded, planted(), turning.path(one), rate_hz=125.0, noise=NOISE, seed=1)
    with pytest.raises(bs.InputError, match=r"shoulder_pan_joint: gravity's torque changes by .* Nm along its strokes"):
        identify_protocol(turning, [log])


def loaded_friction() -> JointTorqueModel:
    """Drives whose gears lose a share of the current: Coulomb, viscous and load friction."""
    joints = []
    for joint in planted().joints:
        own = {name: joint.parameters[name] for name in ("A", "B", "hysteresis", "inertia")}
        own |= {"coulomb": Parameter(0.8), "viscous": Parameter(0.5), "load": Parameter(0.15)}
        joints.append(JointParameters(name=joint.name, map="odd", friction="load_dependent", parameters=own))
    return JointTorqueModel(robot="ur10e", created_from="planted", unit="A", joints=tuple(joints))


def test_the_law_of_friction_is_chosen_by_strokes_it_was_not_fitted_to(
    plan: IdentificationPlan, fit: ProtocolFit
) -> None:
    """Planted laws are taken, and the three figures of the loaded one recovered."""
    assert [joint.friction.law for joint in fit.joints] == ["power", "power"]
    one = next(one for one in plan.experiments if one.joint == 1)
    log = simulated_recording(plan.loaded, loaded_friction(), plan.path(one), rate_hz=125.0, noise=NOISE, seed=3)
    found = identify_protocol(plan, [log])
    (joint,) = found.joints
    assert joint.friction.law == "load_dependent"
    assert joint.friction_held_out["load_dependent"] < 0.8 * joint.friction_held_out["power"]
    truth = {"coulomb": 0.8, "viscous": 0.5, "load": 0.15, "B": 12.0, "inertia": 4.0}
    for name, value in truth.items():
        parameter = joint.parameters[name]
        assert parameter is not None
        assert parameter.standard_error is not None
        assert parameter.value == pytest.approx(value, rel=0.15), name
        assert abs(parameter.value - value) < 5 * parameter.standard_error, name
    model = found.model()
    assert model.joints[0].friction == "load_dependent"
    assert "load" in protocol_json(found, FitComparison((), np.nan, 0, ""), [log])["joints"][1]["parameters"]


def test_a_protocol_is_judged(fit: ProtocolFit, beside: FitComparison, recordings: list[Recording]) -> None:
    verdict = judge_protocol(fit, beside, recordings)
    # Two joints of four were recorded.
    assert [warning.split()[0] for warning in verdict.warnings] == ["wrist_1_joint", "wrist_2_joint"]
    assert verdict.usable
    assert verdict.condition is not None
    assert 1 <= verdict.condition < 30
    assert verdict.held_out is not None
    assert verdict.held_out < 0.05
    steep = replace(fit.joints[0], parameters={**fit.joints[0].parameters, "F": Parameter(3.0, 0.1)})
    faults = judge_protocol(replace(fit, joints=(steep, fit.joints[1])), beside, recordings).faults
    assert any("grows as fast as the law allows" in fault for fault in faults)


def test_command(
    tmp_path: Path, plan: IdentificationPlan, recordings: list[Recording], capsys: pytest.CaptureFixture[str]
) -> None:
    save_plan(plan, tmp_path / "plan.toml", robot={"robot": "ur10e"})
    for number, recording in enumerate(recordings):
        recording.save(tmp_path / f"{number}.parquet")
    files = [str(tmp_path / f"{number}.parquet") for number in range(len(recordings))]
    arguments = ["identify", *files, "--robot", "ur10e", "--protocol", str(tmp_path / "plan.toml")]
    with pytest.raises(SystemExit) as ended:
        main([*arguments, "--json", "-o", str(tmp_path / "model.toml")])
    assert ended.value.code == 0
    found = json.loads(capsys.readouterr().out)
    assert [joint["observable"] for joint in found["joints"]] == [False, True, True, False, False, False]
    assert "vertical" in found["joints"][0]["reason"]
    beside = found["joints"][1]["general"]
    assert beside["parameters"]["B"]["value"] == pytest.approx(12.0, rel=0.03)
    assert abs(beside["protocol_less_general_in_standard_errors"]["B"]) < 4
    assert found["general"]["rows_used"] > 0
    model = JointTorqueModel.load(tmp_path / "model.toml")
    assert model.joints[0].value("B") == found["joints"][1]["parameters"]["B"]["value"]
    # A part of the recordings is all that counts where one is asked for.
    with pytest.raises(SystemExit) as ended:
        main([*arguments, "--until", "0.5"])
    assert ended.value.code == 2
    assert "never moves alone" in capsys.readouterr().err
    for option in ("--known", "--cutoff", "--shared-motor", "--payload", "--base", "--tip"):
        with pytest.raises(SystemExit) as ended:
            main([*arguments, option, "1"])
        assert ended.value.code == 2
        assert f"{option}: is not for a protocol; leave it out" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        main([*arguments, "--robot", "ur5e"])
    assert ended.value.code == 2
    assert "is not the plan's" in capsys.readouterr().err
