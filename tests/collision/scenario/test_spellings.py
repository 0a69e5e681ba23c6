"""Keys that say one thing in two spellings."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

import bumpstop as bs
from bumpstop.collision.scenario.settings_file import scenario_data
from bumpstop.errors import InputError
from bumpstop.study import Variable
from bumpstop.study.requirement.requirement import solve_requirement
from bumpstop.text_files import to_toml
from collision.scenario_cases import EXAMPLE, example

BOTH: list[tuple[dict[str, Any], tuple[str, str]]] = [
    (
        {"contact": {"stiffness_N_m": 75000.0, "stiffness_N_mm": 75.0}},
        ("contact.stiffness_N_m:", "contact.stiffness_N_mm"),
    ),
    ({"motion": {"speed_mm_s": 50.0}}, ("motion.velocity_mm_s", "motion.speed_mm_s")),
    ({"motion": {"direction": [0, 0, -1]}}, ("motion.velocity_mm_s", "motion.direction")),
    ({"pose_rad": [0.0] * 7}, ("pose_deg", "pose_rad")),
]


def with_tables(**tables: Any) -> dict[str, Any]:
    data = example()
    for name, value in tables.items():
        data[name] = data.get(name, {}) | value if isinstance(value, dict) else value
    return data


@pytest.mark.parametrize(("tables", "names"), BOTH)
def test_both_at_once_are_refused_by_both_names(tables: dict[str, Any], names: tuple[str, str]) -> None:
    with pytest.raises(InputError) as caught:
        bs.Scenario.from_dict(with_tables(**tables))
    for name in names:
        assert name in str(caught.value)


def test_both_set_at_once_are_refused() -> None:
    scenario = bs.load_scenario(EXAMPLE)
    for changes in (
        {"contact.stiffness_N_m": 75000.0, "contact.stiffness_N_mm": 75.0},
        {"motion.velocity_mm_s": [0, 0, -1], "motion.speed_mm_s": 3.0},
        {"pose_deg": [0] * 7, "pose_rad": [0] * 7},
    ):
        with pytest.raises(InputError, match="are both given"):
            scenario.with_values(changes)
        with pytest.raises(InputError, match="are both given"):
            bs.load_scenario(EXAMPLE, changes)


def test_newtons_a_millimetre() -> None:
    scenario = bs.load_scenario(EXAMPLE, {"contact.stiffness_N_mm": 60.0})
    assert scenario.contact.stiffness_N_m == 60000.0
    assert bs.CollisionProblem.from_scenario(scenario).stiffness == 60000.0
    # Set after each other the later one counts, whatever was there before.
    assert scenario.with_values({"contact.stiffness_N_m": 5000.0}).contact.stiffness_N_m == 5000.0
    assert scenario.with_values({"contact.area_cm2": 3.0}).contact.stiffness_N_mm == 60.0


def test_speed_and_direction() -> None:
    data = example()
    data["motion"] = {"speed_mm_s": 50, "direction": [0, 0, -2], "held_joints": [7]}
    assert bs.Scenario.from_dict(data).motion.velocity_mm_s == [0.0, 0.0, -50.0]
    for missing, given in (("direction", {"speed_mm_s": 50}), ("speed_mm_s", {"direction": [0, 0, -1]})):
        data["motion"] = given
        with pytest.raises(InputError, match=f"motion.{missing}: is missing"):
            bs.Scenario.from_dict(data)
    data["motion"] = {"speed_mm_s": 50, "direction": [0, 0, 0]}
    with pytest.raises(InputError, match=r"motion.direction: \[0.*\] is no direction"):
        bs.Scenario.from_dict(data)


def test_a_speed_set_keeps_the_direction_and_a_direction_the_speed() -> None:
    scenario = bs.load_scenario(EXAMPLE)
    assert scenario.motion.velocity_mm_s == [0, 0, -50]
    assert scenario.with_values({"motion.speed_mm_s": 20}).motion.velocity_mm_s == [0.0, 0.0, -20.0]
    assert scenario.with_values({"motion.direction": [3, 0, 4]}).motion.velocity_mm_s == pytest.approx([30, 0, 40])
    both = scenario.with_values({"motion.speed_mm_s": 20, "motion.direction": [3, 0, 4]})
    assert both.motion.velocity_mm_s == pytest.approx([12, 0, 16])
    assert both.with_values({"motion.velocity_mm_s": [1, 0, 0]}).motion.velocity_mm_s == [1, 0, 0]


def test_settings_hold_one_of_them_and_give_the_same_scenario() -> None:
    changes = {"motion.speed_mm_s": 33.3, "motion.direction": [1, 2, -3], "contact.stiffness_N_mm": 71.3}
    scenario = bs.load_scenario(EXAMPLE, changes)
    again = bs.Scenario.from_dict(tomllib.loads(to_toml(scenario_data(scenario))))
    assert again.motion.velocity_mm_s == scenario.motion.velocity_mm_s
    assert again.contact.stiffness_N_m == scenario.contact.stiffness_N_m
    assert "speed_mm_s" not in scenario.to_dict()["motion"]


def test_copies_that_studies_make_count() -> None:
    scenario = bs.load_scenario(EXAMPLE, {"motion.speed_mm_s": 20, "contact.stiffness_N_mm": 60.0})
    motion = scenario.motion.model_copy(update={"velocity_mm_s": [0, 0, -7.0]})
    contact = scenario.contact.model_copy(update={"stiffness_N_m": 4000.0})
    copy = scenario.model_copy(update={"motion": motion, "contact": contact})
    changed = copy.with_values({"contact.area_cm2": 3.0})
    assert changed.motion.velocity_mm_s == [0, 0, -7.0]
    assert changed.contact.stiffness_N_m == 4000.0


def test_both_spellings_can_be_varied() -> None:
    scenario = bs.load_scenario(EXAMPLE)
    assert Variable("motion.speed_mm_s").apply(scenario, 80).motion.velocity_mm_s == [0, 0, -80]
    stiffness = Variable("contact.stiffness_N_mm")
    assert stiffness.value(scenario) == pytest.approx(75.0)
    assert stiffness.unit(scenario) == "N/mm"
    assert stiffness.apply(scenario, 50.0).contact.stiffness_N_m == 50000.0
    with pytest.raises(InputError, match="is a direction"):
        Variable("motion.direction").value(scenario.with_values({"motion.speed_mm_s": 20}))
    assert solve_requirement(scenario, "motion.speed_mm_s").value == solve_requirement(scenario, "motion.speed").value


def test_with_a_trajectory_they_have_no_meaning() -> None:
    path = Path(__file__).parents[3] / "examples" / "06_pick_and_place_trajectory.toml"
    with pytest.raises(InputError, match=r"motion.speed_mm_s: has no meaning"):
        bs.load_scenario(path, {"motion.speed_mm_s": 20.0})
