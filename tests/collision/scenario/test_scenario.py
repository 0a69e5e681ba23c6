"""The scenario reader: what it accepts, what it refuses, and in which words."""

from __future__ import annotations

import copy
import datetime
import math
from pathlib import Path
from typing import Any

import pytest

import bumpstop as bs
from bumpstop.collision import CollisionProblem, Scenario, load_scenario
from bumpstop.collision.scenario.keys import MADE_BY
from bumpstop.collision.scenario.scenario_words import as_written
from bumpstop.errors import InputError, near_matches
from collision.scenario_cases import EXAMPLE, example, is_let_go


def changed(key: str, value: Any) -> dict[str, Any]:
    data = example()
    *tables, last = key.split(".")
    here = data
    for table in tables:
        here = here.setdefault(table, {})
    here[last] = value
    return data


def refusal(data: Any) -> str:
    """The message with which a scenario is refused, by the reader or with its robot and tables in view."""
    with pytest.raises(InputError) as caught:
        CollisionProblem.from_scenario(Scenario.from_dict(data))
    return str(caught.value)


# What is accepted.


def test_the_example_is_read_as_written() -> None:
    scenario = load_scenario(EXAMPLE)
    assert scenario.robot == "sia5d"
    assert scenario.motion.velocity == (0, 0, -0.05)
    assert scenario.motion.held_joints == [7]
    assert scenario.contact.area_cm2 == 2.0
    assert scenario.detector.thresholds_Nm == [20, 10, 20, 20, 20, 20, 20]
    assert scenario.folder == EXAMPLE.parent


def test_defaults_are_those_of_the_format() -> None:
    scenario = Scenario.from_dict(
        {
            "robot": "sia5d",
            "pose_deg": [0, 30, 0, -20, 0, -40, 0],
            "motion": {"velocity_mm_s": [0, 0, -50]},
            "contact": {"body": "hand_finger"},
            "detector": {"thresholds_Nm": [20] * 7, "noise_sd_Nm": 2},
            "reaction": {"joint_acceleration_rad_s2": 4.5},
        }
    )
    motion, contact, detector = scenario.motion, scenario.contact, scenario.detector
    assert (motion.kind, motion.start, motion.duration_s, motion.task) == ("line", "moving", 5.0, "pose")
    assert (motion.held_joints, motion.damping) == ([], 0.0)
    assert (contact.limits, contact.kind, contact.area_cm2, contact.peak_factor) == ("bgia2011", "clamped", 1.0, 1.0)
    assert (contact.link, contact.point_m, contact.normal) == (None, [0, 0, 0], None)
    assert (contact.arm, contact.offset_law, contact.offset_sd_s) == ("position_driven", "uniform", 0.1)
    assert (detector.noise_mean_Nm, detector.feedback_period_s) == (0.0, 0.004)
    assert (detector.residual, detector.arming_delay_s) == ("direct", 0.0)
    assert (scenario.reaction.kind, scenario.reaction.latency_s) == ("reverse", 0.0)
    assert (scenario.simulation.step_s, scenario.simulation.substeps) == (0.001, 5)
    verdict = scenario.verdict
    assert (verdict.accepted_probability, verdict.max_false_alarm, verdict.clamped_limit) == (
        1e-3,
        1e-3,
        "quasi_static",
    )


def test_a_dictionary_survives_a_round_trip_and_is_not_touched() -> None:
    data = changed("detector.noise_correlation", 0.0)
    before = copy.deepcopy(data)
    scenario = Scenario.from_dict(data)
    assert data == before
    assert Scenario.from_dict(scenario.to_dict()) == scenario.with_values({})


def test_an_assumed_area_stays_an_assumption() -> None:
    data = example()
    del data["contact"]["area_cm2"]
    scenario = Scenario.from_dict(data)
    again = Scenario.from_dict(scenario.to_dict())
    note = "Contact area not given: 1 cm² assumed."
    assert note in CollisionProblem.from_scenario(scenario).notes
    assert note in CollisionProblem.from_scenario(again).notes
    assert note not in CollisionProblem.from_scenario(again.with_values({"contact.area_cm2": 1.0})).notes


def test_of_the_two_poses_a_change_replaces_the_other() -> None:
    scenario = load_scenario(EXAMPLE)
    pose = [math.radians(angle) for angle in scenario.pose_deg or []]
    in_radians = scenario.with_values({"pose_rad": pose})
    assert in_radians.pose_deg is None
    assert CollisionProblem.from_scenario(in_radians).q == pytest.approx(CollisionProblem.from_scenario(scenario).q)


