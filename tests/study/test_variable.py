"""Variables: what a name means in a scenario, and ranges that cannot be used."""

from __future__ import annotations

import math
import re
from decimal import Decimal
from itertools import takewhile
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

import bumpstop as bs
from bumpstop.study.range import Range
from bumpstop.study.variable import ALIASES, Variable, names, per
from collision.cases import control_group

# Words that the names of keys end with.
UNITS = {"1", "N", "Ns", "Nm", "kg", "m", "m2", "mm", "cm2", "rad", "deg", "s", "s2", "hz", "percent"}


@pytest.mark.parametrize(
    ("name", "control", "unit", "value"),
    [
        ("motion.speed", 50, "mm/s", 80),
        ("detector.thresholds", 10, "Nm", 4),
        ("detector.thresholds_and_noise", 10, "Nm", 4),
        ("contact.stiffness", 75000, "N/m", 5600),
        ("contact.area_cm2", 1, "cm2", 2.5),
        ("detector.feedback_period_s", 0.004, "s", 0.007),
        ("detector.noise_sd_Nm[3]", 20 / 5.5, "Nm", 1),
        ("pose_deg[2]", 30, "deg", 31),
        ("reaction.joint_acceleration_rad_s2", 4.5, "rad/s2", 9),
        ("motion.velocity_mm_s[1]", 0, "mm/s", 7),
        ("verdict.accepted_probability", 1e-3, "", 1e-4),
        ("simulation.substeps", 5, "", 3),
    ],
)
def test_a_value_that_is_set_is_the_value_that_is_there(name: str, control: float, unit: str, value: float) -> None:
    scenario, variable = control_group(), Variable(name)
    assert variable.value(scenario) == pytest.approx(control)
    assert variable.unit(scenario) == unit
    changed = variable.apply(scenario, value)
    assert variable.value(changed) == pytest.approx(value, rel=1e-12)
    back = variable.apply(changed, control)
    if name == "motion.speed":  # a slower arm gets longer, a faster one no less time
        assert changed.motion.duration_s == scenario.motion.duration_s
        assert back.motion.duration_s == pytest.approx(scenario.motion.duration_s * value / control)
        back = back.with_values({"motion.duration_s": scenario.motion.duration_s})
    assert back.motion == scenario.motion


def test_every_key_has_the_unit_that_its_name_ends_with() -> None:
    scenario, told = control_group(), {"hz": "Hz", "percent": "%"}
    tables = [(f"{name}.", type(table)) for name, table in scenario if isinstance(table, BaseModel)]
    keys = [prefix + key for prefix, table in [*tables, ("", type(scenario))] for key in table.model_fields]
    found = {}
    for key in keys:
        words = key.rpartition(".")[2].split("_")
        units = list(takewhile(lambda word: word in UNITS, reversed(words[1:])))[::-1]
        if units:
            found[key] = "".join(told.get(unit, unit) for unit in units)
            assert re.sub("[ /]", "", Variable(key).unit(scenario)) == found[key], key
    assert {"contact.damping_Ns_m", "arm.gear_stiffness_Nm_rad", "arm.rotor_inertia_kg_m2"} < set(found)


SLIDE = """<robot name="scara"><link name="base"/><link name="arm"/><link name="quill"/><link name="flange"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="2" effort="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="arm"/><child link="quill"/><origin xyz="0.4 0 0.3"/>
    <axis xyz="0 0 1"/><limit lower="-0.2" upper="0.2" velocity="1" effort="1"/></joint>
  <joint name="reach" type="prismatic"><parent link="quill"/><child link="flange"/><axis xyz="1 0 0"/>
    <limit lower="-0.2" upper="0.2" velocity="1" effort="1"/></joint></robot>"""


@pytest.mark.parametrize(
    ("name", "changes", "unit"),
    [
        ("detector.thresholds", {}, "Nm"),
        ("detector.thresholds", {"detector.thresholds_Nm": [20, 10, 12]}, "N"),
        ("detector.thresholds", {"detector.thresholds_Nm": [10, 10, 12]}, "Nm (N)"),
        ("detector.thresholds_and_noise", {"detector.thresholds_Nm": [20, 10, 12]}, "N"),
        ("detector.thresholds_Nm[1]", {}, "Nm"),
        ("detector.thresholds_Nm[3]", {}, "N"),
        ("detector.noise_sd_Nm", {}, "Nm (N)"),
        ("reaction.joint_acceleration_rad_s2", {}, "rad/s2 (m/s2)"),
        ("reaction.joint_acceleration_rad_s2", {"reaction.joint_acceleration_rad_s2": [9, 3, 3]}, "m/s2"),
        ("reaction.joint_acceleration_rad_s2[1]", {"reaction.joint_acceleration_rad_s2": [9, 3, 3]}, "rad/s2"),
        ("pose_deg[1]", {}, "deg"),
        ("pose_deg[2]", {}, "m"),
        ("contact.padding", {}, "N/m"),
    ],
)
def test_what_belongs_to_a_joint_that_slides_has_its_unit(
    name: str, changes: dict[str, Any], unit: str, tmp_path: Path
) -> None:
    (tmp_path / "scara.urdf").write_text(SLIDE)
    scenario = bs.Scenario.from_dict(
        {
            "robot": "scara.urdf",
            "pose_deg": [10, 0.1, 0.05],
            "motion": {"velocity_mm_s": [0, 0, -40], "task": "position"},
            "contact": {"stiffness_N_m": 50000},
            "detector": {"thresholds_Nm": [5, 10, 12], "noise_sd_Nm": 1.0},
            "reaction": {"joint_acceleration_rad_s2": 4.5},
        },
        tmp_path,
    ).with_values(changes)
    assert Variable(name).unit(scenario) == unit
    assert Variable(name).label(scenario).endswith(f"[{unit}]")


