"""Registers as files: what they say, in either format, and every fault of a bad one at once."""

from __future__ import annotations

import pickle
import tomllib
from pathlib import Path

import pytest

import bumpstop as bs
from bumpstop.register import RegisterError
from bumpstop.register.rows import MAX_NAME
from bumpstop.text_files import to_toml
from register.cases import EXAMPLES, SCENARIO, write_register

ROWS_TOML = """
scenario = "cell.toml"

[[situation]]
name = "one, with a comma"
link = "link_b"
point_m = [0, 0.01, 0]
body = "lower_arm_wrist"
kind = "free"
direction = [0, 3, -4]
speed_mm_s = 40
payload_kg = 1.5
frequency = "20"
contact.area_cm2 = 2.5
contact.body_mass_kg = 2
detector.thresholds_Nm = [20, 10, 20, 20, 20, inf, 20]

[[situation]]
name = "two"
note = "on the table"
"""
ROWS_CSV = (
    "# a comment\n"
    "scenario{d}name{d}link{d}point_m{d}body{d}kind{d}direction{d}speed_mm_s{d}payload_kg{d}frequency{d}note{d}"
    "contact.area_cm2{d}contact.body_mass_kg{d}detector.thresholds_Nm\n"
    'cell.toml{d}"one, with a comma"{d}link_b{d}0 0.01 0{d}lower_arm_wrist{d}free{d}"[0, 3, -4]"{d}40{d}1.5{d}20{d}{d}'
    '2.5{d}2{d}"20,10,20,20,20,inf,20"\n'
    "\n"
    "cell.toml{d}two{d}{d}{d}{d}{d}{d}{d}{d}{d}on the table{d}{d}{d}\n"
)


def faults_of(path: Path, **changes: object) -> list[str]:
    with pytest.raises(RegisterError) as refused:
        bs.load_register(path, changes=changes)
    return [str(fault) for fault in refused.value.faults]


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_toml_and_csv_say_the_same(tmp_path: Path, delimiter: str) -> None:
    write_register(tmp_path)
    (tmp_path / "r.toml").write_text(ROWS_TOML, encoding="utf-8")
    (tmp_path / "r.csv").write_text(ROWS_CSV.format(d=delimiter), encoding="utf-8-sig")
    one, other = (bs.load_register(tmp_path / name).situations for name in ("r.toml", "r.csv"))
    for a, b in zip(one, other, strict=True):
        assert a.scenario == b.scenario
        assert (a.name, a.payload_kg, a.frequency, a.note) == (b.name, b.payload_kg, b.frequency, b.note)
        assert set(a.given) == set(b.given)
    first = one[0].scenario
    assert first.motion.velocity == pytest.approx((0, 0.024, -0.032))
    assert first.contact.point_m == [0, 0.01, 0]
    assert one[1].scenario == bs.load_scenario(tmp_path / "cell.toml")


def test_a_row_is_the_scenario_with_the_same_changes(tmp_path: Path) -> None:
    path = write_register(tmp_path, {"name": "a", "speed_mm_s": 30, "contact.area_cm2": 3})
    changes = {"motion.speed_mm_s": 30, "contact.area_cm2": 3, "verdict.max_false_alarm": 0.01}
    (found,) = bs.load_register(path, changes={"verdict.max_false_alarm": 0.01}).situations
    assert found.scenario == bs.load_scenario(tmp_path / "cell.toml", changes)