def test_the_record_of_a_run_is_passed_over() -> None:
    record = {"law": "exact", "numpy": "1.0", "anything": [1, 2]}
    assert Scenario.from_dict(example() | {MADE_BY: record}) == Scenario.from_dict(example())
    # Only that table, and only as a table.
    assert "made_by: is not a key" in refusal(example() | {MADE_BY: 5})
    assert "made_with: is not a key" in refusal(example() | {"made_with": record})


# What is refused: key, value, and what the message must say beyond the key.

BAD_VALUES: list[tuple[str, Any, str]] = [
    ("contact.area_cm2", 0, "0 cannot be used; wanted a number from 0.0001 to 10000"),
    ("contact.area_cm2", "two", "'two' cannot be used; wanted a number from"),
    ("contact.area_cm2", True, "true cannot be used; wanted a number from"),
    ("contact.area_cm2", math.nan, "nan cannot be used"),
    ("contact.area_cm2", math.inf, "inf cannot be used"),
    ("contact.area_cm2", [1.0], "[1.0] cannot be used; wanted a number from"),
    ("contact.area_cm2", {"a": 1}, "a table cannot be used"),
    ("contact.area_cm2", datetime.date(2020, 1, 2), "2020-01-02 cannot be used"),
    ("contact.area_cm2", None, "None cannot be used"),
    ("contact.stiffness_N_m", -75000, "-75000 cannot be used; wanted a number from 1 to 1e9"),
    ("contact.stiffness_N_m", 0, "0 cannot be used"),
    ("contact.stiffness_N_m", 1e300, "1e+300 cannot be used"),
    ("contact.stiffness_N_m", 10**400, "a number of more than 40 digits cannot be used"),
    ("contact.peak_factor", 0.99, "0.99 cannot be used; wanted a number from 1 to 1000"),
    ("contact.body", "hand", "'hand' is not a region of bgia2011; did you mean 'hand_finger'?"),
    ("contact.body", "skull_forehead", "'skull_forehead' is not a region of bgia2011 but of ts15066"),
    ("contact.body", 7, "7 cannot be used; wanted the name of a body region"),
    ("contact.limits", "ts15606", "did you mean 'ts15066'?"),
    ("contact.pressure_area", "palm", "'palm' is not a pressure area of hand_finger"),
    ("contact.kind", "soft", "'soft' cannot be used; wanted 'clamped'"),
    ("contact.link", "tool", "sia5d has no link 'tool'; did you mean 'tool0'?"),
    ("contact.link", "link_s", "the contact point on link_s does not move toward the body"),
    ("contact.point_m", [0, 0, 1e300], "wanted a number from -100 to 100"),
    ("contact.normal", [0, 0, 0], "is no direction"),
    ("contact.normal", [0, 0, -1e-320], "is no direction"),
    ("contact.normal", [0, -1e308, -1.7e308], "wanted a number from -1e6 to 1e6"),
    ("contact.normal", [0, 0, 1], "does not move toward the body (-50 mm/s along the normal)"),
    ("contact.normal", [0, 1], "[0, 1] cannot be used; wanted a list of 3 numbers from"),
    ("contact.offset_mm", 1.0, 'has no meaning with offset_law = "half_normal"'),
    ("contact.offset_law", "normal", "wanted 'half_normal', 'uniform' or 'fixed'"),
    ("contact.offset_law", "fixed", 'contact.offset_mm: is missing; offset_law = "fixed" needs it'),
    ("contact.offset_sd_s", 0, "0 cannot be used"),
    ("contact", "soft", "'soft' cannot be used; wanted a table: [contact]"),
    ("contact", [{"body": "hand_finger"}], "[[contact]] cannot be used; wanted a table: [contact]"),
    ("detector.thresholds_Nm", 20, "20 cannot be used; wanted a list of numbers, one per joint"),
    ("detector.thresholds_Nm", [20] * 6, "has 6 values; sia5d has 7 joints"),
    ("detector.thresholds_Nm", [20, 0, 20, 20, 20, 20, 20], "thresholds_Nm[2]: 0 cannot be used; wanted a number from"),
    ("detector.thresholds_Nm", [20, 9, -1.5, 2, 2, 2, 2], "thresholds_Nm[3]: -1.5 cannot be used"),
    ("detector.thresholds_Nm", [math.nan, 9, 2, 2, 2, 2, 2], "thresholds_Nm[1]: nan cannot be used"),
    ("detector.thresholds_Nm", [9, 9, 2, 2, 2, 2, -math.inf], "thresholds_Nm[7]: -inf cannot be used"),
    ("detector.thresholds_Nm", [9, 9, 2, "x", 2, 2, 2], "thresholds_Nm[4]: 'x' cannot be used"),
    ("detector.noise_sd_Nm", -1, "-1 cannot be used; wanted a number from 0 to 1e6, or a list of one per joint"),
    ("detector.noise_sd_Nm", [1] * 8, "has 8 values; sia5d has 7 joints: one for each, or one number for all"),
    (
        "detector.noise_sd_Nm",
        [1, 2, 3, -4, 5, 6, 7],
        "noise_sd_Nm[4]: -4 cannot be used; wanted a number from 0 to 1e6",
    ),
    ("detector.noise_sd_Nm", [1, "x", 3, 4, 5, 6, 7], "noise_sd_Nm[2]: 'x' cannot be used"),
    ("detector.noise_sd_Nm", [True, 2, 3, 4, 5, 6, 7], "noise_sd_Nm[1]: true cannot be used"),
    ("detector.noise_sd_Nm", math.inf, "inf cannot be used"),
    ("detector.noise_mean_Nm", [0] * 3, "has 3 values"),
    ("detector.feedback_period_s", 0, "0 cannot be used"),
    ("detector.feedback_period_s", 0.0035, "0.0035 is not a whole number of simulation steps; wanted a multiple of"),
    ("detector.feedback_period_s", 1e300, "1e+300 cannot be used"),
    ("detector.residual", "observe", "'observe' cannot be used"),
    ("detector.observer_gain_1_s", 0, "0 cannot be used; wanted a number from 0.001"),
    ("detector.noise_correlation", 1, "1 cannot be used; wanted a number from -0.99 to 0.995"),
    ("detector.noise_correlation", False, "false cannot be used; wanted a number from -0.99 to 0.995"),
    ("detector.residuals", 3, "3 cannot be used"),
    ("contact.padding_N_m", 0, "0 cannot be used"),
    ("contact.kind", "loose", "'loose' cannot be used"),
    ("verdict.clamped_limit", "three_phase", "'three_phase' cannot be used"),
    ("motion.velocity_mm_s", [0, 0, 0], "is zero"),
    ("motion.velocity_mm_s", [0, 0, 1e-320], "wanted at least 0.001"),
    ("motion.velocity_mm_s", [0, 50], "[0, 50] cannot be used; wanted a list of 3 numbers"),
    ("motion.velocity_mm_s", [0, math.nan, 0], "velocity_mm_s[2]: nan cannot be used"),
    ("motion.velocity_mm_s", 50, "50 cannot be used; wanted a list of 3 numbers"),
    ("motion.start", "now", "'now' cannot be used; wanted 'moving' or 'rest'"),
    ("motion.duration_s", 0, "0 cannot be used"),
    ("motion.duration_s", 99999, "is 9.9999e+07 simulation steps"),
    ("motion.duration_s", 1e300, "1e+300 cannot be used"),
    ("motion.held_joints", [0], "0 is no joint of sia5d; valid: 1 to 7"),
    ("motion.held_joints", [8], "8 is no joint of sia5d; valid: 1 to 7"),
    ("motion.held_joints", [7, 1, 7], "joint 7 is named twice"),
    ("motion.held_joints", [1, 2, 3, 4, 5, 6, 7], "at least one must move"),
    ("motion.held_joints", [1, 7], "motion.task: 'pose' needs 6 free joints, 5 are free; wanted task = \"position\""),
    ("motion.held_joints", [1, 2, 3, 4, 7], "needs 6 free joints, 2 are free; wanted fewer held joints"),
    ("motion.held_joints", 7, "7 cannot be used; wanted a list of whole numbers"),
    ("motion.held_joints", [7.0], "held_joints[1]: 7.0 cannot be used; wanted a whole number"),
    ("motion.held_joints", [True], "held_joints[1]: true cannot be used"),
    ("pose_deg", [0] * 7, "is singular"),
    ("pose_deg", [0, 30, 0], "has 3 values; sia5d has 7 joints"),
    ("pose_deg", [0, 300, 0, -20, 0, -40, 0], "joint 2 at 300 is outside its limits; valid: -110 to 110 deg"),
    ("pose_deg", [0, 30, 0, -20, 0, -40, math.inf], "pose_deg[7]: inf cannot be used"),
    ("pose_rad", [0.0] * 7, "and pose_rad are both given"),
    ("reaction.joint_acceleration_rad_s2", [4.5, 4.5], "has 2 values"),
    ("reaction.joint_acceleration_rad_s2", 0, "0 cannot be used; wanted a number from 0.1 to 100000"),
    ("reaction.joint_acceleration_rad_s2", "fast", "'fast' cannot be used"),
    ("reaction.latency_s", -0.1, "-0.1 cannot be used"),
    ("reaction.latency_s", 1e300, "1e+300 cannot be used"),
    ("reaction.kind", "jump", "wanted 'reverse' or 'stop'"),
    ("reaction", 5, "5 cannot be used; wanted a table: [reaction] with joint_acceleration_rad_s2"),
    ("robot", "sia5", "there is no built-in robot 'sia5'; did you mean 'sia5d'?"),
    ("robot", "UR10E", "did you mean 'ur10e' or "),
    ("robot", "absent.urdf", "robot: absent.urdf: cannot be read (No such file or directory); wanted a URDF file"),
    ("base", "b", "has no meaning with the built-in robot 'sia5d'; give it with the path of a URDF"),
    ("tip", "", "has no meaning with the built-in robot 'sia5d'"),
    ("tip", 5, "5 cannot be used; wanted the name of a link of the URDF"),
    ("robot", 5, "5 cannot be used; wanted the name of a robot"),
    ("robot", {"name": "sia5d"}, "a table cannot be used"),
    ("simulation.step_s", 1e-300, "1e-300 cannot be used"),
    ("simulation.step_s", 5e-324, "5e-324 cannot be used"),
    ("simulation.substeps", 0, "0 cannot be used; wanted a whole number from 1 to 1000"),
    ("simulation.substeps", 2.5, "2.5 cannot be used; wanted a whole number"),
    ("simulation.substeps", 10**30, "cannot be used; wanted a whole number from 1 to 1000"),
    ("verdict.accepted_probability", 0, "0 cannot be used; wanted a number above 1e-15 and below 1"),
    ("verdict.accepted_probability", 1, "1 cannot be used; wanted a number above 1e-15 and below 1"),
    ("verdict.max_false_alarm", -1e-3, "-0.001 cannot be used"),
    # Keys that are none.
    ("motion.velocity_mms", [0, 0, 1], "is not a key of a scenario; did you mean 'velocity_mm_s'?"),
    ("motion.zzz", 1, "valid: kind, velocity_mm_s, speed_mm_s, direction, start, duration_s, task,"),
    ("detektor.x", 1, "detektor: is not a key of a scenario; did you mean 'detector'?"),
    ("folder", "/tmp", "is not a key of a scenario; valid: robot, "),
    # Names that pydantic uses for branches of its own, and digits.
    ("float", 1, "float: is not a key"),
    ("motion.int", 1, "motion.int: is not a key"),
    ("motion.7", 1, "motion.7: is not a key"),
    ("contact.list[float]", 1, "contact.'list[float]': is not a key"),
    ("motion.", 1, "motion.'': is not a key"),
    ("contact.\x1b[31m", 1, r"contact.'\x1b[31m': is not a key"),
]