def test_a_derivative_by_two_units_is_over_both() -> None:
    assert [per("N", unit) for unit in ("Nm", "Nm (N)", "mm/s", "")] == ["N/Nm", "N/(Nm (N))", "N/(mm/s)", "N"]


def test_thresholds_change_in_proportion_with_noise_or_without() -> None:
    scenario = control_group(detector__thresholds_Nm=[20.0, 10.0, 20.0, 20.0, 20.0, 20.0, math.inf])
    alone = Variable("detector.thresholds").apply(scenario, 5.0).detector
    assert alone.thresholds_Nm == [10.0, 5.0, 10.0, 10.0, 10.0, 10.0, math.inf]
    assert alone.noise_sd_Nm == scenario.detector.noise_sd_Nm
    both = Variable("detector.thresholds_and_noise").apply(scenario, 5.0).detector
    assert both.noise_sd_Nm == pytest.approx([t / 5.5 for t in (10, 5, 10, 10, 10, 10, 10)])


@pytest.mark.parametrize("latency", ["0", "0.003", "0.035", "0.0352", "0.1101"])
def test_latency_is_rounded_up_to_whole_steps_as_the_law_does(latency: str) -> None:
    scenario = control_group(reaction__latency_s=float(latency))
    steps = math.ceil(Decimal(latency) / Decimal("0.001"))
    assert bs.CollisionProblem.from_scenario(scenario).latency_steps == steps
    assert Variable("reaction.latency_s").value(scenario) == pytest.approx(1e-3 * steps, abs=1e-12)


def test_a_list_with_a_value_for_each_joint_changes_in_proportion() -> None:
    scenario = control_group(reaction__joint_acceleration_rad_s2=[4.0, 2.0, 4.0, 4.0, 8.0, 4.0, 4.0])
    variable = Variable("reaction.joint_acceleration_rad_s2")
    assert variable.value(scenario) == 2.0
    changed = variable.apply(scenario, 3.0).reaction.joint_acceleration_rad_s2
    assert changed == pytest.approx([6.0, 3.0, 6.0, 6.0, 12.0, 6.0, 6.0])


def test_a_body_without_padding_is_padded_infinitely_hard() -> None:
    scenario, variable = control_group(), Variable("contact.padding")
    assert variable.value(scenario) == math.inf
    assert variable.apply(scenario, math.inf).contact == scenario.contact
    assert Range.parse("contact.padding=1e3:1e5:3", scenario).high == 1e5


def test_speed_keeps_the_direction() -> None:
    scenario = control_group(motion__velocity_mm_s=[30.0, 0.0, -40.0])
    assert Variable("motion.speed").apply(scenario, 10.0).motion.velocity_mm_s == pytest.approx([6.0, 0.0, -8.0])


def test_quantised_values_are_rounded_and_named_once() -> None:
    found = Range.parse("detector.feedback_period_s=0.001:0.0044:100", control_group())
    assert found.values == (0.001, 0.002, 0.003, 0.004)
    assert Range.parse("reaction.latency_s=0:0.004:9", control_group()).values == (0.0, 0.001, 0.002, 0.003, 0.004)


def test_ranges_are_spaced_as_written() -> None:
    scenario = control_group()
    assert Range.parse("motion.speed=10:30:3", scenario).values == (10, 20, 30)
    assert Range.parse("motion.speed=10:90:3:log", scenario).values == pytest.approx((10, 30, 90))
    assert Range.parse("motion.speed=[30, 10, 30]", scenario).values == (10, 30)
    found = Range.parse("contact.area_cm2=0.1:7.3:4", scenario)
    assert Range.parse(found.to_json(), scenario).values == pytest.approx(found.values, rel=1e-11)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("motion.speed", "KEY=LOW:HIGH"),
        ("motion.speed=5", "KEY=LOW:HIGH"),
        ("motion.speed=5:1", "empty range"),
        ("motion.speed=5:5", "empty range"),
        ("motion.speed=nan:5", "not finite"),
        ("motion.speed=1:inf", "not finite"),
        ("motion.speed=a:b", "is no number"),
        ("motion.speed=0:10", "above 0"),
        ("motion.speed=-5:20", "above 0"),
        ("motion.speed=-10:10:2:log", "even ratios"),
        ("motion.speed=1:2:1", "no count"),
        ("motion.speed=1:2:2.5", "no count"),
        ("motion.speed=[1, 2", "bracket"),
        ("motion.speed=[1]", "at least 2"),
        ("motion.sped=1:2", "did you mean 'motion.speed'"),
        ("motion.velocity_mm_s=1:2", "motion.speed"),
        ("contact.limits=1:2", "no number"),
        ("contact.padding_N_m=1:2", "has no value"),
        ("detector.thresholds_Nm[8]=1:2", "7 items"),
        *((f"detector.thresholds_Nm{item}=1:2", "names no item") for item in ("[-1]", "[99999]", "[2][1]", "[]", "[2")),
        ("contact.area_cm2[x]=1:2", "names no item"),
        ("detector.feedback_period_s=0.001:0.0014", "steps of 0.001"),
        ("contact.area_cm2=-1:2", "contact.area_cm2"),
        ("contact=1:2", "is a table"),
        ("a.b.c=1:2", "no numeric key"),
        ("detector.noise_mean_Nm[1]=1:2", "is no list"),
    ],
)
def test_a_senseless_range_is_refused_by_name(text: str, problem: str) -> None:
    with pytest.raises(bs.InputError) as refused:
        Range.parse(text, control_group())
    assert problem in str(refused.value)


def test_every_name_is_known() -> None:
    found = names()
    assert set(ALIASES) < set(found)
    assert "detector.thresholds_Nm" in found
    assert "contact.body" not in found