def test_every_fault_of_every_row_at_once(tmp_path: Path) -> None:
    path = write_register(
        tmp_path,
        {"name": "good", "speed_mm_s": 50},
        {"name": "b", "body": "hnd", "kind": "clampd", "link": "nope", "speed_mm_s": "fast", "payload_kg": -1},
        {"name": "b", "direction": [0, 0, 0], "colour": "red", "contact.area": 3},
        {"speed_mm_s": 1e9, "contact.body": "face", "body": "chest"},
        {"name": "normal", "contact.normal": [0, 0, 1]},
        {"name": "=1+1"},
        inputs=({"key": "detector.threshold", "status": "fine"}, {"key": "detector", "status": "measured"}),
    )
    told = faults_of(path)
    register = f"{path} [[situation]]"
    for fault in (
        f"{path} [[input]] 1 key: 'detector.threshold' cannot be used",
        f"{path} [[input]] 1 status: 'fine' cannot be used; valid: measured",
        f"{register} 2 ('b'), body: 'hnd' is not a region of bgia2011",
        f"{register} 2 ('b'), kind: 'clampd' cannot be used; wanted 'clamped' or 'free'",
        f"{register} 2 ('b'), link: sia5d has no link 'nope'",
        f"{register} 2 ('b'), speed_mm_s: 'fast' cannot be used; wanted a number from 0.001 to 100000",
        f"{register} 2 ('b'), payload_kg: -1 cannot be used",
        f"{register} 3 ('b'), name: 'b' is the name of [[situation]] 2, too",
        f"{register} 3 ('b'), colour: is no key of a situation",
        f"{register} 3 ('b'), direction: [0.0, 0.0, 0.0] is no direction",
        f"{register} 3 ('b'), contact.area: is not a key of a scenario; did you mean 'area_cm2'?",
        f"{register} 4, name: is missing",
        f"{register} 4, speed_mm_s: 1000000000.0 cannot be used",
        f"{register} 4, body: and contact.body are both given",
        f"{register} 5 ('normal'), contact.normal: the contact point",
        f"{register} 6 ('=1+1'), name: '=1+1' cannot be used; wanted a text of 1 to 80 letters on one line that does",
    ):
        assert sum(line.startswith(fault) for line in told) == 1, (fault, told)
    assert len(told) == 16
    rows = [int(line.split("[[situation]] ")[1][0]) for line in told if "[[situation]]" in line.partition(",")[0]]
    assert rows == sorted(rows)


def test_a_fault_of_the_scenario_is_told_once_and_not_for_every_row(tmp_path: Path) -> None:
    path = write_register(tmp_path, {"name": "a", "speed_mm_s": 50}, {"name": "b", "body": "nobody"})
    cell = tmp_path / "cell.toml"
    cell.write_text(cell.read_text(encoding="utf-8").replace("= 4.5", "= -4.5"), encoding="utf-8")
    told = faults_of(path)
    assert [line.partition(":")[0] for line in told] == [
        f"{cell}, reaction.joint_acceleration_rad_s2",
        f"{path} [[situation]] 2 ('b'), body",
    ]
    told = faults_of(path, **{"detector.residual": "nothing"})
    assert sum("detector.residual: 'nothing' cannot be used" in line for line in told) == 1


def test_a_key_that_only_one_row_lacks_is_that_row_s_fault(tmp_path: Path) -> None:
    path = write_register(
        tmp_path, {"name": "a", "contact.body_mass_kg": 2, "kind": "free"}, {"name": "b", "kind": "free"}
    )
    (fault,) = faults_of(path)
    assert fault.startswith(f"{path} [[situation]] 2 ('b'), contact.body_mass_kg: is missing")


def test_a_fault_that_every_row_has_written_itself_is_told_of_each(tmp_path: Path) -> None:
    path = write_register(tmp_path, {"name": "a", "body": "nobody"}, {"name": "b", "body": "nobody"})
    assert [line.partition(":")[0] for line in faults_of(path)] == [
        f"{path} [[situation]] 1 ('a'), body",
        f"{path} [[situation]] 2 ('b'), body",
    ]


def test_scenarios_are_situations_of_their_own() -> None:
    other = SCENARIO.with_name("02_lower_arm_downward.toml")
    register = bs.load_register(SCENARIO, other, EXAMPLES / "sia5d_downward.csv")
    assert [one.name for one in register.situations][:2] == ["01_hand_downward", "02_lower_arm_downward"]
    assert len(register.situations) == 6
    assert register.situations[1].scenario == bs.load_scenario(other)