@pytest.mark.parametrize(
    ("key", "value", "message"), BAD_VALUES, ids=[f"{k}-{i}" for i, (k, *_) in enumerate(BAD_VALUES)]
)
def test_bad_values_are_refused_by_name(key: str, value: Any, message: str) -> None:
    said = refusal(changed(key, value))
    assert message in said
    # The key comes first, or one that the value leads to.
    table = key.partition(".")[0]
    assert said.startswith((table, "contact.offset_mm", "pose_deg"))
    for leak in ("pydantic", "constrained", "type=", "Input should", "extra_forbidden", "folder"):
        assert leak not in said.replace("folder: ", "")


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("robot", "robot: is missing; wanted the name of a robot"),
        ("pose_deg", "pose_deg: is missing; give pose_deg or pose_rad, one of them"),
        ("motion", "motion: is missing; wanted a table: [motion] with velocity_mm_s"),
        ("motion.velocity_mm_s", "motion.velocity_mm_s: is missing; wanted a list of 3 numbers"),
        ("contact", "contact: is missing; wanted a table: [contact]"),
        ("contact.body", "contact.body: is missing; name a body region, or give contact.stiffness_N_m"),
        ("detector", "wanted a table: [detector] with thresholds_Nm"),
        ("detector.thresholds_Nm", "detector.thresholds_Nm: is missing; wanted a list of numbers, one per joint"),
        (
            "detector.noise_sd_Nm",
            "detector.noise_sd_Nm: is missing; give it, or measured detector.residuals in its place",
        ),
        ("reaction", "wanted a table: [reaction] with joint_acceleration_rad_s2"),
        ("reaction.joint_acceleration_rad_s2", "is missing; wanted a number from 0.1 to 100000, or a list of one"),
    ],
)
def test_missing_keys_are_named(key: str, message: str) -> None:
    data = example()
    *tables, last = key.split(".")
    here = data
    for table in tables:
        here = here[table]
    del here[last]
    assert message in refusal(data)


