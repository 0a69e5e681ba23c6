"""What stands beside a verdict: said where it weakens it, and only there."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.verdict.alarm_rate import alarm_rate
from bumpstop.contact import LimitTable
from bumpstop.detection.tuning.residual_record import write_residuals
from bumpstop.model import Robot
from bumpstop.model.urdf.writer import write_urdf
from collision.cases import control_group, ur10e
from collision.trajectory_cases import gantry, scenario, trajectory_motion, write_csv

EXAMPLES = sorted((Path(__file__).parents[3] / "examples").glob("0*.toml"))


@pytest.mark.parametrize("path", EXAMPLES, ids=[path.stem for path in EXAMPLES])
def test_nothing_weakens_the_examples(path: Path) -> None:
    warnings = bs.evaluate(bs.load_scenario(path)).warnings
    assert all("[uncertainty]" in warning for warning in warnings)
    assert len(warnings) == (path.stem == "07_hand_uncertain")


# What is changed, a part of the one sentence that says it.
SAID: list[tuple[dict[str, Any], str]] = [
    (
        {"contact__normal": [1.0, 0.0, -0.2]},
        "contact.normal lies 78.7 degrees off the motion: the body is approached at 19.6 %",
    ),
    ({"motion__start": "rest", "contact__offset_law": "uniform"}, "From rest the arm has reached no more than 5"),
    (
        {"motion__start": "rest", "contact__offset_law": "fixed", "contact__offset_mm": 0.2},
        "Give the largest contact.offset_mm there can be",
    ),
    ({"simulation__step_s": 0.004, "simulation__substeps": 1}, "Simulation steps are coarse"),
    ({"contact__point_m": [0.0, 0.0, 50.0]}, "contact.point_m lies 50 m from tool0"),
    (
        {"contact__stiffness_N_m": 900.0, "motion__velocity_mm_s": [0, 0, -10]},
        "contact.stiffness_N_m = 900 N/m is softer",
    ),
    (
        {"contact__stiffness_N_mm": 0.9, "motion__velocity_mm_s": [0, 0, -10]},
        "contact.stiffness_N_mm = 0.9 N/mm is softer than any body.",
    ),
    ({"contact__padding_N_m": 900.0, "motion__velocity_mm_s": [0, 0, -10]}, "contact.padding_N_m = 900 N/m is softer"),
    ({"contact__stiffness_N_m": 2000.0, "motion__velocity_mm_s": [0, 0, -900]}, "The body is deformed by"),
    ({"motion__velocity_mm_s": [0, 0, -0.25]}, "The tip moves at 0.25 mm/s"),
    ({"reaction__joint_acceleration_rad_s2": 260.0}, "reaction.joint_acceleration_rad_s2 = 260 is more than"),
    ({"contact__body": "face", "motion__velocity_mm_s": [0, 0, -10]}, "Face is a sensitive region: ISO/TS 15066 asks"),
    ({"contact__area_cm2": 200.0}, "contact.area_cm2 = 200 is 88.9 times"),
    ({"contact__area_cm2": 0.01}, "contact.area_cm2 = 0.01 is a point of 1 mm2"),
    ({"contact__kind": "free", "contact__body_mass_kg": 0.02}, "contact.body_mass_kg = 0.02 is lighter"),
    ({"detector__noise_sd_Nm": [4.0, 0.0, 4.0, 4.0, 4.0, 4.0, 4.0]}, "detector.noise_sd_Nm is 0 at joint 2"),
]


@pytest.mark.parametrize(("changes", "said"), SAID, ids=[said[:30] for _, said in SAID])
def test_is_said_alone_and_everywhere(changes: dict[str, Any], said: str) -> None:
    result = bs.evaluate(control_group(**changes))
    found = [warning for warning in result.warnings if said in warning]
    assert len(found) == 1, result.warnings
    assert list(result.warnings) == found or "deformed" in "".join(result.warnings)
    assert found[0] in result.notes
    assert found[0] in result.to_json()["verdict"]["warnings"]
    assert bs.evaluate(control_group()).warnings == ()


def test_no_force_is_told_that_steps_raise_where_half_touch_nothing() -> None:
    """Half of the cases are undetected, without a bound, and half touch nothing: finer steps were said to make 44 N."""
    short = bs.evaluate(control_group(motion__duration_s=0.002, contact__offset_law="uniform"))
    assert short.undetected_probability == pytest.approx(0.5, abs=1e-3)
    assert not any("coarse" in warning for warning in short.warnings)


def test_lengths_of_a_robot_in_the_wrong_unit(tmp_path: Path) -> None:
    """A lever a thousand times too long is felt at the first tick: a verdict that failed passed."""
    robot = Robot.load("ur10e")
    path = tmp_path / "arm.urdf"
    write_urdf(replace(robot, tip_name="tcp", tip_origin=(0.0, 0.0, -120.0)), path)
    result = bs.evaluate(ur10e(robot=str(path), motion__velocity_mm_s=[0, 0, -60]))
    (said,) = [warning for warning in result.warnings if "do not look like metres" in warning]
    assert "the tip 'tcp' lies 120 m off" in said
    assert said in result.to_json()["verdict"]["warnings"]
    assert result.notes.count(said) == 1
    assert said in " ".join(str(result).split())


@pytest.mark.parametrize(
    ("found", "written", "said"),
    [
        (r'lower="[^"]*" upper="[^"]*"', 'lower="-170" upper="170"', "taken as radians; degrees? Joints 'shoulder_pan"),
        (r'velocity="[^"]*"', 'velocity="180"', "Speed limits of more than 50 rad/s, taken as rad/s; degrees per sec"),
    ],
)
def test_limits_of_a_robot_in_degrees(found: str, written: str, said: str, tmp_path: Path) -> None:
    """They bound nothing: the terminal showed no word of what reading the robot had found."""
    path = tmp_path / "arm.urdf"
    write_urdf(Robot.load("ur10e"), path)
    assert bs.evaluate(ur10e(robot=str(path))).warnings == ()
    path.write_text(re.sub(found, written, path.read_text(encoding="utf-8")), encoding="utf-8")
    result = bs.evaluate(ur10e(robot=str(path)))
    (warning,) = result.warnings
    assert said in warning
    assert result.notes.count(warning) == 1
    assert f"warning: {warning}" in " ".join(str(result).split())


def test_masses_are_doubted_where_they_count(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    write_urdf(Robot.load("ur10e"), path)
    grams = re.sub(r'mass value="([^"]*)"', lambda m: f'mass value="{1e3 * float(m[1])}"', path.read_text("utf-8"))
    path.write_text(re.sub(' effort="[^"]*"', "", grams), encoding="utf-8")
    said = "are the masses grams?"
    rigid = bs.evaluate(ur10e(robot=str(path)))
    assert rigid.warnings == ()
    assert any(said in note for note in rigid.notes)
    with pytest.raises(bs.InputError, match=r"needs a plausible inertia.*are the masses grams\?"):
        bs.evaluate(ur10e(robot=str(path), arm__model="elastic"))


def test_a_motion_that_is_over_as_it_begins(tmp_path: Path) -> None:
    robot = Robot.load("ur10e")
    path = tmp_path / "arm.urdf"
    pose = [0.0, -90.0, 90.0, -90.0, -90.0, 0.0]
    elbow = replace(robot.joints[2], upper=math.radians(90.0))
    write_urdf(replace(robot, joints=(*robot.joints[:2], elbow, *robot.joints[3:])), path)
    result = bs.evaluate(ur10e(robot=str(path), pose_deg=pose, motion__velocity_mm_s=[0, 0, -60]))
    assert any("The motion is over as it begins: joint 3 is at its limit." in warning for warning in result.warnings)


def test_a_frame_far_off_its_link(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    robot = Robot.load("ur10e")
    write_urdf(robot, path)
    text = path.read_text(encoding="utf-8")
    pad = f'<link name="pad"/><joint name="p" type="fixed"><parent link="{robot.joints[-1].link}"/><child link="pad"/>'
    path.write_text(text.replace("</robot>", f'{pad}<origin xyz="0 0 80"/></joint></robot>'), encoding="utf-8")
    padded = bs.evaluate(ur10e(robot=str(path), tip="flange", contact__link="pad"))
    assert any("contact.link = 'pad' is fixed 80 m off its link" in warning for warning in padded.warnings)
    unused = bs.evaluate(ur10e(robot=str(path), tip="flange"))
    assert not any("'pad'" in warning for warning in unused.warnings)


def test_every_region_of_the_head_has_its_note(tmp_path: Path) -> None:
    table = tmp_path / "own.toml"
    table.write_text(
        'name = "own"\ntitle = "Own"\nsource = "made up"\nstatus = "none"\n\n'
        + "".join(
            f'[[region]]\nname = "{name}"\nlabel = "{label}"\n'
            "force_N = 130.0\ntransient_multiplier = 2.0\nspring_N_mm = 60.0\n\n"
            for name, label in (
                ("head_back", "Back"),
                ("r1", "Left eye"),
                ("forearm", "Forearm"),
                ("surface", "Jaw"),
            )
        ),
        encoding="utf-8",
    )
    noted = {
        "bgia2011": {"cranium_forehead", "face", "neck_front"},
        "ts15066": {"skull_forehead", "face"},
        str(table): {"head_back", "r1", "surface"},
    }
    for name, regions in noted.items():
        limits = LimitTable.load(name)
        found = {each.name for each in limits.regions if limits.contact_limits(each.name, "clamped").head_note}
        assert found == regions
        # Where no contact is permitted the verdict says more.
        free = [limits.contact_limits(each.name, "free") for each in limits.regions]
        assert all(each.permitted or not each.head_note for each in free)


def test_angles_in_the_wrong_unit() -> None:
    radians = [round(math.radians(q), 3) for q in (10, -80, 110, -120, -90, 20)]
    taken = bs.evaluate(ur10e(pose_deg=radians, motion__damping=0.05, motion__task="position"))
    assert any("look like radians, which are pose_rad" in warning for warning in taken.warnings)
    meant = bs.evaluate(ur10e(pose_rad=radians))
    assert not any("radians" in warning for warning in meant.warnings)


def test_joints_too_fast() -> None:
    result = bs.evaluate(control_group(motion__velocity_mm_s=[0, 0, -2500]))
    (said,) = [warning for warning in result.warnings if "needs joint" in warning]
    qd = np.abs(result.problem.start.qd)
    limit = result.problem.robot.velocity
    joint = int(np.argmax(qd / limit))
    assert f"needs joint {joint + 1} at" in said
    assert f"beyond its limit of {limit[joint]:.4g} rad/s" in said
    share = result.problem.approach_speed / 2.5
    assert f"it collides at {float(f'{100 * share:.3g}'):g} % of the speed" in said


def test_a_region_without_a_pressure_limit(tmp_path: Path) -> None:
    result = bs.evaluate(control_group(contact__limits="ts15066", contact__body="face"))
    assert result.problem.limits is not None
    has = result.problem.limits.pressure_N_cm2 is not None
    assert has is not any("has no pressure limit" in warning for warning in result.warnings)
    table = tmp_path / "own.toml"
    table.write_text(
        'name = "own"\ntitle = "Own"\nsource = "made up"\nstatus = "none"\n\n'
        '[[region]]\nname = "shin"\nlabel = "Shin"\n'
        "force_N = 130.0\ntransient_multiplier = 2.0\nspring_N_mm = 60.0\n",
        encoding="utf-8",
    )
    own = bs.evaluate(control_group(contact__limits=str(table), contact__body="shin"))
    assert own.verdict.p_over_pressure is None
    assert any("own has no pressure limit for Shin: the force alone is judged" in warning for warning in own.warnings)


def test_coarse_steps_say_the_force_that_finer_ones_find() -> None:
    coarse = control_group(simulation__step_s=0.004, simulation__substeps=1)
    result = bs.evaluate(coarse)
    (said,) = result.warnings
    changes = {"simulation.step_s": 0.001, "simulation.substeps": 4}
    fine = bs.evaluate(coarse.with_values(changes))
    assert "simulation.step_s = 0.001 and simulation.substeps = 4" in said
    assert f"is {fine.peak_force.quantile(0.999):.4g} N, not {result.peak_force.quantile(0.999):.4g} N" in said


def test_coarse_steps_of_a_long_motion_are_told_by_a_formula() -> None:
    """Half the speed times a sub-step is missing from every braking distance."""
    coarse = control_group(simulation__step_s=0.004, simulation__substeps=1, motion__duration_s=1000.0)
    (said,) = bs.evaluate(coarse).warnings
    assert "up to 0.1 mm shorter for them, which is 7.5 N" in said
    assert bs.evaluate(control_group(motion__duration_s=1000.0)).warnings == ()


def test_coarse_steps_of_a_trajectory(tmp_path: Path) -> None:
    gantry(tmp_path)
    t = np.linspace(0, 1, 60)
    write_csv(tmp_path / "path.csv", t, (0.3 * (3 * t**2 - 2 * t**3))[:, None] * [0, 0, -1.0])
    case = scenario(tmp_path, trajectory_motion(), reaction__joint_acceleration_rad_s2=20.0)
    assert not any("coarse" in warning for warning in bs.evaluate(case).warnings)
    coarse = bs.evaluate(case.with_values({"simulation.step_s": 0.004, "simulation.substeps": 1}))
    assert any("Simulation steps are coarse" in warning for warning in coarse.warnings)


def test_cases_that_touch_nothing_do_not_hide_a_risk() -> None:
    """A third of the cases touch nothing; of the others more than the accepted share are over."""
    case = control_group(
        pose_deg=[0, 109.0, 0, -20, 0, -40, 0], motion__velocity_mm_s=[0, 0, -50], contact__offset_sd_s=0.12
    )
    result = bs.evaluate(case)
    untouched = 1 - result.peak_force.exceedance(0.0)
    assert 0.2 < untouched < 0.5
    alone = result.verdict.p_over_pressure / (1 - untouched)
    hidden = bs.evaluate(
        case.with_values({"verdict.accepted_probability": 0.9 * alone, "verdict.max_false_alarm": 0.1})
    )
    assert hidden.verdict.acceptable is True
    assert any("Of the others alone" in w and "more than the accepted" in w for w in hidden.warnings)


# --- False alarms an hour -----------------------------------------------------------------------------------


def test_false_alarms_an_hour_are_those_of_the_noise() -> None:
    case = control_group(detector__thresholds_Nm=[12.0, math.inf, 20, 20, 20, 20, 20], detector__noise_sd_Nm=4.0)
    rate = bs.evaluate(case).verdict.false_alarms_per_hour
    each = [math.erfc(threshold / 4.0 / math.sqrt(2)) for threshold in (12.0, *[20.0] * 5)]
    assert rate == pytest.approx(-math.expm1(sum(math.log1p(-p) for p in each)) * 3600 / 0.004, rel=1e-9)
    correlated = alarm_rate(bs.CollisionProblem.from_scenario(case.with_values({"detector.noise_correlation": 0.5})))
    assert correlated.words.startswith("at most ")
    assert (
        alarm_rate(bs.CollisionProblem.from_scenario(control_group())).words
        == "0.239 false alarms an hour of free motion"
    )


def test_too_few_collisions_of_measured_residuals_stand_beside_the_verdict(tmp_path: Path) -> None:
    """None of 100 000 collisions is over a limit, of which one in ten million may be."""
    write_residuals(
        tmp_path / "free.parquet", 0.004 * np.arange(9000), np.random.default_rng(0).normal(0, 1, (9000, 7))
    )
    data = control_group().to_dict()
    for key in ("noise_sd_Nm", "noise_mean_Nm", "noise_correlation"):
        del data["detector"][key]
    data["detector"]["residuals"] = "free.parquet"
    data["motion"]["velocity_mm_s"] = [0, 0, -10]
    data["contact"] |= {"body": "lower_arm_wrist", "limits": "ts15066"}
    case = bs.Scenario.from_dict(data, tmp_path)
    few = bs.evaluate(case.with_values({"verdict.accepted_probability": 1e-7}))
    assert few.verdict.acceptable
    (said,) = few.warnings
    assert said == (
        "100000 sampled collisions are too few to judge by: a probability of the accepted 1e-05 % is some 0.01 of them."
    )
    assert few.to_json()["verdict"]["warnings"] == [said]
    assert few.notes.count(said) == 1
    assert f"accepted: 1e-05 %. warning: {said}" in " ".join(str(few).split())
    assert bs.evaluate(case).warnings == ()


def test_false_alarms_an_hour_of_measured_residuals_are_counted(tmp_path: Path) -> None:
    rows = np.zeros((9000, 7))
    rows[100:103, 2] = 25.0  # one that lasts
    rows[5000, 4] = -30.0
    write_residuals(tmp_path / "free.parquet", 0.004 * np.arange(9000), rows)
    data = control_group().to_dict()
    del data["detector"]["noise_sd_Nm"]
    del data["detector"]["noise_mean_Nm"], data["detector"]["noise_correlation"]
    data["detector"]["residuals"] = "free.parquet"
    rate = alarm_rate(bs.CollisionProblem.from_scenario(bs.Scenario.from_dict(data, tmp_path)))
    assert rate.kind == "measured"
    assert rate.per_hour == pytest.approx(2 / 0.01)
    assert rate.words == "200 false alarms an hour in 36 s of measured free motion"


# Beside a singularity: to react sooner takes it up to 16 mm farther.
SWINGING: dict[str, Any] = {
    "robot": "ur10e",
    "pose_rad": [
        -2.3952334764872987,
        -0.6743852189268953,
        0.10378913225245467,
        -0.430106273432098,
        0.5381511429164725,
        1.5,
    ],
    "motion": {"velocity_mm_s": [-146.97091437600375, 181.24815073225867, -89.71431426265158]},
    "contact": {"body": "hand_finger", "limits": "ts15066", "area_cm2": 2.0},
    "detector": {"thresholds_Nm": [20.0] * 6, "noise_sd_Nm": 3.6},
    "reaction": {"joint_acceleration_rad_s2": 4.5, "latency_s": 0.02},
}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"contact.kind": "free", "contact.body_mass_kg": 20.0}, "contact that gives way follows the latest reaction"),
        ({"arm.model": "elastic"}, "contact that gives way follows the latest reaction"),
        ({"verdict.clamped_limit": "two_phase"}, "the second phase of contact follows the latest reaction"),
        ({}, ""),
        ({"contact.kind": "free", "contact.body_mass_kg": 20.0, "reaction.latency_s": 0.0}, ""),
    ],
)
def test_where_a_sooner_reaction_goes_farther_than_the_one_followed(changes: dict[str, Any], said: str) -> None:
    result = bs.evaluate(bs.Scenario.from_dict(SWINGING).with_values(changes))
    told = [warning for warning in result.warnings if "reacts sooner" in warning]
    assert len(told) == bool(said)
    assert all(said in warning for warning in told)
    # Clear of singularities the latest reaction goes farthest.
    calm = bs.evaluate(ur10e().with_values({"reaction.latency_s": 0.02}).with_values(changes))
    assert not any("reacts sooner" in warning for warning in calm.warnings)


@pytest.mark.parametrize("latency_s", [0.1, 0.2])
def test_a_sooner_reaction_goes_farther_than_the_brake_at_the_end_of_the_line(latency_s: float) -> None:
    """The arm slows down towards its limit, which it reaches after 114 ms: 312 N without latency, 236 N with it."""
    slowing = {
        "robot": "ur5e",
        "pose_rad": [
            5.835057210791876, -3.051133368991834, 2.9909977090868756, 6.199696873316511, -5.925838638813958,
            6.007482208206539,
        ],
        "motion": {"velocity_mm_s": [-22.99335181811892, -193.44983528963505, -228.14133119314724], "task": "position"},
        "contact": {"body": "hand_finger", "limits": "ts15066", "area_cm2": 2.0},
        "detector": {"thresholds_Nm": [20.0] * 6, "noise_sd_Nm": 2.0},
        "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 15.0, "latency_s": latency_s},
        "arm": {"model": "elastic"},
    }  # fmt: skip
    result = bs.evaluate(bs.Scenario.from_dict(slowing))
    assert result.curve.end == "joint_limit"
    assert any("gets up to 3.9" in warning for warning in result.warnings if "reacts sooner" in warning)
