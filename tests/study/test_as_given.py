"""Studies and requirements take the scenario as given: where its numbers are uncertain they say so."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

import bumpstop as bs
from bumpstop.model.urdf.writer import write_urdf
from bumpstop.program.evaluation import evaluate_program
from bumpstop.study import TrajectorySpeedLimits, run
from bumpstop.study.parameters.parameters import ParameterStudy
from bumpstop.study.range import Range
from bumpstop.study.requirement.requirement import require_curve, solve_requirement
from cli.support import run as command

HAND = Path("examples/01_hand_downward.toml")
UNCERTAIN = Path("examples/07_hand_uncertain.toml")
_SAID = "This is the scenario as given: that 5 of its numbers are uncertain ([uncertainty]) is left out."


def uncertain() -> bs.Scenario:
    return bs.load_scenario(UNCERTAIN)


def test_a_requirement_says_so() -> None:
    found = solve_requirement(uncertain(), "motion.speed")
    assert found.notes[0].startswith(_SAID)
    assert f"note: {_SAID}" in str(found)
    known = solve_requirement(uncertain().without_uncertainty(), "motion.speed")
    assert known.notes == ()
    assert known.value == found.value
    rows = require_curve(uncertain(), "motion.speed", Range.parse("contact.padding=2e4:4e4:2", uncertain()))
    assert all(row["notes"] == list(found.notes) for row in rows)


def test_what_is_looked_for_is_not_assumed() -> None:
    """Its value is the answer: a note that lists it beside one that does not says both."""
    keys = ["contact.area_cm2", "reaction.joint_acceleration_rad_s2"]
    scenario = uncertain().without_uncertainty().with_values({"assumed": keys})
    (note,) = solve_requirement(scenario, "reaction.joint_acceleration_rad_s2").notes
    assert note.startswith("contact.area_cm2 is ASSUMED")
    both = [note for note in solve_requirement(scenario, "motion.speed").notes if "ASSUMED" in note]
    assert [note.split(" are ")[0] for note in both] == [", ".join(keys)]


def test_what_a_curve_varies_is_not_assumed(tmp_path: Path) -> None:
    keys = ["contact.area_cm2", "reaction.joint_acceleration_rad_s2"]
    (tmp_path / "s.toml").write_text(f"assumed = {json.dumps(keys)}\n" + HAND.read_text())
    vary = ("--vary", "motion.speed", "--vary", "reaction.joint_acceleration_rad_s2=4:6:2")
    notes = [line for line in command("require", tmp_path / "s.toml", *vary).out.splitlines() if "ASSUMED" in line]
    assert [note.split(" is ")[0] for note in notes] == ["note: contact.area_cm2"]


def test_doubtful_lengths_of_the_robot_are_said(tmp_path: Path) -> None:
    """A safe speed that rests on a tool of 120 m was as good as any other."""
    robot, urdf = bs.Robot.load("sia5d"), tmp_path / "arm.urdf"
    write_urdf(replace(robot, tip_name="tcp", tip_origin=(0.0, 0.0, 120.0)), urdf)
    scenario = uncertain().without_uncertainty().with_values({"robot": str(urdf)})
    (said,) = solve_requirement(scenario, "motion.speed").notes
    assert "the tip 'tcp' lies 120 m off" in said
    assert run(ParameterStudy.of(scenario, ["motion.speed=20:40:2"])).summary["notes"] == [said]
    cell = bs.load_scenario("examples/programs/cell.toml")
    elbow = replace(bs.Robot.load(cell.robot), tip_name="tcp", tip_origin=(0.0, 0.0, 120.0))
    write_urdf(elbow, urdf)
    (tmp_path / "p.script").write_text("movej([0.12, -1.57, 1.57, -1.57, -1.57, 0], v=0.4)\n")
    found = evaluate_program(tmp_path / "p.script", cell.with_values({"robot": str(urdf)}))
    assert "the tip 'tcp' lies 120 m off" in found.to_json()["notes"][0]


def test_the_command_judges_what_it_found() -> None:
    """At 51 mm/s the forces as given are within the limits, and what is assumed of the area exceeds them."""
    done = command("require", UNCERTAIN, "--vary", "motion.speed", "--json")
    told = json.loads(done.out)
    scenario = uncertain()
    there = scenario.with_values({"motion.velocity_mm_s": [0, 0, -told["value"]]})
    judged = bs.judge_situation(there)
    assert judged.word != "PASS"
    assert told["uncertainty"] == {"word": judged.word, "reason": judged.reason, "confidence": 0.95}
    assert done.status == {"FAIL": 3, "INCONCLUSIVE": 4}[judged.word]
    text = command("require", UNCERTAIN, "--vary", "motion.speed").out
    assert f"with [uncertainty]: {judged.word}" in text


def test_the_command_passes_what_holds_with_the_inputs_at_their_ends() -> None:
    done = command("require", UNCERTAIN, "--vary", "motion.speed=5:20", "--json")
    assert json.loads(done.out)["uncertainty"]["word"] == "PASS"
    assert done.status == 0
    known = command("require", "examples/01_hand_downward.toml", "--vary", "motion.speed=5:20", "--json")
    assert "uncertainty" not in json.loads(known.out)


def test_a_value_that_its_own_distribution_leaves_out_is_not_passed(tmp_path: Path) -> None:
    text = Path("examples/01_hand_downward.toml").read_text(encoding="utf-8")
    speed = bs.load_scenario("examples/01_hand_downward.toml").motion.velocity_mm_s[2]
    form = f'{{ distribution = "normal", mean = {-speed}, sd = 0.5 }}'
    (tmp_path / "cell.toml").write_text(f'{text}\n[uncertainty]\n"motion.speed_mm_s" = {form}\n', encoding="utf-8")
    done = command("require", tmp_path / "cell.toml", "--vary", "motion.speed")
    assert done.status == 4
    assert done.out.startswith("motion.speed: at most")
    assert "with [uncertainty]: INCONCLUSIVE" in done.out
    assert "leaves out the value given" in done.out


def test_a_study_says_so(tmp_path: Path) -> None:
    study = ParameterStudy.of(uncertain(), ["motion.speed=20:40:3"])
    found = run(study)
    assert found.summary["notes"][0].startswith(_SAID)
    assert f"note: {_SAID}" in str(found)
    known = run(ParameterStudy.of(uncertain().without_uncertainty(), ["motion.speed=20:40:3"]))
    assert "notes" not in known.summary
    done = command("study", "parameters", UNCERTAIN, "--vary", "motion.speed=20:40:3", "--out", tmp_path / "out")
    assert f"note: {_SAID}" in " ".join(done.out.split())
    assert "numbers are uncertain" in (tmp_path / "out" / "report.html").read_text()


def test_speed_limits_say_so() -> None:
    path = bs.load_scenario("examples/06_pick_and_place_trajectory.toml").with_values(
        {"uncertainty.reaction.latency_s": {"interval": [0.0, 0.02]}}
    )
    summary = run(TrajectorySpeedLimits(path)).summary
    assert summary["notes"][0].startswith("This is the scenario as given: that one of its numbers is")


def test_a_campaign_says_so(tmp_path: Path) -> None:
    """Of the robot whose scenario it is."""
    file = tmp_path / "arms.toml"
    example = Path("examples/campaign/two_arms.toml").read_text()
    here = Path("examples").resolve()
    one = example.replace("../01_hand_downward.toml", str(here / "07_hand_uncertain.toml"))
    file.write_text(one.replace("../05_ur10e", str(here / "05_ur10e")).replace("poses = 20", "poses = 1"))
    told = command("campaign", "run", file, "--out", tmp_path / "out")
    assert told.status == 0, told.err
    out = " ".join(command("campaign", "merge", tmp_path / "out").out.split())
    assert f"note: sia5d: {_SAID}" in out
    assert "note: ur10e" not in out
    command("campaign", "report", tmp_path / "out")
    assert "numbers are uncertain" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.parametrize("name", ["effectiveness", "workspace"])
def test_other_studies_say_so(name: str) -> None:
    options = {"effectiveness": ["--body", "hand_finger"], "workspace": ["--poses", "3"]}[name]
    done = command("study", name, UNCERTAIN, *options, "--json")
    assert json.loads(done.out)["notes"][0].startswith(_SAID)
