"""What makes a verdict mean less than it says is said beside the answers of studies and requirements, too."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.detection.tuning.residual_record import write_residuals
from bumpstop.report.studies.effectiveness import SafeSpeedsPart
from bumpstop.study import ParameterStudy, TrajectorySpeedLimits, WorkspaceSpeedLimits, WorkspaceStudy, run
from bumpstop.study.answer_warnings import AnswerWarnings, line_through, told_once, warnings_of
from bumpstop.study.parameters.effectiveness import EffectivenessStudy
from bumpstop.study.requirement.requirement import solve_requirement
from bumpstop.study.speed.trajectory.slowing import judge_motion
from cli.support import run as command

HAND = Path("examples/01_hand_downward.toml")
STEPS = {"simulation.step_s": 0.05, "simulation.substeps": 1, "detector.feedback_period_s": 0.05}
COARSE = {"contact.body": "lower_arm_wrist", "contact.limits": "ts15066"} | STEPS
FAILS = "but NOT ACCEPTABLE with finer simulation steps"
SKULL = {"contact.body": "skull_forehead", "contact.limits": "ts15066"}


def scenario(values: dict[str, Any]) -> bs.Scenario:
    return bs.load_scenario(HAND, values)


def options(values: dict[str, Any]) -> list[str]:
    return [text for key, value in values.items() for text in ("--set", f"{key}={value}")]


def test_a_requirement_that_finer_steps_break_is_no_plain_answer() -> None:
    found = solve_requirement(scenario(COARSE), "motion.speed")
    assert found.fails_with_finer_steps
    assert str(found).splitlines()[0] == f"motion.speed: at most {found.value:g} mm/s, {FAILS}"
    (said,) = found.notes
    assert said.startswith("Simulation steps are coarse")
    assert said.endswith("the verdict is NOT ACCEPTABLE.")
    there = scenario(COARSE | {"motion.velocity_mm_s": [0, 0, -found.value]})
    assert found.notes == bs.evaluate(there).warnings
    assert found.to_json()["fails_with_finer_steps"]
    fine = solve_requirement(scenario({"contact.body": "lower_arm_wrist"}), "motion.speed")
    assert not fine.fails_with_finer_steps
    assert fine.notes == ()


def test_a_trade_curve_says_so_at_each_value_and_once_below() -> None:
    vary = ["--vary", "motion.speed", "--vary", "contact.padding=2e5:4e5:2"]
    out = command("require", HAND, *options(COARSE), *vary).out
    rows = [line for line in out.splitlines() if "force" in line and "note" not in line]
    assert len(rows) == 2
    assert all(row.endswith("; NOT ACCEPTABLE with finer simulation steps") for row in rows)
    assert out.count("Simulation steps are coarse") == 1
    assert "note: contact.padding = 200000 and one more answer: Simulation steps are coarse" in out


def test_limits_of_the_head_are_told() -> None:
    (said,) = solve_requirement(scenario(SKULL), "motion.speed").notes
    assert "ISO/TS 15066 asks that contact with skull" in said
    study = EffectivenessStudy.of(scenario({}), ["skull_forehead"], ["down"])
    summary = run(study).summary
    assert summary["notes"] == [f"ts15066 skull_forehead down 1 cm² and one more answer: {said}"]
    assert [each["warnings"] for each in summary["safe_speeds"]] == [[said], [said]]


def test_safe_speeds_that_finer_steps_break_are_no_plain_answers(tmp_path: Path) -> None:
    asked = ["--body", "lower_arm_wrist", "--direction", "down", "--area", "2"]
    done = command("study", "effectiveness", HAND, *asked, *options(STEPS), "--out", tmp_path / "out")
    speeds = [line for line in done.out.splitlines() if "lower_arm_wrist" in line and "note:" not in line]
    assert len(speeds) == 2
    assert all(line.endswith(f", {FAILS}") for line in speeds)
    assert "the verdict is NOT ACCEPTABLE" in " ".join(done.out.split())
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.index("Simulation steps are coarse") < page.index('id="safe-speeds"')
    assert "65.2 (f) †" in page
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary["fails_with_finer_steps"]
    assert all(each["fails_with_finer_steps"] for each in summary["safe_speeds"])


def test_safe_speeds_of_too_few_sampled_collisions_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bumpstop.collision.evaluation.RESAMPLED_RUNS", 2000)
    write_residuals(tmp_path / "free.parquet", 0.004 * np.arange(400), np.zeros((400, 7)))
    given = HAND.read_text(encoding="utf-8")
    (tmp_path / "m.toml").write_text(re.sub("noise_sd_Nm = .*", 'residuals = "free.parquet"', given), encoding="utf-8")
    study = EffectivenessStudy.of(bs.load_scenario(tmp_path / "m.toml"), ["hand_finger"], ["down"], areas_cm2=[2.0])
    summary = run(study).summary
    few = "2000 sampled collisions are too few to judge by"
    assert all(each["warnings"][0].startswith(few) for each in summary["safe_speeds"])
    assert sum(few in note for note in summary["notes"]) == 1


def test_warnings_are_those_of_the_area_that_is_judged() -> None:
    """Distributions are kept by speed, and the verdict of one area is not that of another."""
    study = EffectivenessStudy.of(scenario(STEPS), ["lower_arm_wrist"], ["down"], areas_cm2=[1.0, 2.0])
    for each in run(study).summary["safe_speeds"]:
        there = study.scenario_of(each["table"], each["body"], "down", each["safe_speed_mm_s"], each["area_cm2"])
        assert each["warnings"] == list(bs.evaluate(there).warnings)


def test_pages_without_warnings_have_no_mark() -> None:
    study = EffectivenessStudy.of(scenario({}), ["hand_finger"], ["down"], areas_cm2=[2.0])
    summary = run(study).summary
    assert not summary["fails_with_finer_steps"]
    assert "notes" not in summary
    assert "†" not in "".join(SafeSpeedsPart(study, summary).content())


def test_speed_limits_of_poses_say_so() -> None:
    steps = {"simulation.step_s": 0.02, "simulation.substeps": 1, "detector.feedback_period_s": 0.02}
    study = WorkspaceSpeedLimits(scenario(steps), poses=4, cone_deg=0.0)
    found = run(study)
    assert found.summary["fails_with_finer_steps"]
    assert "speeds among these are NOT ACCEPTABLE with finer simulation steps" in str(found)
    (said,) = [note for note in found.summary["notes"] if "coarse" in note]
    fastest = found.rows.sort("limit_mm_s").row(-1, named=True)
    assert said.startswith(f"the limit of {fastest['limit_mm_s']:.4g} mm/s at pose {fastest['pose']}: ")
    fine = run(WorkspaceSpeedLimits(scenario({}), poses=4, cone_deg=0.0)).summary
    assert not fine["fails_with_finer_steps"]


def test_speed_limits_of_a_trajectory_say_so() -> None:
    path = bs.load_scenario("examples/06_pick_and_place_trajectory.toml", SKULL)
    summary = run(TrajectorySpeedLimits(path)).summary
    assert sum("ISO/TS 15066 asks" in note for note in summary["notes"]) == 1


def test_a_workspace_says_so() -> None:
    summary = run(WorkspaceStudy(scenario(SKULL), poses=5)).summary
    assert sum("ISO/TS 15066 asks" in note for note in summary["notes"]) == 1


def test_parameters_and_the_guide_say_so() -> None:
    fast = COARSE | {"motion.velocity_mm_s": [0, 0, -100]}
    study = ParameterStudy.of(scenario(fast), ["motion.speed=30:100:3"], None, ["motion.speed=1"])
    found = run(study)
    plan = found.summary["guide"]["combined"]
    assert any("the verdict is NOT ACCEPTABLE" in warning for warning in plan["warnings"])
    assert f"{plan['values']['motion.speed']:.10g}, {FAILS}" in str(found)
    assert any(note.startswith("the cheapest way to meet the limits and one more") for note in found.summary["notes"])
    head = run(ParameterStudy.of(scenario(SKULL), ["motion.speed=30:40:2"])).summary
    assert head["notes"] == [f"the scenario as given: {bs.evaluate(scenario(SKULL)).warnings[0]}"]


def test_sentences_that_differ_by_figures_are_told_once() -> None:
    found = [
        AnswerWarnings("a", ["It is 3.5 N, not 1e-3 N.", "So it is."]),
        AnswerWarnings("b", ["It is 4 N, not 2.5e+10 N.", "Known."]),
        AnswerWarnings("c", ["It is 5 N, not 2 N."]),
    ]
    assert told_once(found, ["Known."]) == ["a and 2 more answers: It is 3.5 N, not 1e-3 N.", "a: So it is."]


def test_a_line_through_another_pose_is_followed_as_far() -> None:
    given = bs.load_scenario(HAND)
    robot = bs.Robot.load(given.robot)
    q = np.linspace(0.1, 0.7, robot.dof)
    slow = line_through(given, q, np.array([0.0, 0.01, 0.0]))
    assert slow.pose_rad == q.tolist()
    assert slow.pose_deg is None
    assert slow.motion.velocity_mm_s == pytest.approx([0, 10, 0])
    assert slow.motion.duration_s == pytest.approx(5 * given.motion.duration_s)


def test_an_answer_without_a_distribution_has_no_warnings() -> None:
    assert warnings_of(lambda: scenario({"motion.velocity_mm_s": [0, 0, 0]})) == ()


def test_an_answer_says_that_the_rigid_arm_fails_there() -> None:
    elastic = bs.load_scenario("examples/05_ur10e.toml", {"arm.model": "elastic"})
    found = solve_requirement(elastic, "motion.speed")
    assert found.value is not None
    there = {"motion.velocity_mm_s": [found.value * v for v in (2 / 3, 1 / 3, -2 / 3)]}
    assert bs.evaluate(elastic.with_values(there)).verdict.acceptable is True
    assert bs.evaluate(elastic.with_values(there | {"arm.model": "rigid"})).verdict.acceptable is False
    assert found.notes[-1].startswith("The rigid arm in the place of the elastic one exceeds the limits: the peak ")
    slow = elastic.with_values({"motion.velocity_mm_s": [40, 20, -40]})
    assert not [warning for warning in warnings_of(lambda: slow) if "in the place" in warning]


def test_that_the_other_arm_fails_is_said_of_a_trajectory() -> None:
    changes = {"arm.model": "elastic", "motion.contact_onset_s": 1.5}
    judged = judge_motion(bs.load_scenario("examples/06_pick_and_place_trajectory.toml", changes))
    assert judged.acceptable
    assert "The rigid arm in the place of the elastic one exceeds the limits" in judged.warnings[-1]