def test_a_path_is_not_cut_into_a_name_that_begins_a_formula(tmp_path: Path) -> None:
    short = MAX_NAME - 1 - len(f"/{SCENARIO.name}")
    copy = tmp_path / f"cell-{'a' * short}" / SCENARIO.name
    copy.parent.mkdir()
    copy.write_text(SCENARIO.read_text(encoding="utf-8"), encoding="utf-8")
    names = [one.name for one in bs.load_register(SCENARIO, copy).situations]
    assert names[1] == f"{'a' * short}/{SCENARIO.name}"


def test_the_same_scenario_twice_is_refused_and_files_of_one_name_are_told_apart(tmp_path: Path) -> None:
    (fault,) = faults_of_both(SCENARIO, SCENARIO)
    assert "is the name of" in fault
    copy = tmp_path / SCENARIO.name
    copy.write_text(SCENARIO.read_text(encoding="utf-8"), encoding="utf-8")
    told = [one.name for one in bs.load_register(SCENARIO, copy).situations]
    assert told == [str(path)[-MAX_NAME:].lstrip("=+-@") for path in (SCENARIO, copy)]


def faults_of_both(*paths: Path) -> list[str]:
    with pytest.raises(RegisterError) as refused:
        bs.load_register(*paths)
    again = pickle.loads(pickle.dumps(refused.value))
    assert str(again) == str(refused.value)
    return [str(fault) for fault in refused.value.faults]


def test_an_absent_scenario_is_told_once_beside_faults_of_rows(tmp_path: Path) -> None:
    path = write_register(tmp_path, {"name": "a"}, {"name": "b", "frequency": 3})
    (tmp_path / "cell.toml").unlink()
    told = faults_of(path)
    assert len(told) == 2
    assert told[0].startswith(f"{path}, scenario: {tmp_path / 'cell.toml'}: cannot be read")
    assert told[1] == f"{path} [[situation]] 2 ('b'), frequency: 3 cannot be used; wanted a text"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "is empty"),
        ("name,scenario\n", "has 0 situations"),
        ("name,name\na,b\n", "has two columns 'name'"),
        ("name,,body\na,b,c\n", "has a column without a name"),
        ('name,scenario\n"a,b\nc",d\n', "goes on in the next line"),
        ('name,scenario\n"a"b,c\n', "is not valid CSV"),
        ("t,q_1\n0,1\n1,2\n", "has no column 'scenario'"),
        ("name,scenario\na,b,c\n", "row 2: has 3 cells, and there are 2 columns"),
        ("name,scenario\na,\n", "scenario: is missing"),
    ],
)
def test_damaged_csv(tmp_path: Path, text: str, problem: str) -> None:
    path = tmp_path / "register.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(bs.InputError) as refused:
        bs.load_register(path)
    assert problem in str(refused.value)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("situation = 3", "situation: is not a list of tables"),
        ("situation = []", "has 0 situations"),
        ("[[situation]]\nname = 'a'\n[cell]\n", "cell: is no key of a register"),
        ("scenario = 3\n[[situation]]\nname = 'a'\n", "scenario: 3 cannot be used"),
        ("input = 3\n[[situation]]\nname = 'a'\n", "input: is not a list of tables"),
        ("[[situation]]\nname = 3\n", "name: 3 cannot be used"),
        ("[[situation]]\nname = ' '\n", "name: ' ' cannot be used"),
        ("[[situation]]\nname = 'a'\nmade_by.law = 'exact'\nscenario = 'cell.toml'\n", "made_by.law: is not a key"),
    ],
)
def test_damaged_toml(tmp_path: Path, text: str, problem: str) -> None:
    write_register(tmp_path)
    path = tmp_path / "r.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(bs.InputError) as refused:
        bs.load_register(path)
    assert problem in str(refused.value)


