"""Keys of rows: however they are written, and faults told under where they were written."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import bumpstop as bs
from bumpstop.text_files import to_toml
from register.cases import REPOSITORY, write_register
from register.test_register_files import faults_of


@pytest.mark.parametrize("others", [(), ({"name": "good"},)])
@pytest.mark.parametrize("of_row", [True, False])
def test_an_uncertain_input_is_refused_where_it_was_written(
    tmp_path: Path, others: tuple[dict[str, str], ...], of_row: bool
) -> None:
    key, wrong = "pose_deg[2]", {"interval": [25, 29]}
    path = write_register(tmp_path, {"name": "a"} | ({"uncertainty": {key: wrong}} if of_row else {}), *others)
    (told,) = faults_of(path, **({} if of_row else {f"uncertainty.{key}": wrong}))
    where = f"{path} [[situation]] 1 ('a'), " if of_row else ""
    assert told.startswith(f'{where}uncertainty."{key}": 25 to 29 leaves out the value given, 30')


def test_a_fault_of_a_table_that_was_set_is_not_one_of_the_scenario(tmp_path: Path) -> None:
    path = write_register(tmp_path, {"name": "a"})
    (told,) = faults_of(path, contact={"body": "hand_finger", "area_cm2": -3})
    assert told.startswith("contact.area_cm2: -3 cannot be used")


def test_a_key_in_quotes_is_as_good_as_one_without(tmp_path: Path) -> None:
    known = {"interval": [29, 31]}
    rows = ({"name": "a", "uncertainty": {"pose_deg[2]": known}}, {"name": "b", "uncertainty.pose_deg[2]": known})
    one, other = bs.load_register(write_register(tmp_path, *rows)).situations
    assert one.scenario == other.scenario
    assert one.given == other.given


def test_a_key_in_quotes_and_without_is_refused(tmp_path: Path) -> None:
    path = write_register(tmp_path, {"name": "a", "contact": {"area_cm2": 0.5}, "contact.area_cm2": 9})
    assert faults_of(path) == [f"{path} [[situation]] 1, contact.area_cm2: is given twice; give it once"]


@pytest.mark.parametrize(
    "columns", [("uncertainty", "uncertainty.contact.area_cm2"), ("uncertainty.contact.area_cm2", "uncertainty")]
)
def test_a_table_takes_nothing_from_its_keys_in_any_column(tmp_path: Path, columns: tuple[str, str]) -> None:
    cells = {"uncertainty": "{}", "uncertainty.contact.area_cm2": '"{ interval = [1.9, 2.1] }"'}
    write_register(tmp_path)
    path = tmp_path / "r.csv"
    row = ",".join(cells[column] for column in columns)
    path.write_text(f"scenario,name,{','.join(columns)}\ncell.toml,a,{row}\n", encoding="utf-8")
    (found,) = bs.load_register(path).situations
    assert found.scenario.uncertainty == {"contact.area_cm2": {"interval": [1.9, 2.1]}}


def test_a_register_is_no_scenario(tmp_path: Path) -> None:
    path = write_register(tmp_path, {"name": "a"})
    with pytest.raises(bs.InputError, match=r"register\.toml: is a register of contact situations; wanted a scenario"):
        bs.load_scenario(path)
    (tmp_path / "other.csv").write_text("scenario,name\nregister.toml,a\n", encoding="utf-8")
    (told,) = faults_of(tmp_path / "other.csv")
    assert "row 2 ('a'), scenario: " in told
    assert "is a register of contact situations" in told


_OF_TABLE = {"deceleration": "table", "stopping_table": str(REPOSITORY / "examples/stopping/tm5_700.toml")}


def _braking_by_a_table(folder: Path, *rows: dict[str, Any]) -> Path:
    path = write_register(folder, *rows)
    reaction = {"kind": "stop", "joint_acceleration_rad_s2": 4.5, "payload_percent": 33, **_OF_TABLE}
    cell = bs.load_scenario(folder / "cell.toml").as_given() | {"reaction": reaction}
    (folder / "cell.toml").write_text(to_toml({k: v for k, v in cell.items() if k != "folder"}), encoding="utf-8")
    return path


def test_a_row_takes_keys_of_its_scenario_out(tmp_path: Path) -> None:
    out = {"stopping_table": "none", "payload_percent": "none"}
    other = {"name": "b", "payload_kg": 2, "reaction": {"deceleration": "constant", **out}}
    table, constant = bs.load_register(_braking_by_a_table(tmp_path, {"name": "a"}, other)).situations
    assert table.scenario.reaction.stopping_table is not None
    assert constant.scenario.reaction.deceleration == "constant"
    assert constant.scenario.reaction.stopping_table is None
    assert (constant.scenario.reaction.payload_percent, constant.payload_kg) == (None, 2)


def test_a_row_that_cannot_leave_a_key_out_is_told_how(tmp_path: Path) -> None:
    path = _braking_by_a_table(tmp_path, {"name": "a"}, {"name": "b", "reaction.deceleration": "constant"})
    (told,) = faults_of(path)
    assert "leave it out (set reaction.stopping_table to none)" in told
    with pytest.raises(bs.InputError, match=r"leave it out \(set reaction\.stopping_table to none\)"):
        bs.load_scenario(tmp_path / "cell.toml", {"reaction.deceleration": "constant"})
    # Of a choice of a campaign, too.
    with pytest.raises(bs.InputError, match=r"leave it out \(set reaction\.stopping_table to none\)"):
        bs.load_scenario(tmp_path / "cell.toml").with_values({"reaction.deceleration": "constant"})


def test_a_value_that_was_taken_out_is_a_default(tmp_path: Path) -> None:
    path = write_register(tmp_path, {"name": "a", "reaction.kind": "none"}, {"name": "b", "reaction.kind": "stop"})
    for changes in ({}, {"detector.feedback_period_s": "none"}):
        found = bs.evaluate_register(bs.load_register(path, changes=changes)).results
        told = {one.situation.name: {each.key: each.status for each in one.inputs} for one in found}
        assert (told["a"]["reaction.kind"], told["b"]["reaction.kind"]) == ("default", "given")
        assert told["a"]["detector.feedback_period_s"] == ("default" if changes else "given")


@pytest.mark.parametrize("value", ["none", None])
def test_a_key_that_is_taken_out_is_as_if_nobody_had_given_it(tmp_path: Path, value: str | None) -> None:
    write_register(tmp_path)
    changes = {"contact.area_cm2": 3.0, "uncertainty.contact.area_cm2": {"interval": [2.0, 4.0]}}
    scenario = bs.load_scenario(tmp_path / "cell.toml", changes)
    left = scenario.with_values({"contact.area_cm2": value, "uncertainty.contact.area_cm2": value})
    assert "area_cm2" not in left.contact.model_fields_set
    assert left.uncertainty == {}
    for table in ("uncertainty", "uncertainty.contact"):
        assert scenario.with_values({table: value}).uncertainty == {}
    assert left.with_values({"contact.area_cm2": value}) == left


@pytest.mark.parametrize(
    ("key", "told"),
    [
        ("contact.bdy", "contact.bdy: is not a key of a scenario; did you mean 'body'"),
        ("contat.body", "contat: is not a key of a scenario; did you mean 'contact'"),
        ("robot.name", "'robot.name': is not a key of a scenario"),
        ("reaction", "reaction: is missing"),
        ("uncertainty.TYPO", 'uncertainty."TYPO": is not a number of a scenario that may be uncertain'),
        ("uncertainty.contact.area", 'uncertainty."contact.area": is not a number of a scenario that may be uncertain'),
        ("uncertainty.pose_dg[2]", 'uncertainty."pose_dg[2]": is not a number of a scenario that may be uncertain'),
    ],
)
def test_what_no_scenario_has_or_all_need_is_not_taken_out(tmp_path: Path, key: str, told: str) -> None:
    write_register(tmp_path)
    with pytest.raises(bs.InputError, match=f"^{re.escape(told)}"):
        bs.load_scenario(tmp_path / "cell.toml", {key: "none"})


def test_a_key_is_taken_out_in_either_spelling(tmp_path: Path) -> None:
    write_register(tmp_path)
    known = {"interval": [70_000, 80_000]}
    changes = {"contact.stiffness_N_m": 75_000, "uncertainty": {"contact.stiffness_N_m": known, "pose_deg[2]": known}}
    scenario = bs.load_scenario(tmp_path / "cell.toml", {**changes, "assumed": ["contact.stiffness_N_m"]})
    left = scenario.with_values({"contact.stiffness_N_mm": "none", "uncertainty.contact.stiffness_N_mm": "none"})
    assert (left.contact.stiffness_N_m, left.assumed, list(left.uncertainty)) == (None, [], ["pose_deg[2]"])
    assert list(scenario.with_values({"uncertainty.pose_deg": "none"}).uncertainty) == ["contact.stiffness_N_m"]
    other = {"contact.stiffness_N_mm": 60, "contact.stiffness_N_m": "none"}
    for both in (other, dict(reversed(other.items()))):
        assert scenario.with_values(both | {"uncertainty": None}).contact.stiffness_N_mm == 60
