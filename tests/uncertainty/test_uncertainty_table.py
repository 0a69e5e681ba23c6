"""What ``[uncertainty]`` takes, and how it refuses the rest."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

import bumpstop as bs
from bumpstop.cli.collision.output import settings_toml
from bumpstop.collision.scenario.uncertainty_table import uncertain_inputs
from collision.cases import control_group

EXAMPLE = Path(__file__).parents[2] / "examples" / "07_hand_uncertain.toml"
AREA = "contact.area_cm2"

REFUSED: list[tuple[Any, str, str]] = [
    (3, "uncertainty", "3 cannot be used"),
    ({AREA: 2.0}, f'uncertainty."{AREA}"', "2.0 cannot be used"),
    ({"contact.aera_cm2": {"interval": [1, 2]}}, 'uncertainty."contact.aera_cm2"', "did you mean 'contact.area_cm2'"),
    ({"contact.body": {"interval": [1, 2]}}, 'uncertainty."contact.body"', "not a number of a scenario"),
    ({"simulation.step_s": {"interval": [1, 2]}}, 'uncertainty."simulation.step_s"', "not a number of a scenario"),
    ({AREA: {"distribution": "gauss", "mean": 1}}, f'uncertainty."{AREA}".distribution', "'gauss' cannot be used"),
    ({AREA: {"distribution": "normal", "mean": 2}}, f'uncertainty."{AREA}"', "normal has mean; wanted mean with sd"),
    ({AREA: {"distribution": "normal", "mena": 2}}, f'uncertainty."{AREA}".mena', "did you mean 'mean'"),
    ({AREA: {"distribution": "normal", "mean": "2", "sd": 1}}, f'uncertainty."{AREA}".mean', "'2' cannot be used"),
    ({AREA: {"distribution": "normal", "mean": 2, "sd": 0}}, f'uncertainty."{AREA}".sd', "is 0"),
    ({AREA: {"distribution": "uniform", "low": 3, "high": 2}}, f'uncertainty."{AREA}"', "runs from 3 to 2"),
    ({AREA: {"distribution": "uniform", "low": -1, "high": 2}}, f'uncertainty."{AREA}"', "reaches -1"),
    ({AREA: {"interval": [1]}}, f'uncertainty."{AREA}".interval', "wanted 2 numbers"),
    ({AREA: {"interval": [1, float("nan")]}}, f'uncertainty."{AREA}".interval[2]', "cannot be used"),
    ({AREA: {"interval": [1, 2], "assumed": False}}, f'uncertainty."{AREA}".assumed', "is false"),
    ({AREA: {"relative": [0, 2]}}, f'uncertainty."{AREA}".relative', "begins with 0"),
    ({"pose_deg": {"relative": [0.9, 1.1]}}, 'uncertainty."pose_deg"', "name one of its items, as pose_deg[1]"),
    ({"arm.gear_damping": {"relative": [0.9, 1.1]}}, 'uncertainty."arm.gear_damping"', 'arm.model = "rigid"'),
    ({"detector.observer_gain_1_s": {"interval": [9, 99]}}, 'uncertainty."detector.observer_gain_1_s"', "no effect"),
    (
        {"contact.stiffness_N_m": {"relative": [0.9, 1.1]}, "contact.stiffness_N_mm": {"relative": [0.9, 1.1]}},
        'uncertainty."contact.stiffness_N_m"',
        "both given",
    ),
    (
        {"detector.thresholds_Nm": {"relative": [0.9, 1.1]}, "detector.thresholds_Nm[2]": {"relative": [0.9, 1.1]}},
        'uncertainty."detector.thresholds_Nm[2]"',
        "both given",
    ),
    ({AREA: {"interval": [1, 2]}, "contact": {"area_cm2": {"interval": [1, 2]}}}, f'uncertainty."{AREA}"', "twice"),
]


@pytest.mark.parametrize(
    ("table", "field", "said"), REFUSED, ids=[f"{field} {said[:20]}" for _, field, said in REFUSED]
)
def test_it_is_refused(table: Any, field: str, said: str) -> None:
    with pytest.raises(bs.InputError) as refused:
        control_group(uncertainty=table)
    assert refused.value.field == field
    assert said in str(refused.value)


def test_an_area_that_is_not_given_has_no_uncertainty() -> None:
    table = {AREA: {"distribution": "normal", "mean": 2.0, "sd": 0.1}}
    with pytest.raises(bs.InputError, match="an area is known that is not given"):
        control_group(contact__area_cm2=2.0, uncertainty=table).with_values({AREA: None})


def test_who_sets_a_key_in_vain_is_not_told_to_take_it_out() -> None:
    gears = {"uncertainty.arm.gear_damping": {"relative": [0.9, 1.1]}}
    with pytest.raises(bs.InputError, match=r"leave it out, or model"):
        bs.load_scenario(EXAMPLE, gears)
    with pytest.raises(bs.InputError, match=r'leave it out \(set uncertainty\."arm\.gear_damping" to none\)'):
        bs.load_scenario(EXAMPLE, gears | {"arm.model": "elastic"}).with_values({"arm.model": "rigid"})


# These need the robot, the body or a file.
LATER: list[tuple[dict[str, Any], str]] = [
    ({"detector.thresholds_Nm": {"interval": [9, 11]}}, "has 7 values; give relative figures"),
    ({"detector.thresholds_Nm[8]": {"interval": [9, 11]}}, "item 8 is not there"),
    ({AREA: {"interval": [1.5, 3]}}, "leaves out the value given, 1"),
    ({"contact.padding_N_m": {"relative": [0.5, 2]}}, "has no value to be relative to"),
    ({"reaction.latency_s": {"relative": [0.5, 2]}}, "is 0, of which nothing is a share"),
    ({"reaction.latency_s": {"distribution": "normal", "mean": 0.01, "sd": 0.01}}, "15.9 % of this distribution"),
    ({AREA: {"distribution": "samples", "file": "absent.csv"}}, "cannot be read"),
    ({"motion.contact_onset_s": {"interval": [0, 1]}}, "is 'uniform'"),
]


@pytest.mark.parametrize(("table", "said"), LATER, ids=[said[:30] for _, said in LATER])
def test_it_is_refused_where_the_rest_is_known(table: dict[str, Any], said: str) -> None:
    with pytest.raises(bs.InputError) as refused:
        bs.evaluate_uncertain(control_group(contact__area_cm2=1.0, uncertainty=table))
    assert said in str(refused.value)


def test_keys_in_quotes_and_in_tables_are_the_same() -> None:
    table = {"contact": {"area_cm2": {"interval": [1.8, 2.5]}}, "reaction": {"latency_s": {"interval": [0, 0.01]}}}
    flat = {"contact.area_cm2": {"interval": [1.8, 2.5]}, "reaction.latency_s": {"interval": [0, 0.01]}}
    nested = control_group(uncertainty=table)
    assert nested == control_group(uncertainty=flat)
    changed = nested.with_values({"uncertainty.contact.area_cm2": {"interval": [1.9, 2.5]}})
    assert [each.figures for each in uncertain_inputs(changed)] == [(1.9, 2.5), (0.0, 0.01)]


def test_settings_are_the_scenario_again(tmp_path: Path) -> None:
    (tmp_path / "areas.csv").write_text("area\n1.8\n1.9\n2.0\n2.1\n2.2\n", encoding="utf-8")
    scenario = bs.load_scenario(EXAMPLE).with_values({"contact.area_cm2": 2.0})
    data = scenario.to_dict()
    data["uncertainty"]["contact.area_cm2"] = {"distribution": "samples", "file": "areas.csv"}
    scenario = bs.Scenario.from_dict(data, tmp_path)
    result = bs.evaluate_uncertain(scenario, points=64)
    again = bs.Scenario.from_dict(tomllib.loads(settings_toml(result.central, result)), "/")
    assert bs.evaluate_uncertain(again, points=64).to_json() == result.to_json()
    assert scenario.without_uncertainty().uncertainty == {}