def test_the_payload_chooses_rows_of_a_stopping_table(tmp_path: Path) -> None:
    table = EXAMPLES.parent / "stopping" / "tm5_700.toml"
    reaction = {"reaction.deceleration": "table", "reaction.stopping_table": str(table)}
    base = str(EXAMPLES / "ur10e_table.toml")
    path = write_register(
        tmp_path,
        {"name": "a", "scenario": base, "payload_kg": 2, **reaction},
        {"name": "b", "scenario": base, "reaction.payload_percent": 50, **reaction},
        {"name": "c", "scenario": base, "payload_kg": 2},
    )
    found = bs.load_register(path).situations
    assert [one.scenario.reaction.payload_kg for one in found] == [2, None, None]
    assert [one.payload_kg for one in found] == [2, pytest.approx(6.25), 2], (
        "half of the 12.5 kg that an UR10e is rated for"
    )
    (told,) = faults_of(write_register(tmp_path, {"name": "a", "payload_kg": 2, "reaction.payload_percent": 50}))
    assert "payload_kg: and reaction.payload_percent are both given; give one of the two" in told


@pytest.mark.parametrize("of_scenario", [{}, {"payload_kg": 1.0}, {"payload_percent": 10.0}])
def test_the_payload_of_a_row_replaces_that_of_its_scenario(tmp_path: Path, of_scenario: dict[str, float]) -> None:
    """And ``--set`` replaces both, as every other key; a situation has one payload, which is computed and shown."""
    table = EXAMPLES.parent / "stopping" / "tm5_700.toml"
    path = write_register(tmp_path, {"name": "row", "payload_kg": 3}, {"name": "scenario"})
    cell = tmp_path / "cell.toml"
    data = tomllib.loads((EXAMPLES / "ur10e_table.toml").read_text(encoding="utf-8"))
    data["reaction"] |= {"deceleration": "table", "stopping_table": str(table), **of_scenario}
    cell.write_text(to_toml(data), encoding="utf-8")

    def payloads(**changes: object) -> list[tuple[float | None, float | None, float | None]]:
        reactions = [(one, one.scenario.reaction) for one in bs.load_register(path, changes=changes).situations]
        return [(one.payload_kg, reaction.payload_kg, reaction.payload_percent) for one, reaction in reactions]

    kg, percent = (of_scenario.get(key) for key in ("payload_kg", "payload_percent"))
    shown = kg if percent is None else pytest.approx(12.5 * percent / 100)
    assert payloads() == [(3, 3, None), (shown, kg, percent)]
    assert payloads(**{"reaction.payload_kg": 5.0}) == [(5, 5, None)] * 2
    assert payloads(**{"reaction.payload_percent": 20.0}) == [(2.5, None, 20)] * 2
    for one in bs.evaluate_register(bs.load_register(path)).results:
        told = [value.value for value in one.inputs if "payload" in value.key]
        assert len(told) == (one.situation.payload_kg is not None), told


def test_the_payload_goes_into_a_stopping_table_that_changes_bring(tmp_path: Path) -> None:
    table = EXAMPLES.parent / "stopping" / "tm5_700.toml"
    path = write_register(tmp_path, {"name": "a", "scenario": str(EXAMPLES / "ur10e_table.toml"), "payload_kg": 2})
    changes = {"reaction.deceleration": "table", "reaction.stopping_table": str(table)}
    (found,) = bs.load_register(path, changes=changes).situations
    assert found.scenario.reaction.payload_kg == 2


def test_a_column_that_nothing_is_called_after_is_told_once(tmp_path: Path) -> None:
    write_register(tmp_path)
    path = tmp_path / "r.csv"
    rows = "".join(f"cell.toml,number {i},1,2,3\n" for i in range(5))
    path.write_text(f"scenario,name,speed,contact.areas,motions.speed\n{rows}", encoding="utf-8")
    told = faults_of(path)
    assert [fault.partition(";")[0] for fault in told] == [
        f"{path} row 1, speed: is no key of a situation",
        f"{path} row 1, contact.areas: is not a key of a scenario",
        f"{path} row 1, motions.speed: is not a key of a scenario",
    ]