def test_a_misspelt_key_is_named_rather_than_the_missing_one() -> None:
    data = example()
    data["motion"]["velocity_mms"] = data["motion"].pop("velocity_mm_s")
    assert refusal(data) == "motion.velocity_mms: is not a key of a scenario; did you mean 'velocity_mm_s'?"


@pytest.mark.parametrize("data", [None, 5, "robot", [1], [("robot", "sia5d")]])
def test_only_a_dictionary_is_a_scenario(data: Any) -> None:
    assert "wanted a dictionary" in refusal(data)


def test_keys_that_are_no_text_are_refused() -> None:
    assert refusal(example() | {1: 2}).startswith("1: is not a key of a scenario")
    data = example()
    data["motion"][None] = 2
    assert "is not a key of a scenario" in refusal(data)


def test_changes_go_into_tables_only() -> None:
    for key in ("robot.x", "contact.area_cm2.x"):
        with pytest.raises(InputError, match="is not a table"):
            load_scenario(EXAMPLE, {key: 5})
    assert load_scenario(EXAMPLE, {"verdict.accepted_probability": 0.01}).verdict.accepted_probability == 0.01


@pytest.mark.parametrize("key", ["motion.task", "pose_rad", "motion.speed"])
def test_a_refusal_holds_nobody(key: str) -> None:
    """Pydantic's error holds ours where the collector of cycles cannot see it: it must not be in the chain of ours."""
    assert is_let_go(lambda: Scenario.from_dict(changed(key, [0.0])))


