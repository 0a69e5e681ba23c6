"""Keys of rows: however they are written, and faults told under where they were written."""

from __future__ import annotations

from pathlib import Path

import pytest

import bumpstop as bs
from register.cases import write_register
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