def test_a_row_that_begins_as_a_comment_is_refused(tmp_path: Path) -> None:
    write_register(tmp_path)
    path = tmp_path / "r.csv"
    alone = "# made on Monday\n#,,,\n"
    text = f"{alone}name,scenario,body,speed_mm_s\nA hand,cell.toml,hand_finger,50\n{alone}"
    path.write_text(text, encoding="utf-8")
    assert len(bs.load_register(path).situations) == 1
    path.write_text(f"{text}#2 hand fast,cell.toml,,190\n", encoding="utf-8")
    (told,) = faults_of(path)
    assert told.startswith(f"{path} row 7: begins with '#' and has a cell for each column; remove the mark")


def test_lines_of_a_damaged_csv_are_all_named(tmp_path: Path) -> None:
    write_register(tmp_path)
    path = tmp_path / "r.csv"
    lines = ["name,scenario", 'a,"cell.toml', "b,cell.toml,", 'c,"cell".toml', "d,nowhere.toml"]
    path.write_text("\n".join(lines), encoding="utf-8")
    places = [told.removeprefix(f"{path} row ")[0] for told in faults_of(path)]
    assert places == ["2", "3", "4", "5"]


def test_a_name_is_what_stands_between_its_spaces(tmp_path: Path) -> None:
    (found,) = bs.load_register(write_register(tmp_path, {"name": " hand "})).situations
    assert found.name == "hand"
    (told,) = faults_of(write_register(tmp_path, {"name": " hand "}, {"name": "hand"}))
    assert told.endswith("('hand'), name: 'hand' is the name of [[situation]] 1, too; give each situation its own")


def test_a_decimal_comma_is_told_as_it_was_written(tmp_path: Path) -> None:
    write_register(tmp_path)
    path = tmp_path / "r.csv"
    lines = ["scenario;name;contact.area_cm2;payload_kg;point_m", "cell.toml;a;2,5;1,5;0,1 0,2 0"]
    path.write_text("\n".join(lines), encoding="utf-8")
    told = [fault.removeprefix(f"{path} row 2 ('a'), ") for fault in faults_of(path)]
    valid = "write decimals with a dot: commas stand between the numbers of a list"
    assert told[0] == f"payload_kg: '1,5' cannot be used; {valid}"
    assert told[1] == f"contact.area_cm2: '2,5' cannot be used; {valid}"
    assert told[2].startswith("point_m: '0,1 0,2 0' cannot be used")


@pytest.mark.parametrize("suffix", [".xlsx", ".ods", ".tsv"])
def test_registers_are_toml_or_csv(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"r{suffix}"
    path.write_bytes(b"PK\x03\x04\xff")
    with pytest.raises(bs.InputError) as refused:
        bs.load_register(path)
    assert str(refused.value) == (
        f"{path}: is neither .toml nor .csv; wanted a register of contact situations (.toml or .csv) or a scenario "
        "(.toml); a spreadsheet is saved as CSV, UTF-8"
    )


def test_no_register_at_all() -> None:
    with pytest.raises(bs.InputError, match="wanted the path of a register"):
        bs.load_register()


def test_names_of_columns_count_whatever_their_case(tmp_path: Path) -> None:
    """Spreadsheets begin them with a capital: ``Scenario;Name`` was a register without the column 'scenario'."""
    write_register(tmp_path)
    path = tmp_path / "cells.csv"
    path.write_text("Scenario;Name;Speed_MM_s\ncell.toml;one;40\n")
    (situation,) = bs.load_register(path).situations
    assert situation.name == "one"
    path.write_text("Scenario;Name;name\ncell.toml;one;two\n")
    with pytest.raises(bs.InputError, match="has two columns 'name'"):
        bs.load_register(path)


@pytest.mark.parametrize("given", ["cells.csv", Path("cells.csv"), None])
def test_a_path_is_no_register(given: object) -> None:
    """It was an AttributeError about ``situations``."""
    with pytest.raises(
        bs.InputError, match=r"^register: a value of type \w+ is no register; wanted load_register\(path\)"
    ):
        bs.evaluate_register(given)  # type: ignore[arg-type]