# Words.


def test_values_are_shown_as_a_file_spells_them() -> None:
    assert as_written(True) == "true"
    assert as_written([1, 2.5, "x", False]) == "[1, 2.5, 'x', false]"
    assert as_written(None) == "None"
    assert as_written(datetime.datetime(2020, 1, 2, 3, 4)) == "2020-01-02T03:04:00"
    assert as_written(object()) == "a value of type object"
    assert len(as_written("x" * 10_000)) < 80
    assert len(as_written([[1.5] * 1000] * 1000)) < 2000
    nested: Any = []
    for _ in range(100_000):
        nested = [nested]
    assert len(as_written(nested)) < 80


def test_near_matches_see_through_case_and_shortening() -> None:
    known = ("hand_finger", "lower_arm_wrist", "upper_arm_elbow", "face")
    assert near_matches("hand_fingr", known) == "did you mean 'hand_finger'?"
    assert near_matches("FACE", known) == "did you mean 'face'?"
    assert near_matches("arm", known) == "did you mean 'lower_arm_wrist' or 'upper_arm_elbow'?"
    assert near_matches("xyzzy", known) == "valid: hand_finger, lower_arm_wrist, upper_arm_elbow, face"
    assert near_matches("", known).startswith("valid: ")


def test_an_arm_of_one_joint_is_told_what_it_can_do(tmp_path: Path) -> None:
    (tmp_path / "door.urdf").write_text(
        """<robot name="door"><link name="frame"/><link name="leaf"/><joint name="hinge" type="revolute">
        <parent link="frame"/><child link="leaf"/><axis xyz="0 0 1"/>
        <limit lower="0" upper="2" velocity="1" effort="9"/></joint></robot>"""
    )
    data: dict[str, Any] = {
        "robot": "door.urdf",
        "pose_deg": [10],
        "motion": {"velocity_mm_s": [0, 50, 0], "task": "position"},
        "contact": {"stiffness_N_m": 5000, "link": "leaf", "point_m": [0.5, 0, 0]},
        "detector": {"thresholds_Nm": [5], "noise_sd_Nm": 1},
        "reaction": {"joint_acceleration_rad_s2": 5},
    }
    with pytest.raises(InputError, match=r'motion\.task: .*1 are free; .*give motion\.kind = "trajectory"'):
        bs.evaluate(Scenario.from_dict(data, tmp_path))
    (tmp_path / "door.csv").write_text("t,q_1\n0,0.1\n0.5,0.4\n1,0.5\n")
    data["motion"] = {"kind": "trajectory", "file": "door.csv", "contact_onset_s": 0.2}
    del data["pose_deg"]
    assert bs.evaluate(Scenario.from_dict(data, tmp_path)).peak_force.mean > 5
