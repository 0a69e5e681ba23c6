"""PASS, FAIL and INCONCLUSIVE: what decides them, and in which order situations stand."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.model import Robot
from bumpstop.model.urdf.writer import write_urdf
from bumpstop.register import RegisterError, SituationResult
from bumpstop.register.inputs import tables_used
from bumpstop.text_files import to_toml
from register.cases import EXAMPLES, write_register


def judged(folder: Path, row: dict[str, Any], *inputs: dict[str, str]) -> SituationResult:
    (result,) = bs.evaluate_register(
        bs.load_register(write_register(folder, {"name": "a", **row}, inputs=inputs))
    ).results
    return result


def test_the_result_is_that_of_each_scenario_alone() -> None:
    register = bs.load_register(EXAMPLES / "sia5d_downward.csv", EXAMPLES / "ur10e_hand_guiding.toml")
    found = bs.evaluate_register(register)
    for one in found.results:
        alone = bs.evaluate(one.situation.scenario)
        assert one.verdict == alone.verdict
        assert (one.outcome == "fail") == (alone.verdict.acceptable is False)
        assert one.peak_force["p99"] == alone.peak_force.quantile(0.99)
        assert one.warnings == alone.warnings
        # The use of the limit is above 1 just where a limit is exceeded more often than accepted.
        over = max(alone.verdict.p_over_force or 0, alone.verdict.p_over_pressure or 0)
        assert (one.use > 1) == (not one.use < math.inf or over > alone.verdict.accepted_probability)
    assert found.to_json() == bs.evaluate_register(register, threads=1).to_json()


def test_worst_first_whatever_the_order_of_the_rows(tmp_path: Path) -> None:
    speeds = np.random.default_rng(3).permutation(np.linspace(10, 100, 12))
    rows = [{"name": f"{speed:.3f}", "speed_mm_s": float(speed)} for speed in speeds]
    found = bs.evaluate_register(bs.load_register(write_register(tmp_path, *rows)))
    names = [float(one.situation.name) for one in found.results]
    assert names == sorted(names, reverse=True), "a faster arm hits harder"
    outcomes = [one.outcome for one in found.results]
    assert outcomes == sorted(outcomes, key=("fail", "inconclusive", "pass").index)
    assert found.outcome == "fail"
    assert sum(found.counts.values()) == 12
    assert {"fail", "pass"} <= set(outcomes)


@pytest.mark.parametrize(
    ("row", "outcome", "reason"),
    [
        ({}, "pass", "within the accepted"),
        ({"contact.area_cm2": 0.5}, "fail", "The pressure exceeds"),
        ({"contact.body": None}, "inconclusive", "No body region is named"),
        (
            {"contact.offset_law": "fixed", "contact.offset_mm": 500.0, "motion.duration_s": 1.0},
            "inconclusive",
            "nothing is hit",
        ),
        ({"contact.limits": "ts15066", "body": "lower_leg", "kind": "clamped"}, "pass", "within the accepted"),
    ],
)
def test_outcome(tmp_path: Path, row: dict[str, Any], outcome: str, reason: str) -> None:
    if "contact.body" in row:
        path = write_register(tmp_path, {"name": "a", "contact.stiffness_N_m": 75000.0})
        cell = tmp_path / "cell.toml"
        cell.write_text(cell.read_text(encoding="utf-8").replace('body = "hand_finger"', ""), encoding="utf-8")
        (found,) = bs.evaluate_register(bs.load_register(path)).results
        assert math.isnan(found.use)
    else:
        found = judged(tmp_path, row)
    assert (found.outcome, reason in found.reason) == (outcome, True), found.reason


def test_an_area_that_nobody_gave_does_not_pass(tmp_path: Path) -> None:
    path = write_register(tmp_path, {"name": "a", "speed_mm_s": 20})
    cell = tmp_path / "cell.toml"
    cell.write_text(cell.read_text(encoding="utf-8").replace("area_cm2 = 2.0", ""), encoding="utf-8")
    (found,) = bs.evaluate_register(bs.load_register(path)).results
    assert found.verdict.acceptable
    assert found.outcome == "inconclusive"
    assert "contact.area_cm2 is not given" in found.reason
    assert [(one.status, one.value) for one in found.inputs if one.key == "contact.area_cm2"] == [("assumed", "1")]


def test_a_region_without_a_pressure_limit_does_not_pass(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(
        'name = "own"\ntitle = "own"\nsource = "us"\nstatus = "agreed"\n'
        '[[region]]\nname = "hand"\nforce_N = 200\ntransient_multiplier = 2\nspring_N_mm = 75\n',
        encoding="utf-8",
    )
    found = judged(tmp_path, {"contact.limits": "own.toml", "body": "hand"})
    assert (found.verdict.acceptable, found.outcome) == (True, "inconclusive")
    assert "own has no pressure limit" in found.reason
    (limit,) = [one for one in found.inputs if one.key.startswith("force limit")]
    assert (limit.kind, limit.status, limit.source) == ("choice", "agreed", "us")


@pytest.mark.parametrize("status", ["assumed", "unverified"])
def test_what_the_register_calls_assumed_does_not_pass(tmp_path: Path, status: str) -> None:
    found = judged(tmp_path, {}, {"key": "detector", "status": status, "source": "a guess"})
    assert found.outcome == "inconclusive"
    assert f"detector ({status})" in found.reason
    of_detector = [one for one in found.inputs if one.key.startswith("detector.")]
    assert {(one.status, one.source) for one in of_detector} == {(status, "a guess")}
    failing = judged(tmp_path, {"contact.area_cm2": 0.5}, {"key": "detector", "status": status})
    assert failing.outcome == "fail", "an assumption makes no failure better"
    assert judged(tmp_path, {}, {"key": "detector", "status": "measured"}).outcome == "pass"


def test_what_the_scenario_calls_assumed_does_not_pass(tmp_path: Path) -> None:
    path = write_register(tmp_path, {"name": "a"})
    cell = tmp_path / "cell.toml"
    cell.write_text('assumed = ["reaction.joint_acceleration_rad_s2"]\n' + cell.read_text(encoding="utf-8"))
    (found,) = bs.evaluate_register(bs.load_register(path)).results
    assert (found.outcome, found.verdict.acceptable) == ("inconclusive", True)
    assert found.reason.endswith("nobody has shown: reaction.joint_acceleration_rad_s2 (assumed).")
    told = {one.key: (one.status, one.source) for one in found.inputs}
    assert told["reaction.joint_acceleration_rad_s2"] == ("assumed", f"by {cell}")
    assert "assumed" not in told
    # Whoever knows it says so in the register, or sets it.
    stated = path.read_text(encoding="utf-8") + '[[input]]\nkey = "reaction"\nstatus = "measured"\nsource = "logs"\n'
    path.write_text(stated, encoding="utf-8")
    assert bs.evaluate_register(bs.load_register(path)).results[0].outcome == "pass"
    set_ = {"reaction.joint_acceleration_rad_s2": 4.5}
    (known,) = bs.evaluate_register(bs.load_register(path, changes=set_)).results
    assert (known.outcome, known.situation.scenario.assumed) == ("pass", [])


def test_a_value_that_is_set_has_no_source_in_the_register(tmp_path: Path) -> None:
    stated = {"key": "detector", "status": "measured", "source": "our logs"}, {"key": "reaction", "status": "assumed"}
    path = write_register(tmp_path, {"name": "a", "contact.area_cm2": 2.0}, inputs=stated)
    changes = {
        "detector.noise_sd_Nm": 1.0,
        "contact.area_cm2": 3.0,
        "reaction.latency_s": 0.01,
        "motion.speed_mm_s": 20,
    }
    (found,) = bs.evaluate_register(bs.load_register(path, changes=changes)).results
    told = {one.key: (one.status, one.source) for one in found.inputs}
    of_set = ("given", "set when the register was read (--set)")
    assert told["detector.noise_sd_Nm"] == told["contact.area_cm2"] == told["motion.velocity_mm_s"] == of_set
    assert told["detector.thresholds_Nm"] == ("measured", "our logs")
    assert told["reaction.latency_s"] == ("assumed", ""), "a guess is not made better by another one"
    assert found.outcome != "pass"


def test_an_uncertain_input_has_its_source(tmp_path: Path) -> None:
    row = {"name": "a", "uncertainty": {"contact.stiffness_N_m": {"distribution": "lognormal", "sigma": 0.1}}}
    path = write_register(tmp_path, row)
    interval = {"uncertainty.contact.area_cm2": {"interval": [1.8, 2.2]}}
    (found,) = bs.evaluate_register(bs.load_register(path, changes=interval)).results
    told = {one.key: one.source for one in found.inputs}
    assert told["uncertainty.contact.stiffness_N_m.sigma"] == f"{path} [[situation]] 1"
    assert told["uncertainty.contact.area_cm2.interval"] == "set when the register was read (--set)"


def test_an_uncertain_item_of_a_scenario_has_its_source(tmp_path: Path) -> None:
    path = write_register(tmp_path, {"name": "a"})
    cell = tmp_path / "cell.toml"
    cell.write_text(f'{cell.read_text()}\n[uncertainty]\n"pose_deg[2]" = {{ interval = [29, 31] }}\n', encoding="utf-8")
    (found,) = bs.evaluate_register(bs.load_register(path)).results
    told = {one.key: (one.status, one.source) for one in found.inputs}
    assert told["uncertainty.pose_deg[2].interval"] == ("given", str(cell))


def test_tables_of_one_name_are_told_apart(tmp_path: Path) -> None:
    hand = {"name": "hand", "force_N": 120, "transient_multiplier": 2, "spring_N_mm": 75}
    table = {"name": "own", "title": "Own", "source": "us", "status": "agreed", "region": [hand]}
    for file, force in (("a.toml", 120), ("b.toml", 90), ("c.toml", 90)):
        (tmp_path / file).write_text(to_toml(table | {"region": [hand | {"force_N": force}]}), encoding="utf-8")
    rows = [{"name": file, "contact.limits": file, "body": "hand"} for file in ("a.toml", "b.toml", "c.toml")]
    situations = bs.load_register(write_register(tmp_path, *rows)).situations
    found = {one.name: one.regions[0].force_N for one in tables_used(list(situations))}
    assert found == {"own (a.toml)": 120, "own (b.toml)": 90}


def test_a_value_has_its_source_in_either_spelling(tmp_path: Path) -> None:
    measured, known = {"status": "measured", "source": "gauge"}, ("measured", "gauge")
    row = {"name": "a", "contact.area_cm2": 2.0, "contact.stiffness_N_mm": 40.0}
    path = write_register(tmp_path, row)

    def told(changes: dict[str, Any] | None = None, *keys: str) -> dict[str, tuple[str, str]]:
        inputs = tuple({"key": key, **measured} for key in keys)
        write_register(tmp_path, row, inputs=inputs)
        (found,) = bs.evaluate_register(bs.load_register(path, changes=changes)).results
        return {one.key: (one.status, one.source) for one in found.inputs}

    assert told()["contact.stiffness_N_m"] == ("given", f"{path} [[situation]] 1")
    for key in ("contact.stiffness_N_m", "contact.stiffness_N_mm"):
        assert told(None, key)["contact.stiffness_N_m"] == known
        for changed in ({"contact.stiffness_N_m": 2e4}, {"contact.stiffness_N_mm": 20.0}):
            of_set = ("given", "set when the register was read (--set)")
            assert told(changed, key)["contact.stiffness_N_m"] == of_set, "measured was another value"
    assert told(None, "motion.speed_mm_s", "motion.direction")["motion.velocity_mm_s"] == known
    assert told(None, "motion.speed_mm_s")["motion.velocity_mm_s"][0] == "given", "of its direction nothing is known"
    cell = tmp_path / "cell.toml"
    cell.write_text(cell.read_text(encoding="utf-8").replace("[contact]", "[contact]\nstiffness_N_mm = 30.0", 1))
    (alone,) = bs.evaluate_register(bs.load_register(cell)).results
    assert [one.source for one in alone.inputs if one.key == "contact.stiffness_N_m"] == [str(cell)]


def test_a_key_s_own_statement_counts_before_that_of_its_table(tmp_path: Path) -> None:
    table, key = {"key": "detector", "status": "measured"}, {"key": "detector.noise_sd_Nm", "status": "published"}
    found = judged(tmp_path, {}, table, key)
    status = {one.key: one.status for one in found.inputs}
    assert (status["detector.noise_sd_Nm"], status["detector.thresholds_Nm"]) == ("published", "measured")


def test_the_other_arm_decides_where_it_is_known(tmp_path: Path) -> None:
    """An elastic arm of an assumed drive train passes; the rigid one in its place does not at a higher speed."""
    base = {"scenario": str(EXAMPLES / "ur10e_table.toml"), "arm.model": "elastic"}
    slow = judged(tmp_path, {**base, "speed_mm_s": 60.0})
    fast = judged(tmp_path, {**base, "speed_mm_s": 150.0})
    assert slow.verdict.acceptable
    assert fast.verdict.acceptable
    assert not bs.evaluate(fast.situation.scenario.with_values({"arm.model": "rigid"})).verdict.acceptable
    assert (slow.outcome, fast.outcome) == ("pass", "inconclusive")
    assert fast.reason.startswith("The rigid arm in the place of the elastic one exceeds the limits")


def test_coarse_steps_that_decide_do_not_pass(tmp_path: Path) -> None:
    coarse = {"simulation.step_s": 0.02, "simulation.substeps": 1, "detector.feedback_period_s": 0.02}
    for speed in np.linspace(30, 75, 10):
        found = judged(tmp_path, {**coarse, "speed_mm_s": float(speed)})
        if any("the verdict is NOT ACCEPTABLE" in warning for warning in found.warnings):
            assert found.outcome == "inconclusive"
            assert "Finer simulation steps exceed the limits" in found.reason
            return
    pytest.fail("no speed at which finer steps turn the verdict")


def test_a_place_farther_on_that_is_hit_harder_does_not_pass(tmp_path: Path) -> None:
    """The elastic arm of the median place passes; where it bends its elbow more, the hand is hit 6 % harder."""
    row = {"arm.model": "elastic", "contact.offset_sd_s": 1.0, "contact.area_cm2": 0.67}
    found = judged(tmp_path, row)
    assert found.verdict.acceptable
    assert found.outcome == "inconclusive"
    assert found.reason.startswith("Elsewhere on the line the elastic arm exceeds the limits")
    near = judged(tmp_path, row | {"contact.offset_sd_s": 0.1})
    assert near.verdict.acceptable
    assert "Elsewhere" not in near.reason


def test_a_payload_above_the_rated_one_is_a_deviation(tmp_path: Path) -> None:
    assert judged(tmp_path, {"payload_kg": 5.0}).warnings == ()
    (warning,) = judged(tmp_path, {"payload_kg": 6.0}).warnings
    assert "above the 5 kg" in warning


def test_two_phases_have_a_use_of_the_limit(tmp_path: Path) -> None:
    """Above 1 just where a limit is exceeded too often, and sorted by it."""
    two = {"verdict.clamped_limit": "two_phase", "contact.limits": "ts15066"}
    rows = [{"name": str(speed), "speed_mm_s": speed, **two} for speed in (20, 40, 60, 90, 140, 220, 400)]
    found = bs.evaluate_register(bs.load_register(write_register(tmp_path, *rows))).results
    assert all(one.verdict.transient is not None for one in found)
    assert [one.situation.name for one in found] == [str(row["speed_mm_s"]) for row in reversed(rows)]
    for one in found:
        assert one.use > 0
        assert (one.use > 1) == (one.p_over > one.verdict.accepted_probability)
    assert {one.use > 1 for one in found} == {True, False}
    # No power of ten among percents.
    assert found[0].use > 10
    assert found[0].use_text == f"{100 * found[0].use:.0f} %"
    never = {"name": "never", "body": "face", "speed_mm_s": 20, **two}
    (one,) = bs.evaluate_register(bs.load_register(write_register(tmp_path, never))).results
    assert (one.outcome, one.use, one.use_text) == ("fail", math.inf, "no contact permitted")


def test_too_few_sampled_collisions_do_not_pass(tmp_path: Path) -> None:
    """0.1 % is accepted: of 9000 collisions that is 9, which 10 000 are enough for."""
    path = write_register(tmp_path, {"name": "slow", "speed_mm_s": 20}, {"name": "fast", "speed_mm_s": 500})
    register = bs.load_register(path)
    for samples in (1, 9000):
        fast, slow = bs.evaluate_register(register, samples=samples).results
        assert (fast.outcome, slow.outcome) == ("fail", "inconclusive")
        assert slow.reason.startswith(f"{samples} sampled collisions are too few to judge by")
        assert slow.reason in slow.warnings
        assert slow.to_json()["verdict"]["warnings"] == list(slow.warnings)
    _, slow = bs.evaluate_register(register, samples=10_000).results
    assert (slow.outcome, slow.warnings) == ("pass", ())


def test_an_arm_in_millimetres_does_not_pass(tmp_path: Path) -> None:
    scenario = bs.load_scenario(EXAMPLES.parent / "02_lower_arm_downward.toml")
    robot = Robot.load("sia5d")
    urdf = tmp_path / "arm.urdf"
    write_urdf(replace(robot, tip_name="tcp", tip_origin=(0.0, 0.0, 120.0)), urdf)
    text = to_toml(scenario.with_values({"robot": str(urdf), "motion.velocity_mm_s": [0, 0, -20]}).as_given())
    (tmp_path / "mm.toml").write_text(text, encoding="utf-8")
    (found,) = bs.evaluate_register(bs.load_register(tmp_path / "mm.toml")).results
    assert found.verdict.acceptable
    assert found.outcome == "inconclusive"
    assert "do not look like metres" in found.reason
    assert found.reason in found.warnings


def test_a_payload_that_nothing_is_known_to_compare_with_is_told(tmp_path: Path) -> None:
    write_urdf(Robot.load("sia5d"), tmp_path / "arm.urdf")
    rows = [{"name": "a", "payload_kg": 20}, {"name": "b"}, {"name": "c", "payload_kg": 0}]
    path = write_register(tmp_path, *rows)
    told = "No rated payload of this robot is known: the payload of 20 kg is not compared with it."
    built_in = bs.evaluate_register(bs.load_register(path)).results
    assert any("20 kg is above the 5 kg" in text for one in built_in for text in one.warnings)
    assert not any(told in one.notes for one in built_in)
    urdf = {"robot": str(tmp_path / "arm.urdf")}
    found = bs.evaluate_register(bs.load_register(path, changes=urdf)).results
    assert {one.situation.name for one in found if told in one.notes} == {"a"}
    assert not any("No rated payload" in note for one in found if one.situation.name != "a" for note in one.notes)
    nothing = "The payload of 20 kg changes no figure: it would choose rows of a stopping table, and there is none."
    assert {one.situation.name for one in built_in if nothing in one.notes} == {"a"}
    assert all("changes no figure" not in note for one in built_in if one.situation.name == "c" for note in one.notes)


def test_a_situation_that_cannot_be_computed_is_named_with_all_others(tmp_path: Path) -> None:
    residuals = {"detector.residuals": "absent.parquet", "detector.noise_sd_Nm": None}
    path = write_register(tmp_path, *({"name": name, **{k: v for k, v in residuals.items() if v}} for name in "ab"))
    with pytest.raises(bs.InputError) as refused:
        bs.load_register(path)
    assert str(refused.value).count("absent.parquet") == 2


def test_faults_of_uncertain_inputs_are_told_with_those_of_the_rows(tmp_path: Path) -> None:
    interval = {"contact.area_cm2": {"interval": [1.8, 2.5]}}
    rows = ({"name": name, "contact.area_cm2": area} for name, area in (("good", 2.0), ("one", 4.0), ("two", 1.0)))
    path = write_register(tmp_path, *(row | {"uncertainty": interval} for row in rows))
    with pytest.raises(RegisterError) as refused:
        bs.load_register(path)
    told = [str(fault) for fault in refused.value.faults]
    assert len(told) == 2
    assert all(name in text and "contact.area_cm2" in text for name, text in zip(("one", "two"), told, strict=True))


def test_uncertain_inputs_are_judged_at_the_stated_confidence(tmp_path: Path) -> None:
    """One situation, whose stiffness is known or only to within a factor."""
    known = {"name": "known", "motion.velocity_mm_s": [0, 0, -50]}
    spread = known | {
        "name": "spread",
        "uncertainty": {"contact.stiffness_N_m": {"distribution": "lognormal", "median": 75000.0, "sigma": 0.6}},
    }
    result = bs.evaluate_register(bs.load_register(write_register(tmp_path, known, spread)))
    found = {one.situation.name: one for one in result.results}
    assert (found["known"].outcome, found["known"].confidence) == ("pass", None)
    judged = bs.judge_situation(found["spread"].situation.scenario)
    assert judged.word != "PASS"
    assert found["spread"].outcome == judged.word.lower()
    assert found["spread"].reason == judged.reason
    assert found["spread"].confidence == judged.confidence == 0.95
    assert found["spread"].peak_force == found["known"].peak_force
    told = found["spread"].to_json()["verdict"]
    assert found["spread"].verdict.acceptable, "the scenario as given"
    assert (told["acceptable"], told["conclusion"]) == {"FAIL": (False, "not_acceptable")}.get(
        judged.word, (None, "inconclusive")
    )
    assert told["reason"] == judged.reason


def test_uncertain_inputs_are_sampled_as_the_others(tmp_path: Path) -> None:
    spread = {"contact.stiffness_N_m": {"distribution": "lognormal", "sigma": 0.1}}
    register = bs.load_register(write_register(tmp_path, {"name": "a", "uncertainty": spread}))
    (found,) = bs.evaluate_register(register, samples=20_000, seed=3).results
    alone = bs.evaluate_uncertain(found.situation.scenario, samples=20_000, seed=3)
    assert found.judgement is not None
    assert found.judgement.conclusion == alone.conclusion
    assert found.judgement.p_over == alone.case("central").p_over == 0, "no run of so few is above a limit"
    assert "(less than 0.015 % (none of 20000 runs) in the central case)" in found.reason
